"""The settings of all components of the control graph."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import PurePath

from cspr_control.estimation.payload import EstimatorSettings
from cspr_control.motors.feedforward import FeedforwardSettings
from cspr_control.motors.motor_control import MotorGains
from cspr_control.parameters.settings import (
    NoticedValues,
    estimator_settings,
    feedforward_settings,
    motor_gains,
    require_same,
    supervision_limits,
    trajectory_settings,
)
from cspr_control.reference.catalogue import TrajectorySettings
from cspr_control.supervision.checks import SupervisionLimits
from cspr_kinematics import Robot
from cspr_msgs_py.parameters.file import ParameterFile
from cspr_msgs_py.parameters.table import CONTROL_RATE, ROBOT_CONFIG


@dataclass(frozen=True)
class ControlSettings:
    """Settings of every component of the control graph.

    Attributes
    ----------
    trajectory, feedforward, gains, payload, supervision
        Of trajectory player, feed-forward, motor controllers, payload estimation and supervisor.
    control_rate
        Of the control cycle, Hz.
    setpoint_timeouts
        Age at which each motor controller no longer uses a set-point, s.
    pose_rate
        Rate of the estimated poses, Hz.
    """

    trajectory: TrajectorySettings
    control_rate: float
    feedforward: FeedforwardSettings
    gains: MotorGains
    setpoint_timeouts: tuple[float, ...]
    pose_rate: float
    payload: EstimatorSettings
    supervision: SupervisionLimits


def robot_file(parameters: ParameterFile) -> str:
    """Return the name of the robot's file, which lies in the directory of the parameter file."""
    return PurePath(parameters.values("feedforward")[ROBOT_CONFIG.name]).name


def control_settings(robot: Robot, parameters: ParameterFile) -> ControlSettings:
    """Return what a parameter file gives to the control nodes, as those of `control` would read it.

    Raises
    ------
    ControlError, cspr_kinematics.KinematicsError, cspr_msgs_py.errors.ParameterError
        If a value does not fit its parameter, or is given to a component that does not take it.
    """
    heard: dict[str, NoticedValues] = {}

    def values(node: str) -> NoticedValues:
        return heard.setdefault(node, NoticedValues(parameters.values(node)))

    gains = values("motor_control_gains")
    settings = ControlSettings(
        trajectory_settings(robot, values("trajectory_publisher")),
        gains[CONTROL_RATE.name],
        feedforward_settings(robot.number_of_cables, values("feedforward")),
        motor_gains(robot, gains),
        tuple(
            values(f"motor_controller_{number}")["setpoint_timeout"]
            for number in range(1, robot.number_of_cables + 1)
        ),
        values("pose_estimator")["rate"],
        estimator_settings(values("mass_estimator")),
        supervision_limits(robot, values("supervisor")),
    )
    # nodes each have their own of these, the components have the same
    for name in (ROBOT_CONFIG.name, CONTROL_RATE.name):
        has = [node for node in heard if name in heard[node] and "controller" not in node]
        require_same(name, {node: heard[node][name] for node in has})
    parameters.require_heard({node: noticed.names for node, noticed in heard.items()})
    return settings
