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
from cspr_control.stability.guard import StabilityGuard
from cspr_kinematics import Robot
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import report_health


class MotorControlGains(Node):
    """Holds the gains as parameters, and the controllers that use them.

    The controllers have no parameter services of their own: six services a controller would only lengthen the
    tails of the control cycle. A change here reaches all of them between two cycles.

    Attributes
    ----------
    controllers
        One node a motor of the robot.
    gains
        Those in use.
    guard
        Refuses gains that are not known to be stable; None for none.
    """

    guard: StabilityGuard | None = None

    def __init__(self, wiring: Wiring | None = None, **options: Any) -> None:
        super().__init__("motor_control_gains", **options)
        robot = declare_robot(self)
        declare_all(self)
        self.gains = changeable_settings(self, partial(self._checked, robot), self._apply)
        wiring = wiring or Wiring()
        self.controllers = tuple(
            MotorControllerNode(motor, self.gains, wiring=wiring, robot=robot, **options)
            for motor in range(1, robot.number_of_cables + 1)
        )

    def guard_with(self, guard: StabilityGuard) -> None:
        """Let a guard refuse gains from now on, and report what it knows once a second."""
        self.guard = guard
        report_health(self, lambda: [guard.status()])

    def make_safe(self) -> None:
        """End what the guard has started."""
        if self.guard is not None:
            self.guard.close()

    def _checked(self, robot: Robot, values: dict[str, Any]) -> MotorGains:
        gains = motor_gains(robot, values)
        if self.guard is not None and (gains.kp, gains.kd) != (self.gains.kp, self.gains.kd):
            self.guard.require(gains)
        return gains

    def _apply(self, gains: MotorGains) -> None:
        self.gains = gains
        for controller in self.controllers:
            controller.component.configure(gains)
