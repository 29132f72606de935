"""The search for a pose without a near guess: over whole workspaces, with pulleys, beside mirror images."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspr_kinematics import (
    ForwardKinematicsError,
    ForwardKinematicsStatus,
    Pose,
    Robot,
    cable_lengths,
    forward_kinematics,
    solve_forward_kinematics,
)
from cspr_kinematics.arrays import FloatArray


def assert_same_poses(found: Pose, expected: Pose, atol: float = 1e-7) -> None:
    np.testing.assert_allclose(found.position, expected.position, atol=atol)
    np.testing.assert_allclose(found.rotation, expected.rotation, atol=atol)


def angle_between(one: Pose, other: Pose) -> FloatArray:
    trace = np.einsum("...ij,...ij->...", one.rotation, other.rotation)
    return np.asarray(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)))


def test_without_a_guess_over_the_whole_workspace(
    any_robot: Robot, workspace_grid: Callable[[Robot], Pose]
) -> None:
    pose = workspace_grid(any_robot)
    solution = solve_forward_kinematics(any_robot, cable_lengths(any_robot, pose), length_deviation=1e-6)
    assert_same_poses(solution.pose, pose, atol=1e-6)
    # six lengths fit other poses as exactly, more lengths do not
    known = any_robot.number_of_cables > 6
    expected = ForwardKinematicsStatus.CONVERGED if known else ForwardKinematicsStatus.AMBIGUOUS
    assert (solution.status == expected).mean() > 0.95
    assert known == np.isnan(solution.alternative.position).all()


def test_from_the_home_pose_over_the_whole_workspace(
    any_robot: Robot, workspace_grid: Callable[[Robot], Pose]
) -> None:
    pose = workspace_grid(any_robot)
    solution = solve_forward_kinematics(any_robot, cable_lengths(any_robot, pose), any_robot.home)
    assert solution.converged.all()
    assert_same_poses(solution.pose, pose)
    if any_robot.name != "ten_cables":  # which has to start anew where it ends turned over
        assert solution.iterations <= 12


@given(
    st.tuples(st.floats(-1.4, 1.4), st.floats(-0.7, 0.7), st.floats(0.3, 2.0)),
    st.tuples(*[st.floats(-0.5, 0.5)] * 3),
)
def test_forward_of_inverse_with_pulleys(
    robot_with_pulleys: Robot, position: tuple[float, ...], angles: tuple[float, float, float]
) -> None:
    pose = Pose.from_euler(position, *angles)
    # where the platform is nearly singular, tenths of a millimetre would fit a neighbour too
    found = forward_kinematics(
        robot_with_pulleys, cable_lengths(robot_with_pulleys, pose), length_deviation=1e-6
    )
    assert_same_poses(found, pose, atol=1e-6)


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
    solution = solve_forward_kinematics(robot, noisy, length_deviation=5e-3)
    one, several = ForwardKinematicsStatus.CONVERGED, ForwardKinematicsStatus.AMBIGUOUS
    found = np.isin(solution.status, [one, several])
    assert (
        found.mean() > 0.97
    )  # the valley of so much noise may be too flat for the iteration, which then says so
    position, rotation = solution.pose.position[found], solution.pose.rotation[found]
    assert np.all(position[:, 2] < robot.exit_points[:, 2].mean())
    np.testing.assert_allclose(position, pose.position[found], atol=0.1)
    cosine = 0.5 * (np.einsum("nij,nij->n", rotation, pose.rotation[found]) - 1.0)
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


def test_no_wrong_pose_is_believed(
    any_robot: Robot, rng: np.random.Generator, workspace_grid: Callable[[Robot], Pose]
) -> None:
    """From home, where most iterations of the small robot's exact lengths used to end turned over."""
    pose, deviation = workspace_grid(any_robot), any_robot.length_deviation
    shape = *pose.batch_shape, any_robot.number_of_cables
    for noise in (0.0, 0.3 * deviation, deviation):
        lengths = cable_lengths(any_robot, pose) + noise * rng.normal(size=shape)
        solution = solve_forward_kinematics(any_robot, lengths, any_robot.home)
        assert solution.converged.all()
        assert angle_between(solution.pose, pose).max() < np.deg2rad(3.0)


def test_rounding_of_long_cables_does_not_stall_the_iteration(cogiro: Robot) -> None:
    """At the minimum the costs of neighbours differ by less than cables of 10 m are rounded."""
    pose = Pose([-5.0, -4.0, 1.0], np.eye(3))
    noise = cogiro.length_deviation * np.random.default_rng(1).normal(size=(5000, cogiro.number_of_cables))
    solution = solve_forward_kinematics(cogiro, cable_lengths(cogiro, pose) + noise, cogiro.home)
    assert solution.converged.all()
    assert solution.iterations < 20


def test_a_guess_on_another_branch_is_not_believed(robot: Robot, rng: np.random.Generator) -> None:
    """From anywhere: what converges is the true pose, or as near to the guess as a moving platform to its last pose."""
    pose = Pose.from_euler([0.5, -0.2, 1.2], 0.1, -0.1, 0.2)
    lengths = np.broadcast_to(cable_lengths(robot, pose), (300, 8))
    turned = Rotation.random(300, random_state=np.random.RandomState(rng.integers(2**31))).as_matrix()
    solution = solve_forward_kinematics(robot, lengths, Pose(np.tile(pose.position, (300, 1)), turned))
    assert 20 < solution.converged.sum() < 300
    assert angle_between(solution.pose, pose)[solution.converged].max() < 1e-6


def test_several_poses_are_named(six_cables: Robot) -> None:
    lengths = six_cables.winch.home_lengths
    solution = solve_forward_kinematics(six_cables, lengths)
    assert solution.status == ForwardKinematicsStatus.AMBIGUOUS
    assert not solution.converged
    np.testing.assert_allclose(cable_lengths(six_cables, solution.alternative), lengths, atol=1e-6)
    with pytest.raises(
        ForwardKinematicsError, match=r"turned from it by .* degrees, fit about as well"
    ) as caught:
        forward_kinematics(six_cables, lengths)
    assert not caught.value.converged
    assert_same_poses(forward_kinematics(six_cables, lengths, six_cables.home), six_cables.home)
