"""motor_control_gains: the gains that all motor controllers of one process share."""

from __future__ import annotations

from functools import partial
from typing import Any

from rclpy.node import Node

from cspr_control.motors.motor_control import MotorGains
from cspr_control.nodes.component_node import Wiring
from cspr_control.nodes.motor_controller import MotorControllerNode
from cspr_control.nodes.parameters import changeable_settings, declare_robot
from cspr_control.parameters.settings import motor_gains
from cspr_msgs_py.runtime.parameters import declare_all


class MotorControlGains(Node):
    """Holds the gains as parameters, and the controllers that use them.

    The controllers have no parameter services of their own: six services a controller would only lengthen the
    tails of the control cycle. A change here reaches all of them between two cycles.

    Attributes
    ----------
    controllers
        One node a motor of the robot.
    """

    def __init__(self, wiring: Wiring | None = None, **options: Any) -> None:
        super().__init__("motor_control_gains", **options)
        robot = declare_robot(self)
        declare_all(self)
        gains = changeable_settings(self, partial(motor_gains, robot), self._apply)
        wiring = wiring or Wiring()
        self.controllers = tuple(
            MotorControllerNode(motor, gains, wiring=wiring, robot=robot, **options)
            for motor in range(1, robot.number_of_cables + 1)
        )

    def _apply(self, gains: MotorGains) -> None:
        for controller in self.controllers:
            controller.component.configure(gains)
