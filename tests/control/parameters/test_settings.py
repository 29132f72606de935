"""The settings that the parameters make, and their defaults."""

import math
from pathlib import Path

import pytest

from cspr_control.motors.feedforward import FeedforwardSettings
from cspr_control.parameters.settings import (
    NoticedValues,
    estimator_settings,
    feedforward_settings,
    motor_gains,
    supervision_limits,
    trajectory_settings,
)
from cspr_kinematics import Robot, bounded_methods
from cspr_msgs_py.errors import ParameterError
from cspr_msgs_py.parameters.file import ParameterFile
from cspr_msgs_py.parameters.table import defaults, known_parameter, parameter_values
from cspr_msgs_py.vocabulary import TrajectoryName


@pytest.fixture(scope="module")
def file(robot_file: Path) -> ParameterFile:
    return ParameterFile.from_yaml(robot_file.parent / "control.yaml")


def test_the_shipped_file_makes_the_settings_that_there_are_without_it(file, robot: Robot) -> None:
    assert motor_gains(robot, file.values("motor_control_gains")) == motor_gains(
        robot, defaults("motor_control_gains")
    )
    assert estimator_settings(file.values("mass_estimator")) == estimator_settings(defaults("mass_estimator"))
    settings = feedforward_settings(8, file.values("feedforward"))
    assert settings.switch_slew == FeedforwardSettings().switch_slew == 2.0
    limits = supervision_limits(robot, file.values("supervisor"))
    assert limits == supervision_limits(robot, defaults("supervisor"))
    assert limits.tension_max == robot.tension_max
    trajectory = trajectory_settings(robot, file.values("trajectory_publisher"))
    assert trajectory.name is TrajectoryName.PAPER_19
    assert trajectory.options.limits.speed == 0.2


def test_a_setting_without_its_row_is_missed_in_words(file, robot: Robot) -> None:
    values = NoticedValues(file.values("supervisor"))
    del values["stuck_time"]
    with pytest.raises(
        ParameterError, match=r"'stuck_time': its row is missing in cspr_msgs_py.parameters.table"
    ):
        supervision_limits(robot, values)


def test_the_table_names_what_can_be_chosen() -> None:
    for node, name, words in (
        ("feedforward", "tension_method", bounded_methods(8)),
        ("trajectory_publisher", "trajectory", [name.value for name in TrajectoryName]),
    ):
        row = known_parameter(node, name)
        assert row is not None
        assert row.choices == tuple(words)


@pytest.mark.parametrize(
    ("node", "name", "value"),
    [
        ("motor_control_gains", "kp", -1.0),
        ("motor_control_gains", "kd", math.nan),
        ("motor_control_gains", "friction_compensation", 1.1),
        ("motor_control_gains", "friction_smoothing_speed", 0.0),
        ("motor_controller_1", "setpoint_timeout", 0.0),
        ("trajectory_publisher", "speed", 0.0),
        ("trajectory_publisher", "stop_time", 0.0),
        ("trajectory_publisher", "hold_duration", -1.0),
        ("feedforward", "switch_slew", 0.0),
        ("mass_estimator", "mass_rate_limit", math.inf),
        ("supervisor", "tension_min_time", -1.0),
        ("supervisor", "max_age.setpoint", 0.0),
    ],
)
def test_what_no_component_can_work_with_is_refused_by_the_table(node: str, name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=name):
        parameter_values(node, {name: value})
