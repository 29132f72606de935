"""The search for a pose without a near guess: over whole workspaces, with pulleys, beside mirror images."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspr_kinematics import (
    ForwardKinematicsStatus,
    Pose,
    Robot,
    cable_lengths,
    forward_kinematics,
    solve_forward_kinematics,
)


def assert_same_poses(found: Pose, expected: Pose, atol: float = 1e-7) -> None:
    np.testing.assert_allclose(found.position, expected.position, atol=atol)
    np.testing.assert_allclose(found.rotation, expected.rotation, atol=atol)


def test_without_a_guess_over_the_whole_workspace(
    any_robot: Robot, workspace_grid: Callable[[Robot], Pose]
) -> None:
    pose = workspace_grid(any_robot)
    assert_same_poses(forward_kinematics(any_robot, cable_lengths(any_robot, pose)), pose)


def test_from_the_home_pose_over_the_whole_workspace(
    any_robot: Robot, workspace_grid: Callable[[Robot], Pose]
) -> None:
    pose = workspace_grid(any_robot)
    solution = solve_forward_kinematics(any_robot, cable_lengths(any_robot, pose), any_robot.home)
    assert solution.converged.all()
    assert_same_poses(solution.pose, pose)
    assert solution.iterations <= 12


@given(
    st.tuples(st.floats(-1.4, 1.4), st.floats(-0.7, 0.7), st.floats(0.3, 2.0)),
    st.tuples(*[st.floats(-0.5, 0.5)] * 3),
)
def test_forward_of_inverse_with_pulleys(
    robot_with_pulleys: Robot, position: tuple[float, ...], angles: tuple[float, float, float]
) -> None:
    pose = Pose.from_euler(position, *angles)
    found = forward_kinematics(robot_with_pulleys, cable_lengths(robot_with_pulleys, pose))
    assert_same_poses(found, pose)


@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys", "cogiro"])
def test_no_mirror_image_above_the_frame(
    name: str,
    request: pytest.FixtureRequest,
    rng: np.random.Generator,
    workspace_grid: Callable[[Robot], Pose],
) -> None:
    """Noisy lengths fit a platform mirrored at the frame as well or better; it must not be found."""
    robot: Robot = request.getfixturevalue(name)
    pose = workspace_grid(robot)
    noisy = cable_lengths(robot, pose) + 5e-3 * rng.normal(size=(125, robot.number_of_cables))
    solution = solve_forward_kinematics(robot, noisy)
    assert solution.converged.all()
    assert np.all(solution.pose.position[:, 2] < robot.exit_points[:, 2].mean())
    np.testing.assert_allclose(solution.pose.position, pose.position, atol=0.1)
    cosine = 0.5 * (np.einsum("nij,nij->n", solution.pose.rotation, pose.rotation) - 1.0)
    assert np.rad2deg(np.arccos(cosine.min())) < 20.0, "turned over"


def test_a_flat_platform_has_an_exact_mirror_image(robot: Robot, rng: np.random.Generator) -> None:
    """Anchor points in a plane make the mirror image above a flat frame fit as exactly as the pose below."""
    flat = robot.with_geometry(anchor_points=4.0 * robot.anchor_points * [1.0, 1.0, 0.0])
    pose = Pose.from_euler([0.3, -0.2, 1.2], 0.1, 0.15, -0.1)
    lengths = cable_lengths(flat, pose)
    mirror = np.diag([1.0, 1.0, -1.0])
    above = Pose(pose.position * [1.0, 1.0, -1.0] + [0.0, 0.0, 6.0], mirror @ pose.rotation @ mirror)
    np.testing.assert_allclose(cable_lengths(flat, above), lengths, atol=1e-12)
    assert_same_poses(forward_kinematics(flat, lengths), pose, atol=1e-6)
    # whoever starts above the frame is believed, whoever starts below is not carried over
    assert_same_poses(forward_kinematics(flat, lengths, above), above, atol=1e-6)


def test_passing_through_the_frame_is_reported(robot: Robot) -> None:
    """From just below the frame the nearest fit can be the mirror image; then there is no answer."""
    flat = robot.with_geometry(anchor_points=4.0 * robot.anchor_points * [1.0, 1.0, 0.0])
    pose = Pose([0.0, 0.0, 2.5], np.eye(3))
    above = Pose([0.0, 0.0, 3.5], np.eye(3))
    lengths = cable_lengths(flat, pose)
    np.testing.assert_allclose(cable_lengths(flat, above), lengths, atol=1e-12)
    statuses = set()
    for height in np.linspace(2.9, 2.999, 40):
        start = Pose.from_euler([0.05, 0.02, height], 0.2, 0.3, -0.2)
        solution = solve_forward_kinematics(flat, lengths, start)
        statuses.add(int(solution.status))
        if solution.converged:
            assert solution.pose.position[2] < 3.0
    assert statuses <= set(ForwardKinematicsStatus)
