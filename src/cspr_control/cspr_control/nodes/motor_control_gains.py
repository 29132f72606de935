"""motor_control_gains: the gains that all motor controllers of one process share."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node

from cspr_control.motors.motor_control import MotorGains
from cspr_control.nodes.gain_parameters import declare_gains
from cspr_control.nodes.motor_controller import MotorControllerNode
from cspr_control.nodes.parameters import declare_control_period, declare_robot


class MotorControlGains(Node):
    """Holds the gains as parameters, and the controllers that use them.

    The controllers have no parameter services of their own: six services a controller would only lengthen the
    tails of the control cycle. A change here reaches all of them between two cycles.

    Attributes
    ----------
    controllers
        One node a motor of the robot.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("motor_control_gains", **options)
        robot = declare_robot(self)
        parameters = declare_gains(self, robot, declare_control_period(self), self._apply)
        self.controllers = tuple(
            MotorControllerNode(motor, parameters.settings, robot, **options)
            for motor in range(1, robot.number_of_cables + 1)
        )

    def _apply(self, gains: MotorGains) -> None:
        for controller in self.controllers:
            controller.set_gains(gains)
