"""The shipped robot file, and every way in which such a file can be wrong."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cspr_kinematics import ConfigurationFileError, InvalidInputError, KinematicsError, Pose, Robot

MISSING = object()
POINTS = np.arange(24.0).reshape(8, 3).tolist()


@pytest.fixture
def mapping(robot_file: Path) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(robot_file.read_text())
    return content


@pytest.fixture
def write(mapping: dict[str, Any], tmp_path: Path) -> Callable[[str, Any], Path]:
    """Write the shipped file with one key, given by its dotted path, changed, added or (MISSING) removed."""

    def change(key: str, value: Any) -> Path:
        content = copy.deepcopy(mapping)
        *sections, last = key.split(".")
        inner = content
        for section in sections:
            inner = inner[section]
        if value is MISSING:
            del inner[last]
        else:
            inner[last] = value
        path = tmp_path / "changed.yaml"
        path.write_text(yaml.safe_dump(content))
        return path

    return change


def test_prototype(robot: Robot) -> None:
    assert robot.number_of_cables == 8
    assert robot.platform.mass == 153.0
    assert (robot.tension_min.tolist(), robot.tension_max.tolist()) == ([50.0] * 8, [3000.0] * 8)
    assert robot.winch.transmission_ratio == pytest.approx(0.05 / 30.0)
    np.testing.assert_array_equal(robot.home.position, [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(robot.home.rotation, np.eye(3))
    np.testing.assert_array_equal(robot.exit_points.max(axis=0), robot.frame_size / [2.0, 2.0, 1.0])
    np.testing.assert_array_equal(np.abs(robot.anchor_points).max(axis=0), robot.platform_size / 2.0)


def test_prototype_platform_is_a_homogeneous_box(robot: Robot) -> None:
    squares = robot.platform_size**2
    expected = robot.platform.mass / 12.0 * (squares.sum() - squares)
    np.testing.assert_allclose(robot.platform.inertia, np.diag(expected), atol=5e-6)


def test_motor_holds_the_largest_tension(robot: Robot) -> None:
    holding = -robot.winch.motor_torque(robot.tension_max).min()
    assert holding + robot.motor.coulomb_friction < robot.motor.torque_limit


def test_a_mapping_is_as_good_as_a_file(robot: Robot, mapping: dict[str, Any]) -> None:
    same = Robot.from_mapping(mapping)
    np.testing.assert_array_equal(same.winch.home_lengths, robot.winch.home_lengths)


@pytest.mark.parametrize(
    "key", ["name", "home", "home.euler", "platform.mass", "motor.inertia", "tension_min"]
)
def test_missing_key(write: Callable[[str, Any], Path], key: str) -> None:
    assert_refused(write(key, MISSING), key, "is missing", None)


@pytest.mark.parametrize("key", ["tension_typical", "platform.weight", "winch.home_lengths"])
def test_unknown_key(write: Callable[[str, Any], Path], key: str) -> None:
    assert_refused(write(key, 7.0), key, "unknown key", 7.0)


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("exit_points", POINTS[:5], "at least 6"),
        ("exit_points", [], "at least one"),
        ("exit_points", 3.0, "must be a list"),
        ("anchor_points", POINTS[:7], "has 7 elements where 8 are needed, one for each cable"),
        ("frame_size", [5.0, 3.0], "2 elements where 3"),
        ("frame_size", [5.0, 0.0, 3.0], "must be positive"),
        ("platform_size", [0.2, -0.2, 0.2], "must be positive"),
        ("platform", [153.0], "must be a mapping"),
        ("platform.mass", -153.0, "must lie in [0.001, 1e+06]"),
        ("platform.mass", 0, "must lie in [0.001, 1e+06]"),
        ("platform.mass", "153", "must be a finite number; without quotes"),
        ("platform.mass", True, "must be a finite number"),
        ("platform.mass", None, "must be a finite number"),
        ("platform.inertia", [[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "not symmetric"),
        ("platform.inertia", np.diag([1.0, 1.0, -1.0]).tolist(), "not all positive"),
        ("platform.inertia", np.diag([1.0, 1.0, 3.0]).tolist(), "add up to less than the third"),
        ("winch.drum_radius", 0.0, "must lie in [0.001, 10]"),
        ("winch.gear_ratio", -30.0, "must lie in [0.01, 10000]"),
        ("winch.gear_ratio", 1e300, "must lie in [0.01, 10000]"),
        ("motor.inertia", 0.0, "must lie in [1e-09, 1000]"),
        ("motor.torque_limit", -1.0, "must lie in [0.001, 1e+06]"),
        ("platform.mass", 1e9, "must lie in [0.001, 1e+06]"),
        ("pulleys.radius", 5.0, "cable 1 has no length at home; "),
        ("motor.speed_limit", float("inf"), "finite"),
        ("motor.viscous_friction", -1.0, "must lie in [0, 1000]"),
        ("tension_min", 3000.0, "must be below tension_max"),
        ("tension_min", -1.0, "must lie in [0, 1e+07]"),
        ("tension_max", float("nan"), "finite"),
        pytest.param("tension_max", 10**400, "finite", id="tension_max-10^400"),
        ("home.euler", [0.0, 0.0], "2 elements where 3"),
        ("workspace_min", [2.0, -0.7, 0.3], "must be below workspace_max"),
        ("orientation_min", [0.5, -0.35, -0.35], "must be below orientation_max"),
        ("orientation_max", [0.5, 1.6, 0.35], "within pi / 2 of level"),
        ("cable_clearance", -0.01, "must lie in [0, 1]"),
        ("trajectory_center", [0.0, 0.0, 5.0], "outside workspace"),
        ("name", 8, "non-empty text"),
        ("name", " ", "non-empty text"),
    ],
)
def test_wrong_value(write: Callable[[str, Any], Path], key: str, value: Any, reason: str) -> None:
    assert_refused(write(key, value), key, reason, value)


def test_the_element_of_a_list_is_named(write: Callable[[str, Any], Path]) -> None:
    points = copy.deepcopy(POINTS)
    points[3][1] = float("nan")
    assert_refused(write("exit_points", points), "exit_points[3][1]", "finite", None)
    points[3][1] = 1e6
    assert_refused(write("exit_points", points), "exit_points[3][1]", "must lie in [-1000, 1000]", 1e6)
    points[3] = [1.0, 2.0]
    assert_refused(write("exit_points", points), "exit_points[3]", "2 elements where 3", [1.0, 2.0])


def test_home_outside_the_workspace_or_at_an_exit_point(
    write: Callable[[str, Any], Path], robot: Robot
) -> None:
    assert_refused(write("home.position", [0.0, 0.0, 2.9]), "home", "outside workspace", None)
    touching = (robot.exit_points[4] - robot.anchor_points[4]).tolist()
    assert_refused(write("home.position", touching), "home", "cable 5 has no length", None)


def test_bounds_of_the_orientation(write: Callable[[str, Any], Path], robot: Robot) -> None:
    assert_refused(write("orientation_min", [0.1, -0.35, -0.35]), "home", "outside orientation_min", None)
    assert_refused(write("orientation_max", None), "orientation_min", "or neither", None)
    free = dataclasses.replace(robot, orientation_min=None, orientation_max=None)
    np.testing.assert_array_equal(free.orientation_bounds, np.add.outer([-0.35, 0.35], robot.home.euler))


@pytest.mark.parametrize(
    "text",
    [
        "exit_points: [1, 2",
        "\t- a",
        "\x00",
        "a: b: c",
        "name: !!timestamp 2001-99-99",
        "mass: !!int 0b_",
        pytest.param("mass: 1" + "0" * 5000, id="digits"),
        pytest.param("[" * 1000, id="brackets"),
    ],
)
def test_what_is_not_yaml(tmp_path: Path, text: str) -> None:
    path = tmp_path / "broken.yaml"
    path.write_text(text)
    with pytest.raises(ConfigurationFileError, match="not valid YAML") as caught:
        Robot.from_yaml(path)
    assert caught.value.source == str(path)


def test_a_key_that_stands_there_twice(robot_file: Path, tmp_path: Path) -> None:
    path = tmp_path / "twice.yaml"
    path.write_text(robot_file.read_text() + "tension_max: 9000.0\n")
    with pytest.raises(ConfigurationFileError, match=r'found duplicate key "tension_max" .*line \d+'):
        Robot.from_yaml(path)


@pytest.mark.parametrize("text", ["", "just words", "- a\n- b\n"])
def test_yaml_that_is_no_robot(tmp_path: Path, text: str) -> None:
    path = tmp_path / "other.yaml"
    path.write_text(text)
    with pytest.raises(ConfigurationFileError, match=r"must be a mapping of keys to values; use --robot"):
        Robot.from_yaml(path, "use --robot")


def test_bytes_that_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "binary.yaml"
    path.write_bytes(b"\xff\xfe\x00\xd8")
    with pytest.raises(ConfigurationFileError, match="not valid YAML"):
        Robot.from_yaml(path)


def test_a_missing_file_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationFileError, match=r"; use --robot$") as caught:
        Robot.from_yaml(tmp_path / "none.yaml", "use --robot")
    assert "none.yaml" in str(caught.value)
    with pytest.raises(ConfigurationFileError, match="cannot be read"):
        Robot.from_yaml(tmp_path)


def test_a_home_pose_that_the_winch_does_not_know_is_refused(robot: Robot) -> None:
    moved = Pose([0.1, 0.0, 1.0], np.eye(3))
    with pytest.raises(InvalidInputError, match="home_lengths must be the cable lengths at home"):
        dataclasses.replace(robot, home=moved)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("exit_points", np.zeros(3)),
        ("frame_size", np.ones((2, 3))),
        ("workspace_max", [0.0, 0.0, np.nan]),
        ("tension_max", np.inf),
        ("home", Pose(np.zeros((2, 3)), np.eye(3))),
    ],
)
def test_the_constructor_checks_too(robot: Robot, field: str, value: Any) -> None:
    with pytest.raises(InvalidInputError, match=field):
        dataclasses.replace(robot, **{field: value})


def test_robot_cannot_be_changed(robot: Robot) -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        robot.tension_max = 1.0  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        robot.exit_points[0, 0] = 1.0


def assert_refused(path: Path, key: str, reason: str, value: Any) -> None:
    with pytest.raises(ConfigurationFileError) as caught:
        Robot.from_yaml(path)
    error = caught.value
    assert isinstance(error, KinematicsError)
    assert error.source == str(path)
    assert error.key == key
    assert reason in error.reason
    assert str(error).startswith(f"{path}: {key}")
    if value is not None:
        np.testing.assert_array_equal(np.asarray(error.value), np.asarray(value))
        assert " = " in str(error)
