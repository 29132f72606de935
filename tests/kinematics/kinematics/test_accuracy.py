"""The covariance of a pose against poses found from noisy lengths."""

from __future__ import annotations

import numpy as np
import pytest

from cspr_kinematics import (
    InvalidInputError,
    Pose,
    Robot,
    SingularWrenchMatrixError,
    cable_lengths,
    pose_covariance,
    solve_forward_kinematics,
)


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


@pytest.mark.parametrize("deviation", [0.0, -1.0, np.nan, np.ones(7)])
def test_deviations_are_checked(robot: Robot, deviation: object) -> None:
    with pytest.raises(InvalidInputError, match="length_deviation"):
        solve_forward_kinematics(robot, robot.winch.home_lengths, length_deviation=deviation)  # type: ignore[arg-type]
    with pytest.raises(InvalidInputError, match="length_deviation"):
        pose_covariance(robot, robot.home, deviation)  # type: ignore[arg-type]
