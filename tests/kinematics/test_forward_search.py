"""Forward kinematics over whole workspaces, with pulleys, without a guess; slack cables; covariance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspr_kinematics import (
    ForwardKinematicsError,
    ForwardKinematicsStatus,
    InvalidInputError,
    Pose,
    Robot,
    SingularWrenchMatrixError,
    cable_lengths,
    forward_kinematics,
    inverse_kinematics,
    pose_covariance,
    solve_forward_kinematics,
)
from cspr_kinematics.motion.so3 import rotation_from_vector

ANGLE = 0.35


def workspace_grid(robot: Robot, tilts: np.random.Generator) -> Pose:
    """All of the workspace, its corners included, with a random orientation at each point."""
    axes = [np.linspace(a, b, 5) for a, b in zip(robot.workspace_min, robot.workspace_max, strict=True)]
    position = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    return Pose.from_euler(position, *tilts.uniform(-ANGLE, ANGLE, (3, len(position))))


def assert_same_poses(found: Pose, expected: Pose, atol: float = 1e-7) -> None:
    np.testing.assert_allclose(found.position, expected.position, atol=atol)
    np.testing.assert_allclose(found.rotation, expected.rotation, atol=atol)


def test_without_a_guess_over_the_whole_workspace(any_robot: Robot, rng: np.random.Generator) -> None:
    pose = workspace_grid(any_robot, rng)
    assert_same_poses(forward_kinematics(any_robot, cable_lengths(any_robot, pose)), pose)


def test_from_the_home_pose_over_the_whole_workspace(any_robot: Robot, rng: np.random.Generator) -> None:
    pose = workspace_grid(any_robot, rng)
    solution = solve_forward_kinematics(any_robot, cable_lengths(any_robot, pose), any_robot.home)
    assert solution.converged.all()
    assert_same_poses(solution.pose, pose)
    assert solution.iterations <= 12


@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys"])
def test_iterations_that_the_documentation_states(
    name: str, request: pytest.FixtureRequest, rng: np.random.Generator
) -> None:
    robot: Robot = request.getfixturevalue(name)
    pose = workspace_grid(robot, rng)
    lengths = cable_lengths(robot, pose)
    offset = 0.01 * rng.uniform(-1.0, 1.0, (125, 3)) / np.sqrt(3.0)
    turn = np.deg2rad(1.0) * rng.uniform(-1.0, 1.0, (125, 3)) / np.sqrt(3.0)
    near = Pose(pose.position + offset, rotation_from_vector(turn) @ pose.rotation)
    assert solve_forward_kinematics(robot, lengths, near).iterations <= 3
    assert solve_forward_kinematics(robot, lengths, robot.home).iterations <= 8


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
    name: str, request: pytest.FixtureRequest, rng: np.random.Generator
) -> None:
    """Noisy lengths fit a platform mirrored at the frame as well or better; it must not be found."""
    robot: Robot = request.getfixturevalue(name)
    pose = workspace_grid(robot, rng)
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


def test_batches_without_a_guess_and_on_threads_equal_loops(
    robot_with_pulleys: Robot, random_pose: Callable[..., Pose]
) -> None:
    lengths = cable_lengths(robot_with_pulleys, random_pose(3, 5))
    found = forward_kinematics(robot_with_pulleys, lengths)
    many = cable_lengths(robot_with_pulleys, random_pose(450))
    threaded = solve_forward_kinematics(robot_with_pulleys, many, robot_with_pulleys.home, threads=2)
    plain = solve_forward_kinematics(robot_with_pulleys, many, robot_with_pulleys.home)
    np.testing.assert_array_equal(threaded.pose.position, plain.pose.position)
    np.testing.assert_array_equal(threaded.status, plain.status)
    for index in np.ndindex(3, 5):
        single = forward_kinematics(robot_with_pulleys, lengths[index])
        np.testing.assert_array_equal(single.position, found.position[index])


@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys", "cogiro", "twelve_cables"])
def test_a_slack_cable_is_named(name: str, request: pytest.FixtureRequest, rng: np.random.Generator) -> None:
    robot: Robot = request.getfixturevalue(name)
    pose = Pose.from_euler(robot.home.position + np.array([0.2, -0.1, 0.1]), 0.05, -0.1, 0.08)
    for cable in range(robot.number_of_cables):
        lengths = cable_lengths(robot, pose)
        lengths[cable] += 0.4
        solution = solve_forward_kinematics(robot, lengths, robot.home)
        assert solution.status == ForwardKinematicsStatus.SLACK_CABLE
        expected = np.zeros(robot.number_of_cables)
        expected[cable] = 0.4
        np.testing.assert_allclose(solution.slack, expected, atol=1e-6)
        with pytest.raises(ForwardKinematicsError, match=f"cable {cable + 1} is slack by 0.4 m") as caught:
            forward_kinematics(robot, lengths, robot.home)
        np.testing.assert_array_equal(caught.value.slack, solution.slack)


def test_several_slack_cables_of_many(twelve_cables: Robot) -> None:
    lengths = cable_lengths(twelve_cables, twelve_cables.home)
    lengths[[1, 6]] += [0.3, 0.5]
    solution = solve_forward_kinematics(twelve_cables, lengths, twelve_cables.home)
    assert solution.status == ForwardKinematicsStatus.SLACK_CABLE
    np.testing.assert_allclose(solution.slack[[1, 6]], [0.3, 0.5], atol=1e-6)
    assert np.count_nonzero(solution.slack) == 2


def test_a_small_slack_shows_when_the_noise_is_known(robot: Robot, rng: np.random.Generator) -> None:
    pose = Pose.from_euler([0.3, 0.2, 1.2], 0.2, 0.1, -0.1)
    lengths = cable_lengths(robot, pose) + 1e-4 * rng.normal(size=8)
    lengths[4] += 0.02
    assert solve_forward_kinematics(robot, lengths, robot.home).converged
    told = solve_forward_kinematics(robot, lengths, robot.home, length_deviation=1e-4)
    assert told.status == ForwardKinematicsStatus.SLACK_CABLE
    assert told.slack[4] == pytest.approx(0.02, abs=2e-3)
    assert np.isnan(told.covariance).all()


@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys", "cogiro"])
def test_where_noise_hides_which_cable_is_slack_no_other_is_blamed(
    name: str, request: pytest.FixtureRequest, rng: np.random.Generator
) -> None:
    """Eight lengths have two to spare: at some poses a little slack of one cable looks like that of another."""
    robot: Robot = request.getfixturevalue(name)
    pose, noise, slack = workspace_grid(robot, rng), 1e-4, 0.02
    cable = rng.integers(0, 8, 125)
    lengths = cable_lengths(robot, pose) + noise * rng.normal(size=(125, 8))
    lengths[np.arange(125), cable] += slack
    solution = solve_forward_kinematics(robot, lengths, pose, length_deviation=noise)
    certain = solution.status == ForwardKinematicsStatus.SLACK_CABLE
    uncertain = solution.status == ForwardKinematicsStatus.SLACK_UNCERTAIN
    assert (certain | uncertain).all()
    assert certain.sum() > 20
    assert uncertain.sum() > 5
    named = solution.slack > 0.0
    np.testing.assert_array_equal(named[certain].argmax(axis=1), cable[certain])
    np.testing.assert_array_equal(named[certain].sum(axis=1), 1)
    assert (named[uncertain].sum(axis=1) > 1).all()
    assert named[np.arange(125), cable].mean() > 0.98
    # without deviations it is the accepted error that bounds the noise
    told = solve_forward_kinematics(robot, lengths, pose, max_residual=5.0 * noise)
    one = told.status == ForwardKinematicsStatus.SLACK_CABLE
    np.testing.assert_array_equal(told.slack[one].argmax(axis=1) == cable[one], np.ones(one.sum()))
    k = int((told.status == ForwardKinematicsStatus.SLACK_UNCERTAIN).argmax())
    with pytest.raises(ForwardKinematicsError, match=r"cable \d is slack by .* m, or cable \d is slack by"):
        forward_kinematics(
            robot, lengths[k], Pose(pose.position[k], pose.rotation[k]), max_residual=5.0 * noise
        )


def test_a_short_cable_is_not_called_slack(robot: Robot) -> None:
    lengths = np.array(robot.winch.home_lengths)
    lengths[2] -= 0.4
    solution = solve_forward_kinematics(robot, lengths, robot.home)
    assert not solution.converged
    if solution.status == ForwardKinematicsStatus.SLACK_CABLE:
        assert solution.slack[2] == 0.0
        assert solution.slack.max() > 0.0


def test_six_lengths_cannot_tell_a_slack_cable(six_cables: Robot) -> None:
    lengths = np.array(six_cables.winch.home_lengths)
    lengths[0] += 0.1
    solution = solve_forward_kinematics(six_cables, lengths, six_cables.home)
    assert solution.converged
    assert not solution.slack.any()


def test_covariance_is_that_of_noisy_solutions(robot_with_pulleys: Robot, rng: np.random.Generator) -> None:
    robot, deviation = robot_with_pulleys, np.linspace(0.5e-4, 2e-4, 8)
    pose = Pose.from_euler([0.3, 0.2, 1.2], 0.1, 0.05, -0.1)
    count = 4000
    noisy = cable_lengths(robot, pose) + deviation * rng.normal(size=(count, 8))
    solution = solve_forward_kinematics(robot, noisy, pose, length_deviation=deviation)
    assert solution.converged.mean() > 0.995
    Q = solution.pose.rotation @ pose.rotation.T
    turn = 0.5 * np.stack(
        (Q[:, 2, 1] - Q[:, 1, 2], Q[:, 0, 2] - Q[:, 2, 0], Q[:, 1, 0] - Q[:, 0, 1]), axis=-1
    )
    errors = np.concatenate((solution.pose.position - pose.position, turn), axis=1)
    expected = pose_covariance(robot, pose, deviation)
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        np.cov(errors.T) / np.outer(scale, scale), expected / np.outer(scale, scale), atol=0.1
    )
    np.testing.assert_allclose(solution.covariance[0], expected, atol=0.02 * expected.max())
    assert pose_covariance(robot, Pose(np.zeros((2, 1, 3)), np.eye(3)), 1e-3).shape == (2, 1, 6, 6)


def test_a_pose_that_lengths_do_not_determine(robot: Robot) -> None:
    """All anchors in one point: lengths say nothing of the rotation."""
    point = robot.with_geometry(anchor_points=np.zeros((8, 3)))
    poses = Pose(np.stack((robot.home.position,) * 2), np.eye(3))
    with pytest.raises(SingularWrenchMatrixError, match="do not determine the pose") as caught:
        pose_covariance(point, poses, 1e-3)
    assert caught.value.index == (0,)
    assert caught.value.wrench_matrix.shape == (6, 8)
    assert caught.value.singular_values[-1] < 1e-9


def test_lengths_that_no_pose_explains(robot_with_pulleys: Robot, rng: np.random.Generator) -> None:
    lengths = robot_with_pulleys.winch.home_lengths + rng.uniform(-1.0, 1.0, 8)
    for guess in (None, robot_with_pulleys.home):
        with pytest.raises(ForwardKinematicsError, match="not solved") as caught:
            forward_kinematics(robot_with_pulleys, lengths, guess)
        assert np.abs(caught.value.residual).max() > 0.05


def test_a_guess_inside_a_pulley_is_reported(robot_with_pulleys: Robot) -> None:
    robot = robot_with_pulleys
    inside = Pose(robot.exit_points[3] + [0.05, 0.0, 0.01] - robot.anchor_points[3], np.eye(3))
    solution = solve_forward_kinematics(robot, robot.winch.home_lengths, inside)
    assert solution.status == ForwardKinematicsStatus.BEYOND_PULLEY
    with pytest.raises(ForwardKinematicsError, match="cannot reach its pulley"):
        forward_kinematics(robot, robot.winch.home_lengths, inside)


def test_no_lengths_give_no_poses(robot: Robot) -> None:
    for guess in (None, robot.home):
        assert forward_kinematics(robot, np.zeros((0, 8)), guess).batch_shape == (0,)


@pytest.mark.parametrize("deviation", [0.0, -1.0, np.nan, np.ones(7)])
def test_deviations_are_checked(robot: Robot, deviation: object) -> None:
    with pytest.raises(InvalidInputError, match="length_deviation"):
        solve_forward_kinematics(robot, robot.winch.home_lengths, length_deviation=deviation)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="length_deviation"):
        pose_covariance(robot, robot.home, deviation)  # type: ignore[arg-type]


def test_the_wrench_matrix_is_the_negative_transpose(any_robot: Robot) -> None:
    cables = inverse_kinematics(any_robot, any_robot.home)
    np.testing.assert_array_equal(cables.jacobian, -cables.wrench_matrix.T)
