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
    InvalidInputError,
    Pose,
    Robot,
    cable_lengths,
    forward_kinematics,
    inverse_kinematics,
    solve_forward_kinematics,
)


@given(
    st.tuples(st.floats(-1.4, 1.4), st.floats(-0.7, 0.7), st.floats(0.3, 2.0)),
    st.tuples(*[st.floats(-0.4, 0.4)] * 3),
)
def test_forward_of_inverse_is_the_pose(
    robot: Robot, position: tuple[float, ...], angles: tuple[float, float, float]
) -> None:
    pose = Pose.from_euler(position, *angles)
    found = forward_kinematics(robot, inverse_kinematics(robot, pose).lengths, robot.home)
    np.testing.assert_allclose(found.position, pose.position, atol=1e-7)
    np.testing.assert_allclose(found.rotation, pose.rotation, atol=1e-7)


def test_a_near_guess_takes_few_iterations(robot: Robot) -> None:
    pose = Pose.from_euler([0.304, 0.1, 1.1], 0.02, 0.05, -0.03)
    guess = Pose.from_euler([0.3, 0.1, 1.1], 0.02, 0.05, -0.03)
    solution = solve_forward_kinematics(robot, inverse_kinematics(robot, pose).lengths, guess)
    assert solution.converged
    assert solution.iterations <= 3
    assert np.abs(solution.residual).max() < 1e-9


def test_the_exact_guess_takes_none(robot: Robot) -> None:
    solution = solve_forward_kinematics(robot, robot.winch.home_lengths, robot.home)
    assert solution.converged
    assert solution.iterations == 0


def test_batches_equal_loops(robot: Robot, random_pose: Callable[..., Pose]) -> None:
    poses = random_pose(4, 3)
    lengths = inverse_kinematics(robot, poses).lengths
    found = forward_kinematics(robot, lengths, robot.home)
    assert found.batch_shape == (4, 3)
    for index in np.ndindex(4, 3):
        single = forward_kinematics(robot, lengths[index], robot.home)
        np.testing.assert_allclose(found.position[index], single.position, atol=1e-8)
        np.testing.assert_allclose(found.rotation[index], single.rotation, atol=1e-8)


def test_measured_lengths_give_the_least_squares_pose(robot: Robot, rng: np.random.Generator) -> None:
    pose = Pose.from_euler([0.4, -0.3, 1.3], 0.05, 0.02, -0.08)
    measured = inverse_kinematics(robot, pose).lengths + 2e-4 * rng.normal(size=8)
    solution = solve_forward_kinematics(robot, measured, robot.home)
    assert solution.converged
    np.testing.assert_allclose(solution.pose.position, pose.position, atol=1e-3)
    J = inverse_kinematics(robot, solution.pose).jacobian
    np.testing.assert_allclose(J.T @ solution.residual, 0.0, atol=1e-8)
    np.testing.assert_allclose(
        solution.residual, inverse_kinematics(robot, solution.pose).lengths - measured, atol=1e-12
    )


def test_lengths_of_no_pose_are_an_error_with_its_data(robot: Robot) -> None:
    with pytest.raises(ForwardKinematicsError, match="not solved") as caught:
        forward_kinematics(robot, np.full(8, 0.2), robot.home)
    assert caught.value.residual.shape == (8,)
    assert np.abs(caught.value.residual).max() > 0.05
    assert not caught.value.converged
    assert caught.value.iterations > 0


def test_one_bad_member_does_not_spoil_the_batch(robot: Robot) -> None:
    lengths = np.stack([robot.winch.home_lengths, np.full(8, 0.2), robot.winch.home_lengths + 1e-3])
    solution = solve_forward_kinematics(robot, lengths, robot.home)
    np.testing.assert_array_equal(solution.converged, [True, False, True])
    with pytest.raises(ForwardKinematicsError, match="1 of 3"):
        forward_kinematics(robot, lengths, robot.home)


def test_too_few_iterations_are_an_error(robot: Robot) -> None:
    far = inverse_kinematics(robot, Pose.from_euler([1.0, 0.5, 0.6], 0.3, 0.0, 0.0)).lengths
    with pytest.raises(ForwardKinematicsError, match="nearer guess, or allow more"):
        forward_kinematics(robot, far, robot.home, max_iterations=1)


def test_repeated_solving_keeps_the_rotation_orthonormal(robot: Robot) -> None:
    pose = robot.home
    for k in range(200):
        target = Pose.from_euler([0.1 * np.sin(0.1 * k), 0.0, 1.0], 0.0, 0.1 * np.cos(0.1 * k), 0.0)
        pose = forward_kinematics(robot, inverse_kinematics(robot, target).lengths, pose)
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-15)


@pytest.mark.parametrize("lengths", [np.ones(7), np.full(8, np.nan), np.full(8, -1.0), np.zeros(8)])
def test_input_is_checked(robot: Robot, lengths: np.ndarray) -> None:
    with pytest.raises(InvalidInputError, match="lengths"):
        forward_kinematics(robot, lengths, robot.home)


@pytest.mark.parametrize("limit", [{"max_iterations": 0}, {"max_iterations": 2.5}, {"length_deviation": 0.0}])
def test_limits_are_checked(robot: Robot, limit: dict[str, float]) -> None:
    lengths = inverse_kinematics(robot, robot.home).lengths
    with pytest.raises(InvalidInputError) as caught:
        forward_kinematics(robot, lengths, robot.home, **limit)
    assert caught.value.name in limit


def test_batches_that_do_not_fit_are_refused(robot: Robot) -> None:
    with pytest.raises(InvalidInputError, match="broadcast"):
        forward_kinematics(robot, np.ones((2, 8)), Pose(np.zeros((3, 3)), np.eye(3)))


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


@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys"])
def test_iterations_that_the_documentation_states(
    name: str,
    request: pytest.FixtureRequest,
    rng: np.random.Generator,
    workspace_grid: Callable[[Robot], Pose],
) -> None:
    robot: Robot = request.getfixturevalue(name)
    pose = workspace_grid(robot)
    lengths = cable_lengths(robot, pose)
    offset = 0.01 * rng.uniform(-1.0, 1.0, (125, 3)) / np.sqrt(3.0)
    turn = np.deg2rad(1.0) * rng.uniform(-1.0, 1.0, (125, 3)) / np.sqrt(3.0)
    near = Pose(pose.position + offset, Rotation.from_rotvec(turn).as_matrix() @ pose.rotation)
    assert solve_forward_kinematics(robot, lengths, near).iterations <= 3
    assert solve_forward_kinematics(robot, lengths, robot.home).iterations <= 8


def test_batches_without_a_guess_equal_loops(
    robot_with_pulleys: Robot, random_pose: Callable[..., Pose]
) -> None:
    lengths = cable_lengths(robot_with_pulleys, random_pose(3, 5))
    found = forward_kinematics(robot_with_pulleys, lengths)
    for index in np.ndindex(3, 5):
        single = forward_kinematics(robot_with_pulleys, lengths[index])
        np.testing.assert_array_equal(single.position, found.position[index])
