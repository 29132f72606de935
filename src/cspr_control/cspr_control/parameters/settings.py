"""The settings of the control graph, from the values of the nodes' parameters by name.

Nodes give the values that they declare, a re-run or a simulated loop those of a parameter file: see
`cspr_msgs_py.parameters.file.ParameterFile.values`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from types import MappingProxyType
from typing import Any, TypeVar

from cspr_control.errors import SettingError, TrajectoryError
from cspr_control.estimation.cell_monitor import CellMonitorSettings
from cspr_control.estimation.motion_filter import MotionSettings
from cspr_control.estimation.payload import EstimatorSettings
from cspr_control.estimation.static_filter import StaticSettings
from cspr_control.motors.feedforward import FeedforwardSettings, checked_payload
from cspr_control.motors.motor_control import MotorGains
from cspr_control.motors.swing_damping import SwingSettings
from cspr_control.reference.catalogue import TrajectorySettings, make_trajectory
from cspr_control.reference.point_to_point import MotionLimits
from cspr_control.supervision.balance_check import BalanceSettings
from cspr_control.supervision.checks import MonitoredInput, SupervisionLimits
from cspr_control.supervision.limit_bounds import require_bounded
from cspr_kinematics import Pose, Robot, bounded_methods
from cspr_msgs_py.parameters.table import ALL_NODES, ParameterValues
from cspr_msgs_py.vocabulary import FeedforwardModel, PayloadMethod, PayloadSource, TrajectoryName

Settings = TypeVar("Settings")

_OF_STATIC = ("time_constant", "max_speed", "max_angular_speed", "max_sideways_ratio")


def require_same(name: str, values: Mapping[str, Any]) -> None:
    """Refuse values of a parameter, by node, that differ though the components share it; raises SettingError."""
    first, *others = values
    for node in others:
        if values[node] != values[first]:
            raise SettingError(
                f"{name} of {node} is {values[node]}, of {first} {values[first]}; "
                f"it must be the same for all nodes of one graph: set it under {ALL_NODES}"
            )


class NoticedValues(ParameterValues):
    """Values by name that notice, in `names`, which of them are taken."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        super().__init__(values)
        self.names: set[str] = set()

    def __getitem__(self, name: str) -> Any:
        self.names.add(name)
        return super().__getitem__(name)


def motor_gains(robot: Robot, values: Mapping[str, Any]) -> MotorGains:
    """Return the gains of the motor controllers; raises SettingError, also if kd is too large for the motor."""
    gains = _of(MotorGains, values)
    gains.require_sampled_stability(robot.motor.inertia, 1.0 / values["control_rate"])
    return gains


def estimator_settings(values: Mapping[str, Any]) -> EstimatorSettings:
    """Return the settings of the payload estimator; raises SettingError."""
    own = {name: values[f"static.{name}"] for name in _OF_STATIC}
    converted = {
        "method": PayloadMethod(values["method"]),
        "motion": _of(MotionSettings, values),
        "static": _of(StaticSettings, values, own),
        "cells": _of(CellMonitorSettings, values),
    }
    return _of(EstimatorSettings, values, converted)


def feedforward_settings(number_of_cables: int, values: Mapping[str, Any]) -> FeedforwardSettings:
    """Return the settings of the feed-forward of a robot; raises SettingError or PayloadError."""
    methods = bounded_methods(number_of_cables)
    if values["tension_method"] not in methods:
        raise SettingError(
            f"tension_method is {values['tension_method']!r}; for this robot there are {', '.join(methods)}"
        )
    mass, center = values["nominal_payload_mass"], values["nominal_payload_center"]
    converted = {
        "model": FeedforwardModel(values["model"]),
        "payload_source": PayloadSource(values["payload_source"]),
        "nominal_payload": checked_payload("nominal payload", mass, center, values["max_payload"]),
        "swing": SwingSettings.of(values),
    }
    return _of(FeedforwardSettings, values, converted)


def trajectory_settings(robot: Robot, values: Mapping[str, Any]) -> TrajectorySettings:
    """Return the settings of the player.

    Raises
    ------
    ControlError, cspr_kinematics.KinematicsError
        If they do not fit the robot: what does not is refused now rather than at the start.
    """
    home = {"move_position": robot.home.position, "move_orientation": robot.home.euler}
    goal = home | {vector: values[vector] for vector in home if vector in values}
    for vector, elements in goal.items():
        if len(elements) != 3:
            raise TrajectoryError(f"{vector} has {len(elements)} elements; 3 are needed")
    limits = _of(MotionLimits, values)
    limits.require_possible(robot)
    converted = {
        "name": TrajectoryName(values["trajectory"]),
        "limits": limits,
        "goal": Pose.from_euler(goal["move_position"], *goal["move_orientation"]),
    }
    settings = _of(TrajectorySettings, values, converted)
    make_trajectory(settings.name, robot, robot.home, settings)
    return settings


def supervision_limits(robot: Robot, values: Mapping[str, Any]) -> SupervisionLimits:
    """Return the limits of the supervisor of a robot; raises SettingError, also if one costs too much height."""
    of_robot = {
        "max_ages": {source: values[f"max_age.{source.name.lower()}"] for source in MonitoredInput},
        "length_misfit": robot.length_deviation,
        "tension_min": tuple(robot.tension_min.tolist()),
        "tension_max": tuple(robot.tension_max.tolist()),
        "motor_speed": robot.motor.speed_limit,
        "workspace_min": tuple(robot.workspace_min.tolist()),
        "workspace_max": tuple(robot.workspace_max.tolist()),
        "transmission_ratio": robot.winch.transmission_ratio,
        "motor_inertia": robot.motor.inertia,
        "motor_torque": robot.motor.torque_limit,
        "balance": _of(BalanceSettings, values),
    }
    given = {name: values[name] for name in of_robot if name in values}
    limits = _of(SupervisionLimits, values, of_robot | given)
    require_bounded(limits)
    return limits


def _of(
    kind: type[Settings], values: Mapping[str, Any], instead: Mapping[str, Any] = MappingProxyType({})
) -> Settings:
    """Return the settings whose fields are named as the parameters are, but for those that are given otherwise."""
    names = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    return kind(**{name: instead[name] if name in instead else values[name] for name in names})
