"""Node ``can_drives``: motor states from the drives, torque commands to them, and their enabling."""

from __future__ import annotations

import sys
from functools import partial

from cspr_drivers.bus.bus_load import require_fitting_cycle
from cspr_drivers.bus.can_ports import CanPorts
from cspr_drivers.driver_messages import drive_diagnostics, drive_states
from cspr_drivers.drives.master import DriveMaster
from cspr_drivers.drives.report import MotorStates
from cspr_drivers.drives.winding import Direction
from cspr_drivers.nodes.driver_node import SWITCH_INTERVAL, DriverNode
from cspr_msgs_py.errors import MessageError, failure_text
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import advertise, run_nodes, subscribe_raw
from cspr_msgs_py.topics import (
    CABLE_TENSIONS,
    DRIVE_STATES,
    MOTOR_STATES,
    SUPERVISOR_ALIVE,
    motor_command,
    motor_names,
)
from cspr_msgs_py.vocabulary import DriverState
from cspr_msgs_py.wire.conversion import decode_joint, decoder
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.samples import Status
from cspr_msgs_py.wire.topic_codecs import topic_codec

_STEP = 0.05
"""What the time of day moves from one report to the next, s, at most, when it is not set but slewed."""


class CanDrives(DriverNode[DriveMaster]):
    """Driver of all drives of `can.yaml`; parameters as of `DriverNode`."""

    name = "can_drives"
    states = DRIVE_STATES

    def prepare(self) -> None:
        """Declare parameters, and offer motor states, torque commands and services."""
        self._rate = declare_all(self, control_rate=self.config.rate)["control_rate"]
        names = motor_names(len(self.config.drives))
        self._codec = JointStateCodec(names)
        self._states = advertise(self, MOTOR_STATES)
        self._state: DriverState | None = None  # the last one in the log
        for index, name in enumerate(names):
            codec = JointStateCodec((name,), position=False, velocity=False)
            subscribe_raw(self, motor_command(index + 1), partial(self._command, index, codec))
        self._decode_tensions = decoder(CABLE_TENSIONS, len(names))
        subscribe_raw(self, CABLE_TENSIONS, self._heard_tensions)
        self._wound = ""  # the last winding in the log
        self._time_set_by = 0.0
        self.deaf_to_supervisor = False  # a fault on purpose
        self._sign = topic_codec(SUPERVISOR_ALIVE, len(names)).decode
        subscribe_raw(self, SUPERVISOR_ALIVE, self._supervised)
        self._offer("~", None, "quick stop commanded")
        self.service("~/set_home", self._set_home)
        for index, name in enumerate(names):
            self._offer(f"~/{name}", index, f"quick stop of {name} commanded")
            for way in Direction:
                wind = partial(self._wind, index, way)
                self.service(f"~/{name}/wind_{way.name.lower()}", wind, needs_active=True)

    def create_master(self, ports: CanPorts) -> DriveMaster:
        """Return a driver that sends SYNC and configures the drives."""
        for load in require_fitting_cycle(self.config, self._rate):
            self.get_logger().info(str(load))
        return DriveMaster(self.config, ports, self._publish, self.get_logger().warning)

    def disarm(self, master: DriveMaster) -> None:
        """Close the brakes, and wait until they hold."""
        master.come_to_rest()
        self.publish_states(master)

    def end(self) -> None:
        """Close the brakes, wait until they hold, and leave the bus."""
        if self._master is not None:
            self._master.stop()
            self.publish_states(self._master)
        super().end()

    def failed(self, error: Exception) -> None:
        """Stop the drives, and say what went wrong in a callback."""
        if self._master is not None:
            self._master.quick_stop(f"{self.get_name()} failed: {failure_text(error)}")
        super().failed(error)

    def present(self, master: DriveMaster) -> object:
        """Return state and cause of all drives, and the state of each."""
        return master.states()

    def statuses(self, master: DriveMaster) -> list[Status]:
        """Return the states of the drives; a new state of all of them is logged."""
        report = master.snapshot()
        if report.state is not self._state:
            self._state = report.state
            self.get_logger().info(
                f"drives {report.state.value}" + (f": {report.cause}" if report.cause else "")
            )
        if report.last_winding != self._wound:
            self._wound = report.last_winding
            self.get_logger().info(report.last_winding)
        return drive_states(report)

    def diagnostics(self, master: DriveMaster) -> list[Status]:
        """Return the health of the driver, and that of each drive; a step of the time of day is logged."""
        report = master.snapshot()
        if abs(report.time_set_by - self._time_set_by) > _STEP:
            self.get_logger().warning(
                f"the computer's time of day was set by {report.time_set_by - self._time_set_by:+.3f} s: stamps go on "
                "as they were until the drivers are started again"
            )
        self._time_set_by = report.time_set_by
        return drive_diagnostics(report)

    def _offer(self, prefix: str, index: int | None, quick_stop: str) -> None:
        """Offer the commands to all drives, or to one."""
        self.service(f"{prefix}/enable", lambda master: master.enable(index), needs_active=True)
        self.service(f"{prefix}/disable", lambda master: master.disable(index))
        self.service(f"{prefix}/quick_stop", lambda master: master.quick_stop(quick_stop))
        self.service(f"{prefix}/fault_reset", lambda master: master.fault_reset(index))

    @staticmethod
    def _wind(index: int, direction: Direction, master: DriveMaster) -> str | None:
        return master.wind(index, direction)

    def _heard_tensions(self, buffer: bytes) -> None:
        # wanted for winding alone: in operation they would cost time in every cycle
        if self._master is None or self._state not in (DriverState.DISABLED, DriverState.WINDING):
            return
        try:
            tensions = self._decode_tensions(buffer).effort.tolist()
        except MessageError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=1.0)
        else:
            self._master.tensions(tensions)

    def _set_home(self, master: DriveMaster) -> str | None:
        refusal = master.set_home()
        if refusal is None:
            self.config = master.config
            self.get_logger().warning(
                f"the present pose is the home pose now, stored in {self.config.source}; the tensions that the load "
                "cells show there belong into home_tensions of robot.yaml"
            )
        return refusal

    def _publish(self, states: MotorStates) -> None:
        self._states.publish(
            self._codec.encode(states.stamp_ns, states.angles, states.speeds, states.torques)
        )

    def _supervised(self, buffer: bytes) -> None:
        if self._master is None or self.deaf_to_supervisor:
            return
        try:
            sign = self._sign(buffer)
        except MessageError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=1.0)
        else:
            self._master.supervised(sign.stamp_ns)

    def _command(self, index: int, codec: JointStateCodec, buffer: bytes) -> None:
        master = self._master
        if master is None:
            return
        try:
            command = decode_joint(codec, buffer)
        except MessageError as error:
            master.reject_command(index, str(error))
            return
        master.command(index, command.stamp_ns, command.effort)


def main() -> int:
    """Run the node in a process of its own."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_nodes(lambda: [CanDrives()])


if __name__ == "__main__":
    sys.exit(main())
