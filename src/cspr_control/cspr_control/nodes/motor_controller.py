"""motor_controller: answers each motor state of one motor with a torque."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

from rclpy.node import Node

from cspr_control.components.motor import MotorComponent
from cspr_control.errors import SettingError
from cspr_control.motors.motor_control import MotorGains
from cspr_control.nodes.component_node import ComponentNode
from cspr_control.parameters.settings import motor_gains
from cspr_msgs_py.parameters.table import MOTOR, SETPOINT_TIMEOUT
from cspr_msgs_py.runtime.parameters import declare, declare_all
from cspr_msgs_py.runtime.process import LEAN_NODE, run_nodes

_SELECTOR = "motor_controller"


class MotorControllerNode(ComponentNode):
    """Node of `MotorComponent` of motor K, named ``motor_controller_K``.

    Alone, its gains are its own parameters. As one of many in a process it is lean: without rosout, parameter
    services and gain parameters; its gains are then those of the node ``motor_control_gains``.

    Parameters
    ----------
    motor
        K, counted from 1.
    gains
        Gains to start with when somebody else holds the parameters; None if the node declares them itself.
    **options
        Further keyword arguments of `ComponentNode`.
    """

    def __init__(self, motor: int, gains: MotorGains | None = None, **options: Any) -> None:
        lean: Any = LEAN_NODE if gains is not None else {}
        super().__init__(f"motor_controller_{motor}", **lean, **options)
        robot = self.robot
        count = robot.number_of_cables
        if not 1 <= motor <= count:
            raise SettingError(f"parameter motor: {motor}; the motors of {robot.name} are 1 to {count}")
        timeout = declare(self, SETPOINT_TIMEOUT)
        if gains is None:
            declare_all(self, "motor_controller_K")
            gains = self.changeable(partial(motor_gains, robot))
        self.connect(MotorComponent(motor, robot.motor, gains, timeout))


def _create() -> Sequence[Node]:
    # The motor decides the node's name, so it must be known before the node exists.
    selector = Node(_SELECTOR, **LEAN_NODE)
    try:
        motor = declare(selector, MOTOR)
    finally:
        selector.destroy_node()
    return [MotorControllerNode(motor)]


def main() -> int:
    """Run the controller of the motor that the parameter ``motor`` names."""
    return run_nodes(_create, asked_before={_SELECTOR: (MOTOR.name,)})


if __name__ == "__main__":
    sys.exit(main())
