"""Gains of the motor controllers as parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from cspr_control.motors.motor_control import MotorGains
from cspr_control.nodes.parameters import ChangeableParameters
from cspr_kinematics import Robot
from cspr_msgs_py.runtime.process import declare


def declare_gains(
    node: Node, robot: Robot, period: float, apply: Callable[[MotorGains], None]
) -> ChangeableParameters[MotorGains]:
    """Declare the gains on a node.

    Parameters
    ----------
    node
        Node whose parameters they become.
    robot
        Its motor's inertia limits kd.
    period
        Of the control cycle, s.
    apply
        Takes changed gains over.

    Raises
    ------
    SettingError
        If the first values do not fit.
    """
    default = MotorGains()
    declare(node, "kp", default.kp, "Proportional gain", minimum=0.0, maximum=1000.0, unit="N m/rad")
    declare(
        node,
        "kd",
        default.kd,
        "Derivative gain, below 2 J / T with the motor inertia J and the control period T",
        minimum=0.0,
        maximum=100.0,
        unit="N m s/rad",
    )
    declare(
        node,
        "friction_compensation",
        default.friction_compensation,
        "Share of the motor's friction that is compensated at the desired speed",
        minimum=0.0,
        maximum=1.0,
    )
    declare(
        node,
        "friction_smoothing_speed",
        default.friction_smoothing_speed,
        "Desired motor speed at which the smoothed sign of the friction reaches tanh(1)",
        minimum=1e-3,
        maximum=100.0,
        unit="rad/s",
    )

    def build(values: dict[str, Any]) -> MotorGains:
        gains = MotorGains(**values)
        gains.require_sampled_stability(robot.motor.inertia, period)
        return gains

    names = ("kp", "kd", "friction_compensation", "friction_smoothing_speed")
    return ChangeableParameters(node, names, build, apply)
