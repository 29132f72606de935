"""The settings that the parameters make, and their defaults."""

import math
from pathlib import Path

import pytest

from cspr_control.closed_loop.scenario import Scenario
from cspr_control.demo.scenario import Scenario as DemoScenario
from cspr_control.errors import ControlError, SettingError
from cspr_control.motors.feedforward import FeedforwardSettings
from cspr_control.parameters.experiment import Experiment
from cspr_control.parameters.settings import (
    NoticedValues,
    estimator_settings,
    feedforward_settings,
    motor_gains,
    supervision_limits,
    trajectory_settings,
)
from cspr_control.reference.point_to_point import MotionLimits
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
    assert limits.tension_max == (3000.0,) * 8
    trajectory = trajectory_settings(robot, file.values("trajectory_publisher"))
    assert trajectory.name is TrajectoryName.PAPER_19
    assert trajectory.limits.speed == 0.2


def test_limits_of_motion_beyond_the_motors_are_refused_with_the_bound(robot: Robot) -> None:
    """Checked by what a cable would do whose platform moves along it."""
    values = defaults("trajectory_publisher")
    for name, bound, why in (
        ("speed", 0.75, "speed_limit = 450 rad/s"),
        ("acceleration", 11.1, "torque_limit = 10 N m"),
        ("angular_speed", 3.6, "speed_limit = 450 rad/s"),
        ("angular_acceleration", 53.3, "torque_limit = 10 N m"),
    ):
        trajectory_settings(robot, values | {name: 0.99 * bound, "trajectory": "hold"})
        with pytest.raises(SettingError) as refused:
            trajectory_settings(robot, values | {name: 1.01 * bound, "trajectory": "hold"})
        assert f"it must be at most {bound:g}" in str(refused.value)
        assert why in str(refused.value)
    limits = MotionLimits.of_winches(robot)
    assert limits.speed / robot.winch.transmission_ratio == pytest.approx(robot.motor.speed_limit)
    torque = robot.motor.inertia * limits.acceleration / robot.winch.transmission_ratio
    assert torque == pytest.approx(robot.motor.torque_limit)


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


@pytest.mark.parametrize("choice", [Scenario(), DemoScenario()], ids=["simulated time", "demo"])
@pytest.mark.parametrize(
    ("node", "name", "file"),
    [
        ("can_drives", "can_config", "config/can_two_buses.yaml"),
        ("load_cells", "can_config", "other.yaml"),
        ("simulated_robot", "simulation_config", "config/mine.yaml"),
        ("/**", "can_config", "other.yaml"),
    ],
)
def test_a_simulated_run_refuses_other_files_for_the_machine(
    choice: Experiment, node: str, name: str, file: str
) -> None:
    parameters = ParameterFile(f"{node}: {{ros__parameters: {{{name}: {file}}}}}", "mine.yaml")
    with pytest.raises(SettingError, match=rf"mine\.yaml: {name} of \w+ is {file}; here it is .*--config"):
        choice.choose(parameters)
    choice.choose(ParameterFile("can_drives: {ros__parameters: {can_config: my/can.yaml}}", "mine.yaml"))


def test_no_latency_is_a_latency() -> None:
    assert Scenario(latency=0.0).reaction_time == 0.0
    assert Scenario().reaction_time > 0.0


@pytest.mark.parametrize("seed", [-1, 2**32, 10**20])
def test_a_seed_that_simulation_yaml_may_not_have_is_refused(seed: int) -> None:
    with pytest.raises(ControlError, match=r"the seed is .* \[0, 4294967295\]"):
        Scenario(seed=seed)
    Scenario(seed=2**32 - 1)
