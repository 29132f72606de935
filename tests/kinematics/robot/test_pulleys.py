"""Pulleys, in the robot file and by themselves."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from cspr_kinematics import (
    CableProperties,
    ConfigurationFileError,
    InvalidInputError,
    Pulleys,
    Robot,
    Winch,
)

UP = (0.0, 0.0, 1.0)


def test_the_two_shipped_files_differ_by_their_pulleys(robot_file: Path, robot_with_pulleys: Robot) -> None:
    plain, other = (
        yaml.safe_load(path.read_text()) for path in (robot_file, robot_file.with_name("robot_pulleys.yaml"))
    )
    assert plain.pop("name") != other.pop("name")
    assert plain.pop("pulleys")["radius"] == 0.0
    assert other.pop("pulleys")["radius"] == 0.05
    assert plain == other
    np.testing.assert_array_equal(robot_with_pulleys.path_geometry[:, 6], 0.05)
    np.testing.assert_array_equal(robot_with_pulleys.path_geometry[:, 7:], np.tile(UP, (8, 1)))


@pytest.mark.parametrize(
    ("pulleys", "key", "reason"),
    [
        ({"radius": -0.05}, "pulleys.radius", r"must lie in \[0, 10\]"),
        ({"radius": [0.05] * 7}, "pulleys.radius", "has 7 elements where 8 are needed, one for each cable"),
        ({"radius": float("nan")}, "pulleys.radius", "finite"),
        ({"radius": "big"}, "pulleys.radius", "must be a finite number"),
        ({"radius": 0.05, "swivel_axis": [0.0, 0.0, 0.0]}, "pulleys.swivel_axis", "no direction"),
        (
            {"radius": 0.05, "swivel_axis": [0.0, 1.0]},
            "pulleys.swivel_axis",
            r"shape \(2,\) where \(..., 3\)",
        ),
        (
            {"radius": 0.05, "swivel_axis": [[0.0, 0.0, 1.0]] * 6},
            "pulleys.swivel_axis",
            "has 6 elements where 8 are needed, one for each cable",
        ),
        ({"radius": 0.05, "axis": UP}, "pulleys.axis", "unknown key"),
        ({}, "pulleys.radius", "is missing"),
        (0.05, "pulleys", "must be a mapping"),
    ],
)
def test_wrong_pulleys_in_the_file(robot_file: Path, pulleys: Any, key: str, reason: str) -> None:
    mapping = yaml.safe_load(robot_file.read_text())
    mapping["pulleys"] = pulleys
    with pytest.raises(ConfigurationFileError, match=reason) as caught:
        Robot.from_mapping(mapping)
    assert caught.value.key == key


def test_pulleys_are_optional_in_the_file(robot_file: Path, robot: Robot) -> None:
    mapping = yaml.safe_load(robot_file.read_text())
    del mapping["pulleys"]
    np.testing.assert_array_equal(Robot.from_mapping(mapping).path_geometry, robot.path_geometry)


def test_each_cable_may_have_its_own(robot: Robot) -> None:
    radii = np.linspace(0.0, 0.07, 8)
    axes = np.tile([0.0, 0.0, 2.0], (8, 1))
    mixed = robot.with_geometry(pulleys=Pulleys(radii, axes))
    np.testing.assert_array_equal(mixed.path_geometry[:, 6], radii)
    np.testing.assert_array_equal(mixed.path_geometry[:, 9], 1.0)
    with pytest.raises(InvalidInputError, match="has 7 elements where 8 are needed, one for each cable"):
        robot.with_geometry(pulleys=Pulleys(radii[1:]))
    six = list(range(6))
    winch = Winch(0.05, 30.0, robot.winch.home_lengths[six])
    fewer = dataclasses.replace(
        robot,
        exit_points=robot.exit_points[six],
        anchor_points=robot.anchor_points[six],
        winch=winch,
        tension_min=robot.tension_min[six],
        tension_max=robot.tension_max[six],
        cables=CableProperties(),
    )
    assert fewer.path_geometry.shape == (6, 10)


@pytest.mark.parametrize("length", [1e-320, 1e-200, 1e200, 1e308])
def test_the_length_of_an_axis_does_not_matter(length: float) -> None:
    np.testing.assert_allclose(
        Pulleys(0.05, [0.0, -length, length]).swivel_axis, [0.0, -np.sqrt(0.5), np.sqrt(0.5)]
    )


@pytest.mark.parametrize(
    ("radius", "axis", "name"),
    [
        (-1.0, UP, "radius"),
        (np.nan, UP, "radius"),
        (np.ones((2, 2)), UP, "radius"),
        (0.1, (0.0, 0.0), "swivel_axis"),
        (0.1, (0.0, 0.0, 0.0), "swivel_axis"),
        (0.1, np.ones((2, 2, 3)), "swivel_axis"),
    ],
)
def test_what_is_no_pulley_is_refused(radius: Any, axis: Any, name: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        Pulleys(radius, axis)
    assert caught.value.name == name
