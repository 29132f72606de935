"""Node ``can_drives``: motor states from the drives, torque commands to them, and their enabling."""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from std_srvs.srv import Trigger

from cspr_drivers.bus_load import require_fitting_load
from cspr_drivers.can_bus import CanPorts, open_ports
from cspr_drivers.can_config import CanConfig
from cspr_drivers.drive_group import GroupState
from cspr_drivers.drive_master import DriveMaster
from cspr_drivers.drive_report import MotorStates
from cspr_drivers.drive_status import DriveStatus
from cspr_drivers.nodes.driver_messages import bus_status, drive_diagnostics, drive_states
from cspr_msgs_py.conversions import diagnostic_array
from cspr_msgs_py.errors import MessageError, StartError
from cspr_msgs_py.joint_state import JointStateCodec
from cspr_msgs_py.joint_state_conversion import decode_joint
from cspr_msgs_py.nodes.process import (
    Diagnostics,
    advertise,
    declare,
    run_nodes,
    steady_timer,
    subscribe_raw,
)
from cspr_msgs_py.topics import DRIVE_STATES, MOTOR_STATES, motor_command, motor_names

# Threads of a driver wait for each other for microseconds; Python's 5 ms are longer than a cycle.
SWITCH_INTERVAL = 0.0001  # s

STATE_PERIOD = 0.02  # s; how soon a change of state is on /drive_states


class CanDrives(Node):
    """Driver of all drives of `can.yaml`.

    Parameters
    ----------
    config, ports
        Configuration and open buses when they are shared with another node; the node closes only buses that
        it has opened itself. By default both come from the parameter ``can_config``.
    options
        Keyword arguments of `Node`.
    """

    def __init__(
        self, config: CanConfig | None = None, ports: CanPorts | None = None, **options: Any
    ) -> None:
        super().__init__("can_drives", **options)
        self.config = load_config(self) if config is None else config
        for load in require_fitting_load(self.config):
            self.get_logger().info(str(load))
        rate = declare(
            self,
            "control_rate",
            self.config.rate,
            "rate of the control cycle that the controllers expect",
            minimum=1.0,
            unit="Hz",
            read_only=True,
        )
        if rate != self.config.rate:
            raise StartError(
                f"parameter control_rate is {rate:g} Hz, but {self.config.source}: "
                f"rate = {self.config.rate:g}: make them equal"
            )
        names = motor_names(len(self.config.drives))
        self._codec = JointStateCodec(names)
        self._states = advertise(self, MOTOR_STATES)
        self._drive_states = advertise(self, DRIVE_STATES)
        self._owns_ports = ports is None
        self.ports = open_ports(self.config) if ports is None else ports
        self._master = DriveMaster(self.config, self.ports, self._publish, self.get_logger().warning)
        try:
            self._master.start()
        except Exception:
            self._close_ports()
            raise
        for index, name in enumerate(names):
            codec = JointStateCodec((name,), position=False, velocity=False)
            subscribe_raw(self, motor_command(index + 1), partial(self._command, index, codec))
        self.create_service(Trigger, "~/enable", partial(self._answer, self._master.enable))
        self.create_service(Trigger, "~/disable", partial(self._answer, self._master.disable))
        self.create_service(Trigger, "~/quick_stop", partial(self._answer, self._quick_stop))
        self.create_service(Trigger, "~/fault_reset", partial(self._answer, self._master.fault_reset))
        self._published_states: tuple[GroupState, str, tuple[DriveStatus, ...]] | None = None
        self._since_published = 0.0
        steady_timer(self, STATE_PERIOD, self._watch_states)
        self._diagnostics = Diagnostics(self, self._report)

    def make_safe(self) -> None:
        """Close the brakes, wait until they hold, and leave the bus."""
        self._master.stop()
        self._publish_states()

    def destroy_node(self) -> None:
        """Destroy the node; close the buses if it has opened them."""
        self._close_ports()
        super().destroy_node()

    def _close_ports(self) -> None:
        if self._owns_ports:
            self.ports.close()

    def _publish(self, states: MotorStates) -> None:
        self._states.publish(
            self._codec.encode(states.stamp_ns, states.angles, states.speeds, states.torques)
        )

    def _command(self, index: int, codec: JointStateCodec, buffer: bytes) -> None:
        try:
            command = decode_joint(codec, buffer, 0)
        except MessageError as error:
            self._master.reject_command(index, str(error))
            return
        self._master.command(index, command.stamp_ns, command.effort)

    def _quick_stop(self) -> None:
        self._master.quick_stop("quick stop commanded")

    def _answer(
        self, act: Callable[[], str | None], request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        refusal = act()
        response.success = refusal is None
        response.message = refusal or "accepted"
        return response

    def _watch_states(self) -> None:
        self._since_published += STATE_PERIOD
        if self._master.states() != self._published_states or self._since_published >= 1.0:
            self._publish_states()

    def _publish_states(self) -> None:
        states = self._master.states()
        before, self._published_states = self._published_states, states
        self._since_published = 0.0
        state, cause, drives = states
        stamp = self.get_clock().now().nanoseconds
        self._drive_states.publish(diagnostic_array(stamp, drive_states(state, cause, drives)))
        if before is None or before[0] is not state:
            self.get_logger().info(f"drives {state.value}" + (f": {cause}" if cause else ""))

    def _report(self) -> list[DiagnosticStatus]:
        return [
            drive_diagnostics(self._master.snapshot()),
            *(bus_status("can_drives", p) for p in self.ports),
        ]


def load_config(node: Node) -> CanConfig:
    """Return the configuration that the node's parameter ``can_config`` names."""
    path = declare(node, "can_config", "config/can.yaml", "file that describes the CAN side", read_only=True)
    return CanConfig.from_yaml(Path(path))


def main() -> int:
    """Run the node in a process of its own."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_nodes(lambda: [CanDrives()])


if __name__ == "__main__":
    sys.exit(main())
