"""Ropes that stretch, in the robot file and by themselves; motor angles and lengths under tension."""

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
    Payload,
    Pose,
    Robot,
    cable_lengths,
    holding_tensions,
)

WRONG_COUNT = "has 7 elements where 8 are needed, one for each cable"


@pytest.fixture
def mapping(robot_file: Path) -> dict[str, Any]:
    content: dict[str, Any] = yaml.safe_load(robot_file.read_text())
    return content


def test_a_cable_stretches_by_its_tension_over_its_stiffness() -> None:
    cables = CableProperties(1e6, dead_length=1.5)
    assert cables.stretched_length(3.5, 2000.0) == pytest.approx(3.5 + 5.0 * 2e-3)
    assert cables.stretched_length(3.5, 0.0) == 3.5
    assert cables.free_length(3.51, 2000.0) == pytest.approx(3.5)


def test_each_cable_may_have_its_own(mapping: dict[str, Any], rng: np.random.Generator) -> None:
    mapping["cables"] = {"axial_stiffness": [1e6 * k for k in range(1, 9)], "mass_per_metre": 0.2}
    mapping["tension_max"] = [2000.0 + k for k in range(8)]
    robot = Robot.from_mapping(mapping)
    np.testing.assert_array_equal(robot.cables.mass_per_metre, np.full(8, 0.2))
    np.testing.assert_array_equal(robot.tension_max, 2000.0 + np.arange(8))
    free, tensions = rng.uniform(2.0, 5.0, (3, 8)), rng.uniform(50.0, 3000.0, (3, 8))
    stretched = robot.cables.stretched_length(free, tensions)
    np.testing.assert_allclose((stretched - free) / free, tensions / (1e6 * np.arange(1, 9)), rtol=1e-9)
    np.testing.assert_allclose(robot.cables.free_length(stretched, tensions), free, rtol=1e-14)


def test_an_old_file_has_cables_that_neither_stretch_nor_weigh(mapping: dict[str, Any]) -> None:
    del mapping["cables"]
    robot = Robot.from_mapping(mapping)
    assert not robot.cables.stretch
    assert not robot.cables.weigh
    pose = Pose.from_euler([0.3, -0.2, 1.4], 0.1, 0.0, 0.0)
    lengths = cable_lengths(robot, pose)
    angles = (lengths - robot.winch.home_lengths) / robot.winch.transmission_ratio
    np.testing.assert_array_equal(robot.motor_angles(lengths, np.full(8, 500.0)), angles)
    np.testing.assert_allclose(robot.cable_lengths(angles, np.full(8, 500.0)), lengths, rtol=1e-14)


@pytest.mark.parametrize(
    ("cables", "key", "reason"),
    [
        ({"axial_stiffness": 0.0}, "cables.axial_stiffness", r"must lie in \[1, 1e\+12\]"),
        ({"axial_stiffness": [1e6] * 7}, "cables.axial_stiffness", WRONG_COUNT),
        ({"axial_stiffness": float("inf")}, "cables.axial_stiffness", "finite"),
        ({"axial_stiffness": 1e6, "mass_per_metre": -0.1}, "cables.mass_per_metre", "must lie in"),
        ({"axial_stiffness": 1e6, "youngs_modulus": 1.0}, "cables.youngs_modulus", "unknown key"),
        ({}, "cables.axial_stiffness", "is missing"),
        (1.2e6, "cables", "must be a mapping"),
    ],
)
def test_wrong_cables_in_the_file(mapping: dict[str, Any], cables: Any, key: str, reason: str) -> None:
    mapping["cables"] = cables
    with pytest.raises(ConfigurationFileError, match=reason) as caught:
        Robot.from_mapping(mapping)
    assert caught.value.key == key


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ((0.0,), "axial_stiffness"),
        ((np.nan,), "axial_stiffness"),
        ((np.ones((2, 2)),), "axial_stiffness"),
        ((1e6, -1.0), "damping_time"),
        ((1e6, 0.0, np.inf), "dead_length"),
        ((1e6, 0.0, 0.0, np.ones((2, 2))), "mass_per_metre"),
    ],
)
def test_what_is_no_cable_is_refused(arguments: tuple[Any, ...], name: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        CableProperties(*arguments)
    assert caught.value.name == name


@pytest.mark.parametrize(
    ("limits", "key", "reason"),
    [
        ({"tension_min": [50.0] * 7}, "tension_min", WRONG_COUNT),
        ({"tension_max": [3000.0] * 7}, "tension_max", WRONG_COUNT),
        ({"tension_min": [50.0] * 7 + [3000.0]}, "tension_min", "must be below tension_max"),
        ({"home_tensions": [300.0] * 7}, "home_tensions", WRONG_COUNT),
        ({"home_tensions": 300.0}, "home_tensions", "must be a list"),
        ({"home_tensions": {"cable_1": 300.0}}, "home_tensions", "must be a list"),
        ({"home_tensions": [300.0] * 7 + [-1.0]}, "home_tensions[7]", "must lie in"),
        (
            {"home_tensions": [300.0] * 7 + [0.0]},
            "home_tensions[7]",
            "must be positive: .*; set the home pose again",
        ),
        (
            {"tension_max": [3000.0] * 7 + [250.0], "home_tensions": [300.0] * 8},
            "home_tensions[7]",
            "is above tension_max = 250 of this cable; set the home pose again",
        ),
    ],
)
def test_wrong_tensions_in_the_file(
    mapping: dict[str, Any], limits: dict[str, Any], key: str, reason: str
) -> None:
    with pytest.raises(ConfigurationFileError, match=reason) as caught:
        Robot.from_mapping(mapping | limits)
    assert caught.value.key == key


def test_the_zero_of_the_motors_is_that_of_the_empty_platform_unless_its_tensions_were_measured(
    mapping: dict[str, Any],
) -> None:
    robot = Robot.from_mapping(mapping)
    np.testing.assert_array_equal(robot.home_tensions, holding_tensions(robot, robot.home).tensions)
    np.testing.assert_allclose(robot.motor_angles(robot.winch.home_lengths), 0.0, atol=1e-12)
    loaded = holding_tensions(robot, robot.home, Payload(200.0, np.zeros(3))).tensions
    homed_loaded = Robot.from_mapping(mapping | {"home_tensions": loaded.tolist()})
    np.testing.assert_array_equal(homed_loaded.home_tensions, loaded)
    np.testing.assert_allclose(homed_loaded.motor_angles(robot.winch.home_lengths, loaded), 0.0, atol=1e-12)
    # the empty robot must wind in by the stretch of the load to stay at home
    by_hand = (loaded - robot.home_tensions) / 1.2e6 * (robot.winch.home_lengths + 1.5)
    wound_in = -robot.winch.transmission_ratio * robot.motor_angles(robot.winch.home_lengths, loaded)
    np.testing.assert_allclose(wound_in, by_hand, rtol=2e-3)
    assert wound_in.max() > 1e-3


def test_angles_and_lengths_are_inverses_under_tension(robot: Robot, rng: np.random.Generator) -> None:
    angles, tensions = rng.uniform(-500.0, 500.0, (4, 8)), rng.uniform(0.0, 3000.0, (4, 8))
    lengths = robot.cable_lengths(angles, tensions)
    np.testing.assert_allclose(robot.motor_angles(lengths, tensions), angles, atol=1e-9)
    slope = robot.cable_lengths(angles, tensions + 1.0) - lengths
    np.testing.assert_allclose(slope, (robot.home_free_lengths + angles / 600.0 + 1.5) / 1.2e6, rtol=1e-6)


def test_another_home_pose_has_no_measured_tensions(robot: Robot) -> None:
    measured = dataclasses.replace(robot, measured_home_tensions=np.full(8, 400.0))
    assert measured.with_geometry(exit_points=robot.exit_points + 1e-3).measured_home_tensions is not None
    assert measured.with_geometry(home=Pose([0.1, 0.0, 1.1], np.eye(3))).measured_home_tensions is None
