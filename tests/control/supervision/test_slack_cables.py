"""Which winch is named while a cable hangs slack; lengths are those of the inverse kinematics, plus the excess."""

from pathlib import Path

import numpy as np
import pytest

from cspr_control.supervision.slack_cables import excess_lengths, slack_problem
from cspr_kinematics import Pose, Robot, inverse_kinematics

ROBOT = Robot.from_yaml(Path(__file__).parents[3] / "config" / "robot.yaml")
POSE = Pose.from_euler([0.4, -0.3, 1.3], 0.02, -0.03, 0.01)
RATIO = ROBOT.winch.transmission_ratio


def hanging(*slack, tension=3.0):
    """Return motor angles and tensions at the pose, with cables that are so much too long, m."""
    tensions = np.full(8, 400.0)
    lengths = inverse_kinematics(ROBOT, POSE).lengths.copy()
    for cable, excess in slack:
        tensions[cable] = tension
        lengths[cable] += excess
    return ROBOT.motor_angles(lengths, tensions), tensions


def test_taut_cables_are_not_too_long():
    angles, tensions = hanging()
    assert not excess_lengths(ROBOT, angles, tensions).any()
    assert slack_problem(ROBOT, angles, tensions, np.zeros(8), 2.0) == ""


@pytest.mark.parametrize("cable", range(8))
@pytest.mark.parametrize("excess", [0.01, 0.05, 0.3])
def test_the_slack_cable_is_named_with_what_it_is_too_long(cable, excess):
    angles, tensions = hanging((cable, excess))
    found = excess_lengths(ROBOT, angles, tensions)
    assert found[cable] == pytest.approx(excess, abs=2e-4)
    problem = slack_problem(ROBOT, angles, tensions, np.zeros(8), 2.0)
    assert problem.startswith(f"cable_{cable + 1} carries 3 N and is {1e3 * excess:.0f} mm too long")
    assert f"/can_drives/motor_{cable + 1}/wind_in" in problem


def test_of_two_that_explain_the_lengths_the_one_that_was_behind_is_named():
    angles, tensions = hanging((2, 0.02), (6, 0.001))
    behind = np.zeros(8)
    for culprit, other in ((2, 6), (6, 2)):
        behind[:] = 0.0
        behind[culprit] = -12.0
        problem = slack_problem(ROBOT, angles, tensions, behind, 2.0)
        assert problem.startswith(f"cable_{culprit + 1} carries 3 N")
        assert f", cable_{other + 1} 3 N: call /can_drives/motor_{culprit + 1}/wind_in" in problem


def test_one_that_is_taut_is_not_wound_in_for_another_although_it_was_behind():
    angles, tensions = hanging((2, 0.02), (6, 0.012))
    tensions[6] = 230.0
    behind = np.zeros(8)
    behind[6] = -12.0
    problem = slack_problem(ROBOT, angles, tensions, behind, 2.0)
    assert problem.startswith("cable_3 carries 3 N")
    assert "call /can_drives/motor_3/wind_in" in problem


def test_less_than_is_allowed_is_no_problem():
    angles, tensions = hanging((4, 1.5 * RATIO), tension=45.0)
    assert slack_problem(ROBOT, angles, tensions, np.zeros(8), 2.0) == ""


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_no_number_names_nobody(value):
    angles, tensions = hanging((2, 0.05))
    angles[0] = value
    assert slack_problem(ROBOT, angles, tensions, np.zeros(8), 2.0) == ""
