"""The settings of all components of the control graph."""

from __future__ import annotations

from dataclasses import dataclass

from cspr_control.components.trajectory import TrajectorySettings
from cspr_control.estimation.payload import EstimatorSettings
from cspr_control.motors.feedforward import FeedforwardSettings
from cspr_control.motors.motor_control import MotorGains
from cspr_control.parameters.settings import (
    estimator_settings,
    feedforward_settings,
    motor_gains,
    one_control_rate,
    supervision_limits,
    trajectory_settings,
)
from cspr_control.supervision.checks import SupervisionLimits
from cspr_kinematics import Robot
from cspr_msgs_py.parameters.file import ParameterFile
from cspr_msgs_py.parameters.table import ALL_NODES, CONTROL_RATE, node_parameters

NODES = (
    "trajectory_publisher",
    "feedforward",
    "motor_control_gains",
    "pose_estimator",
    "mass_estimator",
    "supervisor",
    ALL_NODES,
)
"""The nodes whose parameters the settings are; motor controllers have only what is said of all nodes."""


@dataclass(frozen=True)
class ControlSettings:
    """Settings of every component of the control graph.

    Attributes
    ----------
    trajectory, feedforward, gains, payload, supervision
        Of trajectory player, feed-forward, motor controllers, payload estimation and supervisor.
    control_rate
        Of the control cycle, Hz.
    setpoint_timeout
        Age at which motor controllers no longer use a set-point, s.
    pose_rate
        Rate of the estimated poses, Hz.
    """

    trajectory: TrajectorySettings
    control_rate: float
    feedforward: FeedforwardSettings
    gains: MotorGains
    setpoint_timeout: float
    pose_rate: float
    payload: EstimatorSettings
    supervision: SupervisionLimits

    @property
    def period(self) -> float:
        """Of the control cycle, s."""
        return 1.0 / self.control_rate


def control_settings(robot: Robot, parameters: ParameterFile) -> ControlSettings:
    """Return what a parameter file gives to the control nodes, as those would read it.

    Raises
    ------
    ControlError, cspr_kinematics.KinematicsError, cspr_msgs_py.errors.ParameterError
        If a value does not fit its parameter.
    """
    gains = parameters.values("motor_control_gains")
    controllers = parameters.values("motor_controller_1")
    rated = [node for node in NODES if node != ALL_NODES and CONTROL_RATE.name in node_parameters(node)]
    return ControlSettings(
        trajectory_settings(robot, parameters.values("trajectory_publisher")),
        one_control_rate({node: parameters.values(node)[CONTROL_RATE.name] for node in rated}),
        feedforward_settings(robot.number_of_cables, parameters.values("feedforward")),
        motor_gains(robot, gains),
        controllers["setpoint_timeout"],
        parameters.values("pose_estimator")["rate"],
        estimator_settings(parameters.values("mass_estimator")),
        supervision_limits(robot, parameters.values("supervisor")),
    )
