"""Motions are checked whole before they begin; against finite differences and points along the cables."""

from dataclasses import replace

import numpy as np
import pytest

from cspr_control.errors import TrajectoryError
from cspr_control.reference.catalogue import make_trajectory
from cspr_control.reference.motion_check import require_possible
from cspr_control.reference.point_to_point import MotionLimits, PointToPoint
from cspr_kinematics import Pose, cable_lengths
from cspr_msgs_py.vocabulary import TrajectoryName

SLOW = MotionLimits(0.2, 0.3, 0.2, 0.4)
WIDE = np.array([3.0, 1.4, 3.0])  # rad


def turn(robot, *euler):
    return Pose.from_euler(robot.home.position, *euler)


def refusal(trajectory, robot, **options):
    with pytest.raises(TrajectoryError) as refused:
        require_possible(trajectory, robot, **options)
    return str(refused.value)


def nearest_points(robot, pose):
    """Return the smallest distance of two cables, by points every millimetre or so along them."""
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    anchors = pose.position + robot.anchor_points @ pose.rotation.T
    lines = [a + share * (e - a) for a, e in zip(anchors, robot.exit_points, strict=True)]
    return min(
        np.linalg.norm(first[:, None] - second[None, ::20], axis=-1).min()
        for k, first in enumerate(lines)
        for second in lines[:k]
    )


@pytest.mark.parametrize("name", list(TrajectoryName), ids=lambda name: name.value)
def test_a_batch_of_times_gives_what_each_time_gives(name, robot, settings):
    trajectory = make_trajectory(name, robot, robot.home, settings)
    times = np.linspace(-0.1, trajectory.duration + 0.1, 83)
    batch = trajectory.sample(times)
    for k, time in enumerate(times.tolist()):
        one = trajectory.sample(time)
        for whole, part in (
            (batch.pose.position, one.pose.position),
            (batch.pose.rotation, one.pose.rotation),
            (batch.twist.vector, one.twist.vector),
            (batch.acceleration.vector, one.acceleration.vector),
        ):
            np.testing.assert_allclose(whole[k], part, atol=1e-12)


def test_turning_beyond_the_bounds_is_refused_with_where_and_when(robot):
    text = refusal(PointToPoint(robot.home, turn(robot, 0.8, 0.0, 0.0), SLOW), robot)
    assert "move: at 7.50 of 7.50 s, at (0.000, 0.000, 1.000) m turned by (0.800, 0.000, 0.000) rad" in text
    assert "0.450 rad beyond the bounds of alpha, which are -0.35 to 0.35 rad" in text
    assert "up to 3.49 s" in text


def test_within_the_bounds_it_turns(robot):
    for angle in (-0.34, 0.34):
        require_possible(PointToPoint(robot.home, turn(robot, angle, 0.0, 0.0), SLOW), robot)


def test_the_shorter_way_round_counts(robot):
    """Of a home turned by almost pi, angles just beyond pi are near."""
    home = Pose.from_euler(robot.home.position, 3.1, 0.0, 0.0)
    free = replace(robot, orientation_min=None, orientation_max=None)
    turned = free.with_geometry(home=home, anchor_points=robot.anchor_points @ home.rotation)
    require_possible(PointToPoint(home, turn(robot, -3.1, 0.0, 0.0), SLOW), turned)
    assert "alpha" in refusal(PointToPoint(home, turn(robot, -2.7, 0.0, 0.0), SLOW), turned)


def test_cables_that_meet_are_refused(robot):
    free = replace(robot, orientation_min=-WIDE, orientation_max=WIDE)
    text = refusal(PointToPoint(robot.home, turn(robot, 0.8, 0.0, 0.0), SLOW), free)
    assert "and the platform pass through each other, 5 mm are needed" in text
    assert "cable_1 " in text


def test_cables_that_cross_on_the_way_are_refused(robot, rng):
    """Whatever the check lets pass keeps its clearance, by points along the cables, and some of it is refused."""
    free = replace(robot, orientation_min=-WIDE, orientation_max=WIDE, platform_size=np.full(3, 1e-3))
    refused = 0
    for _ in range(12):
        goal = Pose.from_euler(
            rng.uniform(robot.workspace_min, robot.workspace_max), *rng.uniform(-0.7, 0.7, 3)
        )
        move = PointToPoint(robot.home, goal, SLOW)
        poses = [move.sample(time).pose for time in np.linspace(0.0, move.duration, 12)]
        nearest = min(nearest_points(robot, pose) for pose in poses)
        try:
            require_possible(move, free)
        except TrajectoryError as error:
            refused += "apart" in str(error) or "through each other" in str(error)
        else:
            assert nearest > 0.5 * robot.cable_clearance
    assert refused


def test_motors_too_slow_for_a_motion_are_named_with_what_they_can(robot):
    goal = Pose(robot.home.position + np.array([0.6, 0.0, 0.0]), robot.home.rotation)
    start = Pose(robot.home.position - np.array([0.6, 0.0, 0.0]), robot.home.rotation)
    move = PointToPoint(start, goal, MotionLimits(2.0, 5.0, 0.2, 0.4))
    times = np.linspace(0.0, move.duration, 4001)
    lengths = np.array([cable_lengths(robot, move.sample(time).pose) for time in times.tolist()])
    fastest = np.abs(np.gradient(lengths, times, axis=0)).max() / robot.winch.transmission_ratio
    text = refusal(move, robot)
    assert f"would turn at {fastest:.0f} rad/s, its limit is 450 rad/s" in text
    share = robot.motor.speed_limit / fastest
    assert f"at {100.0 * share:.0f} % of its pace it would do" in text
    slower = PointToPoint(start, goal, MotionLimits(2.0 * share * 0.99, 5.0 * (share * 0.99) ** 2, 0.2, 0.4))
    require_possible(slower, robot)


def test_winches_too_heavy_for_a_motion_are_named_with_what_they_can(robot):
    weak = replace(robot, motor=replace(robot.motor, torque_limit=0.5, speed_limit=1e4))
    up = Pose(robot.home.position + np.array([0.0, 0.0, 0.3]), robot.home.rotation)
    text = refusal(PointToPoint(robot.home, up, MotionLimits(5.0, 5.0, 0.2, 0.4)), weak)
    assert "N m to accelerate its winch, beside the tension it has at most 0.4 N m" in text


def test_from_outside_it_leads_back_and_no_further_out(robot):
    outside = turn(robot, 0.5, 0.0, 0.0)
    require_possible(PointToPoint(outside, robot.home, SLOW), robot, inward=True)
    assert "begins outside" in refusal(PointToPoint(outside, robot.home, SLOW), robot)
    refusal(PointToPoint(outside, turn(robot, 0.55, 0.0, 0.0), SLOW), robot, inward=True)


def test_the_approach_is_checked_as_well(robot, settings):
    outside = Pose(robot.workspace_max + np.array([0.1, 0.0, 0.0]), np.eye(3))
    with pytest.raises(TrajectoryError, match=r"approach: at 0\.00 of .* 100 mm outside .* move leads back"):
        make_trajectory(TrajectoryName.PAPER_19, robot, outside, settings)
    fast = replace(settings, limits=MotionLimits(3.0, 9.0, 0.2, 0.4))
    far = Pose(robot.workspace_min + 0.01, np.eye(3))
    with pytest.raises(TrajectoryError, match=r"approach: .* would turn at"):
        make_trajectory(TrajectoryName.PAPER_19, robot, far, fast)
