"""Node ``can_drives``: motor states from the drives, torque commands to them, and their enabling."""

from __future__ import annotations

import sys
from functools import partial
from typing import Any

from cspr_drivers.bus.bus_load import require_fitting_load
from cspr_drivers.bus.can_bus import CanPorts
from cspr_drivers.bus.shared_ports import SharedPorts
from cspr_drivers.clock import COMPUTER, Clock
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.drives.master import DriveMaster
from cspr_drivers.drives.report import MotorStates
from cspr_drivers.drives.status import DriveStatus
from cspr_drivers.nodes.driver_messages import bus_status, drive_diagnostics, drive_states, not_configured
from cspr_drivers.nodes.driver_node import DriverNode
from cspr_msgs_py.errors import MessageError, StartError
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import (
    Diagnostics,
    advertise,
    run_nodes,
    sample_publisher,
    steady_timer,
    subscribe_raw,
)
from cspr_msgs_py.topics import DRIVE_STATES, MOTOR_STATES, motor_command, motor_names
from cspr_msgs_py.vocabulary import DriverState
from cspr_msgs_py.wire.conversion import decode_joint
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.samples import Status, StatusArray

# Threads of a driver hold the interpreter for microseconds; Python's default of 5 ms is longer than a cycle.
SWITCH_INTERVAL = 0.0001  # s

STATE_PERIOD = 0.02  # s; how soon a change of state is on /drive_states


class CanDrives(DriverNode):
    """Driver of all drives of `can.yaml`; parameters as of `DriverNode`."""

    def __init__(
        self,
        config: CanConfig | None = None,
        ports: SharedPorts | CanPorts | None = None,
        clock: Clock = COMPUTER,
        **options: Any,
    ) -> None:
        super().__init__("can_drives", config, ports, clock, **options)
        self._rate = declare_all(self, control_rate=self.config.rate)["control_rate"]
        names = motor_names(len(self.config.drives))
        self._codec = JointStateCodec(names)
        self._states = advertise(self, MOTOR_STATES)
        self._send_states = sample_publisher(self, DRIVE_STATES)
        self._master: DriveMaster | None = None
        self._published_states: tuple[DriverState, str, tuple[DriveStatus, ...]] | None = None
        self._since_published = 0.0
        for index, name in enumerate(names):
            codec = JointStateCodec((name,), position=False, velocity=False)
            subscribe_raw(self, motor_command(index + 1), partial(self._command, index, codec))
        self._offer("~", None, "quick stop commanded")
        self.service("~/set_home", self._set_home)
        for index, name in enumerate(names):
            self._offer(f"~/{name}", index, f"quick stop of {name} commanded")
        steady_timer(self, STATE_PERIOD, self._watch_states)
        self._diagnostics = Diagnostics(self, self._report)
        self.autostart()

    @property
    def master(self) -> DriveMaster:
        """The driver of a node that is configured."""
        if self._master is None:
            raise RuntimeError("the node is not configured")
        return self._master

    def begin(self, ports: CanPorts) -> None:
        """Begin to send SYNC and to configure the drives."""
        for load in require_fitting_load(self.config):
            self.get_logger().info(str(load))
        if self._rate != self.config.rate:
            raise StartError(
                f"parameter control_rate is {self._rate:g} Hz, but {self.config.source}: "
                f"rate = {self.config.rate:g}: make them equal"
            )
        self._master = DriveMaster(self.config, ports, self._publish, self.get_logger().warning)
        self._master.start()

    def disarm(self) -> None:
        """Close the brakes, and wait until they hold."""
        self.master.come_to_rest()
        self._publish_states()

    def end(self) -> None:
        """Close the brakes, wait until they hold, and leave the bus."""
        if self._master is not None:
            self._master.stop()
            self._publish_states()
            self._master = None

    def _offer(self, prefix: str, index: int | None, quick_stop: str) -> None:
        """Offer the commands to all drives, or to one."""

        def disable() -> None:
            self.master.disable(index)

        self.service(f"{prefix}/enable", lambda: self.master.enable(index), needs_active=True)
        self.service(f"{prefix}/disable", disable)
        self.service(f"{prefix}/quick_stop", lambda: self.master.quick_stop(quick_stop))
        self.service(f"{prefix}/fault_reset", lambda: self.master.fault_reset(index))

    def _set_home(self) -> str | None:
        refusal = self.master.set_home()
        if refusal is None:
            self.config = self.master.config
            self.get_logger().warning(
                f"the present pose is the home pose now, stored in {self.config.source}"
            )
        return refusal

    def _publish(self, states: MotorStates) -> None:
        self._states.publish(
            self._codec.encode(states.stamp_ns, states.angles, states.speeds, states.torques)
        )

    def _command(self, index: int, codec: JointStateCodec, buffer: bytes) -> None:
        master = self._master
        if master is None:
            return
        try:
            command = decode_joint(codec, buffer, 0)
        except MessageError as error:
            master.reject_command(index, str(error))
            return
        master.command(index, command.stamp_ns, command.effort)

    def _watch_states(self) -> None:
        self._since_published += STATE_PERIOD
        if self._master is not None and (
            self._master.states() != self._published_states or self._since_published >= 1.0
        ):
            self._publish_states()

    def _publish_states(self) -> None:
        states = self.master.states()
        before, self._published_states = self._published_states, states
        self._since_published = 0.0
        stamp = self.get_clock().now().nanoseconds
        statuses = drive_states(self.master.snapshot())
        self._send_states(StatusArray(stamp, tuple(statuses)))
        state, cause, _ = states
        if before is None or before[0] is not state:
            self.get_logger().info(f"drives {state.value}" + (f": {cause}" if cause else ""))

    def _report(self) -> list[Status]:
        if self._master is None:
            return [not_configured(self.get_name())]
        return [
            *drive_diagnostics(self._master.snapshot()),
            *(bus_status("can_drives", p) for p in self.ports),
        ]


def main() -> int:
    """Run the node in a process of its own."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_nodes(lambda: [CanDrives()])


if __name__ == "__main__":
    sys.exit(main())
