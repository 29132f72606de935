"""Pose and pull of the cables that one compiled call finds, against the functions that do the same one by one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from cspr_kinematics import CableFollower, Pose, Robot, forward_kinematics, inverse_kinematics, rope_wrench


def moving_pose(time: float) -> Pose:
    position = [0.4 * math.sin(time), 0.3 * math.cos(0.7 * time), 1.0 + 0.3 * math.sin(1.3 * time)]
    return Pose.from_euler(
        position, 0.3 * math.sin(time), 0.2 * math.cos(time) - 0.2, 0.1 * math.sin(2.0 * time)
    )


def test_it_follows_a_platform_on_cables_that_stretch_and_weigh(
    robot: Robot, rng: np.random.Generator
) -> None:
    assert robot.cables.stretch
    assert robot.cables.weigh
    follower = CableFollower(robot)
    follower.begin_at(moving_pose(0.0))
    for time in np.arange(0.0, 3.0, 0.02):
        pose = moving_pose(float(time))
        tensions = rng.uniform(100.0, 1500.0, 8)
        cables = inverse_kinematics(robot, pose)
        assert follower.follow(robot.motor_angles(cables.lengths, tensions), tensions)
        np.testing.assert_allclose(follower.position, pose.position, atol=1e-8)
        np.testing.assert_allclose(follower.rotation, pose.rotation, atol=1e-8)
        assert follower.misfit < 1e-8
        pull = cables.wrench_matrix @ tensions - rope_wrench(robot, cables)
        np.testing.assert_allclose(follower.wrench, pull, atol=1e-4)
        np.testing.assert_allclose(-follower.jacobian.T, cables.wrench_matrix, atol=1e-7)


def test_lengths_with_errors_give_the_pose_that_fits_best(robot: Robot, rng: np.random.Generator) -> None:
    tensions = np.full(8, 500.0)
    angles = rng.normal(0.0, 0.7 * robot.length_deviation / robot.winch.transmission_ratio, 8)
    follower = CableFollower(robot)
    assert follower.follow(angles, tensions)
    lengths = robot.cable_lengths(angles, tensions)
    best = forward_kinematics(robot, lengths, robot.home)
    np.testing.assert_allclose(follower.position, best.position, atol=1e-8)
    errors = inverse_kinematics(robot, best).lengths - lengths
    assert follower.misfit == pytest.approx(np.abs(errors).max(), abs=1e-8)


def test_where_no_pose_is_found_it_stays(robot: Robot) -> None:
    follower = CableFollower(robot)
    paid_out = np.where(np.arange(8) == 3, 0.5 / robot.winch.transmission_ratio, 0.0)
    assert not follower.follow(paid_out, np.full(8, 500.0))
    assert follower.misfit == math.inf
    np.testing.assert_array_equal(follower.position, robot.home.position)
    assert follower.follow(np.zeros(8), robot.home_tensions)


def test_cables_that_damp_stretch_later_than_they_pull(robot: Robot) -> None:
    """A platform that bounces at 8 Hz, as a spring and a damper in parallel tell its tensions."""
    damping, period, bounce = 0.002, 0.004, 2.0 * math.pi * 8.0
    damped = replace(robot, cables=replace(robot.cables, damping_time=np.full(8, damping)))
    lengths = inverse_kinematics(robot, robot.home).lengths
    errors = []
    for told in (period, math.inf):
        follower, error = CableFollower(damped), 0.0
        for time in np.arange(0.0, 0.5, period):
            elastic = 600.0 + np.linspace(100.0, 200.0, 8) * math.sin(bounce * time)
            rate = np.linspace(100.0, 200.0, 8) * bounce * math.cos(bounce * time)
            follower.follow(robot.motor_angles(lengths, elastic), elastic + damping * rate, told)
            if time > 10.0 * damping:
                error = max(error, float(np.abs(follower.position - robot.home.position).max()))
        errors.append(error)
    assert errors[0] < 0.1 * errors[1]
    assert errors[1] > 2e-5


def test_a_slack_cable_stretches_nothing(robot: Robot) -> None:
    follower, other = CableFollower(robot), CableFollower(robot)
    negative, none = (np.where(np.arange(8) == 2, value, 500.0) for value in (-3.0, 0.0))
    assert follower.follow(np.zeros(8), negative)
    assert other.follow(np.zeros(8), none)
    np.testing.assert_array_equal(follower.position, other.position)
