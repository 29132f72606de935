"""motor_controller: answers each motor state of one motor with a torque."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from cspr_control.errors import SettingError
from cspr_control.motors.motor_control import MotorController, MotorGains
from cspr_control.nodes.parameters import ChangeableParameters, declare_robot
from cspr_control.parameters.settings import motor_gains
from cspr_kinematics import Robot
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.parameters.table import MOTOR, SETPOINT_TIMEOUT
from cspr_msgs_py.runtime.parameters import declare, declare_all
from cspr_msgs_py.runtime.process import LEAN_NODE, Diagnostics, advertise, run_nodes, subscribe_raw
from cspr_msgs_py.topics import MOTOR_STATES, SETPOINT, motor_command, motor_names
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.conversions import diagnostic_status
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.joint_state_conversion import decode_joint


class MotorControllerNode(Node):
    """Controller of motor K, named ``motor_controller_K``.

    Alone, its gains are its own parameters. As one of many in a process it is lean: without rosout, parameter
    services and gain parameters; its gains are then those of the node ``motor_control_gains``.

    Parameters
    ----------
    motor
        K, counted from 1.
    gains
        Gains to start with when somebody else holds the parameters; None if the node declares them itself.
    robot
        The robot; read from ``robot_config`` if None.
    **options
        Further keyword arguments of `rclpy.node.Node`.
    """

    def __init__(
        self, motor: int, gains: MotorGains | None = None, robot: Robot | None = None, **options: Any
    ) -> None:
        lean = LEAN_NODE if gains is not None else {}
        super().__init__(f"motor_controller_{motor}", **lean, **options)
        robot = declare_robot(self) if robot is None else robot
        count = robot.number_of_cables
        if not 1 <= motor <= count:
            raise SettingError(f"parameter motor: {motor}; the motors of {robot.name} are 1 to {count}")
        timeout = declare(self, SETPOINT_TIMEOUT)
        if gains is None:
            declare_all(self, "motor_controller_K")
            gains = ChangeableParameters(self, partial(motor_gains, robot), self.set_gains).settings
        self._index = motor - 1
        self._controller = MotorController(robot.motor, gains, timeout)
        self._codec = JointStateCodec(motor_names(count))
        self._command_codec = JointStateCodec((f"motor_{motor}",), position=False, velocity=False)
        self._unreadable = 0
        self._saturations_reported = 0
        self._publisher = advertise(self, motor_command(motor))
        subscribe_raw(self, SETPOINT, self._on_setpoint)
        subscribe_raw(self, MOTOR_STATES, self._on_states)
        self._diagnostics = Diagnostics(self, self._status)

    def set_gains(self, gains: MotorGains) -> None:
        """Use other gains from the next command on."""
        self._controller.set_gains(gains)

    def _on_setpoint(self, message: bytes) -> None:
        now = time.monotonic()
        try:
            setpoint = decode_joint(self._codec, message, self._index)
        except MessageError:
            self._unreadable += 1
            return
        self._controller.set_setpoint(now, *setpoint)

    def _on_states(self, message: bytes) -> None:
        now = time.monotonic()
        try:
            state = decode_joint(self._codec, message, self._index)
        except MessageError:
            self._unreadable += 1
            return
        torque = self._controller.command(now, state.stamp_ns, state.position, state.velocity)
        if torque is not None:
            self._publisher.publish(self._command_codec.encode(state.stamp_ns, effort=(torque,)))

    def _status(self) -> list[DiagnosticStatus]:
        controller = self._controller
        level, text = Level.OK, "following set-points"
        if controller.last_refusal is not None:
            level, text = Level.WARN, f"no torque: {controller.last_refusal.value}"
        elif controller.saturations > self._saturations_reported:
            level, text = Level.WARN, "the torque is limited"
        self._saturations_reported = controller.saturations
        values = {
            "saturations": controller.saturations,
            "unreadable_messages": self._unreadable,
            **{f"refusals_{cause.name.lower()}": count for cause, count in controller.refusals.items()},
        }
        return [diagnostic_status(self.get_name(), level, text, values)]


def _create() -> Sequence[Node]:
    # The motor decides the node's name, so it must be known before the node exists.
    selector = Node("motor_controller", **LEAN_NODE)
    try:
        motor = declare(selector, MOTOR)
    finally:
        selector.destroy_node()
    return [MotorControllerNode(motor)]


def main() -> int:
    """Run the controller of the motor that the parameter ``motor`` names."""
    return run_nodes(_create)


if __name__ == "__main__":
    sys.exit(main())
