"""Torque against tension right after the brakes have opened."""

from __future__ import annotations

import numpy as np
import pytest

from cspr_control.estimation.sync_pairs import SyncPair
from cspr_control.supervision.holding_check import HoldingCheck
from cspr_kinematics import Robot

CYCLE = 0.004  # s
TENSIONS = np.linspace(300.0, 440.0, 8)  # N


def holding(
    robot: Robot, share: float = 1.0, motors: slice = slice(None), moves_after: float = 9.0
) -> HoldingCheck:
    """Return a check that has seen a second of holding, in which motors show a share of the torque."""
    check = HoldingCheck(robot, 0.05)
    friction = robot.motor.coulomb_friction * np.resize([1.0, -1.0], 8)
    torques = robot.winch.motor_torque(TENSIONS)
    torques[motors] *= share
    torques += friction
    check.observe_braked(SyncPair(0, np.zeros(8), TENSIONS, 0.0 * torques))
    for cycle in range(250):
        time = 5.0 + cycle * CYCLE
        check.observe_enabled(time, SyncPair(0, np.zeros(8), TENSIONS, torques), time < 5.0 + moves_after)
    return check


@pytest.mark.parametrize(("share", "motors", "words"), [
    (1.0, slice(None), ""),
    (1.02, slice(None), ""),
    (1.5, slice(4, 5), "motor_5 holds 5"),
    (0.5, slice(None), "and so do the others: gear_ratio or drum_radius"),
    (-1.0, slice(2, 3), "motor_3 holds -3"),
])  # fmt: skip
def test_a_torque_must_fit_its_tension_but_for_friction(
    robot: Robot, share: float, motors: slice, words: str
) -> None:
    problem = holding(robot, share, motors).problem
    assert words in problem
    assert bool(words) is bool(problem)


def test_a_robot_that_moves_is_judged_by_what_it_held_before(robot: Robot) -> None:
    assert holding(robot, 0.5, moves_after=0.4).problem
    assert not holding(robot, 0.5, moves_after=0.31).problem  # too short to tell


def test_the_next_enabling_is_judged_anew(robot: Robot) -> None:
    check = holding(robot, 0.5)
    check.observe_braked(SyncPair(0, np.zeros(8), TENSIONS, np.zeros(8)))
    assert not check.problem


def test_a_motor_that_winds_in_a_cable_that_slackens_turns_the_wrong_way(robot: Robot) -> None:
    check = HoldingCheck(robot, 0.05)
    angles, lost = np.zeros((2, 8))
    check.observe_braked(SyncPair(0, angles, TENSIONS, np.zeros(8)))
    angles, lost = np.eye(8)[2] * -0.5, np.eye(8)[2] * 60.0
    check.observe_enabled(5.0, SyncPair(0, angles, TENSIONS - lost, np.zeros(8)), True)
    assert "motor_3 winds in and its cable has lost 60 N: is its polarity" in check.turned_wrongly(5.1)
    assert not check.turned_wrongly(6.0)  # by now something else may have moved the platform
    check.observe_enabled(5.1, SyncPair(0, angles, TENSIONS + lost, np.zeros(8)), True)
    assert not check.turned_wrongly(5.1)
