"""The settings of all components of the control graph, from the values of the nodes' parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from cspr_control.components.motor import MotorSettings
from cspr_control.components.pose import PoseSettings
from cspr_control.components.trajectory import TrajectorySettings
from cspr_control.errors import TrajectoryError
from cspr_control.estimation.payload import EstimatorSettings
from cspr_control.motors.feedforward import FeedforwardSettings
from cspr_control.motors.motor_control import MotorGains
from cspr_control.parameters.file import ParameterFile
from cspr_control.parameters.tables import (
    FEEDFORWARD,
    MASS_ESTIMATOR,
    estimator_settings,
    feedforward_settings,
    parameter_values,
)
from cspr_control.reference.catalogue import TrajectoryName, TrajectoryOptions, make_trajectory
from cspr_control.reference.point_to_point import MotionLimits
from cspr_control.supervision.checks import MonitoredInput, SupervisionLimits
from cspr_kinematics import Pose, Robot


@dataclass(frozen=True)
class ControlSettings:
    """Settings of every component of the control graph; `period` is that of the control cycle, s."""

    trajectory: TrajectorySettings
    period: float = 0.004
    feedforward: FeedforwardSettings = field(default_factory=FeedforwardSettings)
    motors: MotorSettings = field(default_factory=MotorSettings)
    pose: PoseSettings = field(default_factory=PoseSettings)
    payload: EstimatorSettings = field(default_factory=EstimatorSettings)
    supervision: SupervisionLimits = field(default_factory=SupervisionLimits)


def control_settings(robot: Robot, parameters: ParameterFile) -> ControlSettings:
    """Return what a parameter file gives to the control nodes, as those would read it.

    Raises
    ------
    ControlError, cspr_kinematics.KinematicsError
        If a value does not fit its parameter.
    """
    estimator = parameter_values(MASS_ESTIMATOR, parameters.of("mass_estimator"))
    feedforward = parameter_values(FEEDFORWARD, parameters.of("feedforward"))
    motors = parameters.of("motor_control_gains")
    period = 1.0 / motors.get("control_rate", 250.0)
    return ControlSettings(
        trajectory_settings(robot, parameters.of("trajectory_publisher")),
        period,
        feedforward_settings(robot.number_of_cables, feedforward),
        MotorSettings(motor_gains(robot, period, motors), motors.get("setpoint_timeout", 0.1)),
        PoseSettings(parameters.of("pose_estimator").get("rate", 50.0)),
        estimator_settings(estimator),
        supervision_limits(robot, parameters.of("supervisor")),
    )


def motor_gains(robot: Robot, period: float, values: Mapping[str, Any]) -> MotorGains:
    """Return the gains of the motor controllers; raises SettingError where a slack motor would oscillate."""
    gains = MotorGains(**{f.name: values[f.name] for f in fields(MotorGains) if f.name in values})
    gains.require_sampled_stability(robot.motor.inertia, period)
    return gains


def trajectory_settings(robot: Robot, values: Mapping[str, Any]) -> TrajectorySettings:
    """Return the settings of the player.

    Raises
    ------
    ControlError, cspr_kinematics.KinematicsError
        If they do not fit the robot: what does not is refused now rather than at the start.
    """
    name = TrajectoryName.parse(values.get("trajectory", TrajectoryName.PAPER_19.value))
    home = robot.home
    goal = {"move_position": home.position.tolist(), "move_orientation": list(home.euler)}
    for vector in goal:
        goal[vector] = values.get(vector, goal[vector])
        if len(goal[vector]) != 3:
            raise TrajectoryError(f"{vector} has {len(goal[vector])} elements; 3 are needed")
    options = TrajectoryOptions(
        limits=MotionLimits(**{limit.name: values[limit.name] for limit in fields(MotionLimits)}),
        goal=Pose.from_euler(goal["move_position"], *goal["move_orientation"]),
        **{name: values[name] for name in ("blend_time", "hold_duration") if name in values},
    )
    make_trajectory(name, robot, home, options)
    others = {name: values[name] for name in ("dwell", "stop_time", "max_gap") if name in values}
    return TrajectorySettings(name, options, **others)


def supervision_limits(robot: Robot, values: Mapping[str, Any]) -> SupervisionLimits:
    """Return the limits of the supervisor: those of the robot, and the given ones; ages as ``max_age.setpoint``."""
    default = SupervisionLimits()
    of_robot: dict[str, Any] = {
        "tension_min": robot.tension_min,
        "tension_max": robot.tension_max,
        "motor_speed": robot.motor.speed_limit,
        "workspace_min": tuple(robot.workspace_min.tolist()),
        "workspace_max": tuple(robot.workspace_max.tolist()),
        "pay_out": robot.winch.ratio,
    }
    ages = {
        source: values.get(f"max_age.{source.name.lower()}", default.max_ages[source])
        for source in MonitoredInput
    }
    given = {
        f.name: values[f.name]
        for f in fields(SupervisionLimits)
        if f.name in values and f.name not in of_robot
    }
    return SupervisionLimits(max_ages=ages, **of_robot, **given)
