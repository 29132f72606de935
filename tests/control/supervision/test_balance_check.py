"""The balance at enabling: what sound cells leave, what a swinging load does, and how wrong it may be."""

from __future__ import annotations

import numpy as np
import pytest

from cspr_control.estimation.sync_pairs import SyncPair
from cspr_control.supervision.balance_check import BalanceCheck, BalanceSettings
from cspr_kinematics import Payload, Pose, Robot, cable_lengths, holding_tensions, inverse_kinematics

CYCLE = 0.004  # s
NONE = np.empty(0)
SETTINGS = BalanceSettings(-1.0, 300.0, 0.003, 0.02, 0.05)


class Platform:
    """A platform at rest at some pose, with a load, and what encoders and cells show of it."""

    def __init__(self, robot: Robot, load: float, settings: BalanceSettings = SETTINGS) -> None:
        self.robot = robot
        self.check = BalanceCheck(robot, settings)
        self.time = 5.0
        self.pose = Pose.from_euler(np.add(robot.home.position, [0.4, -0.3, 0.5]), 0.05, 0.02, -0.03)
        self.tensions = holding_tensions(robot, self.pose, Payload(load, np.zeros(3))).tensions
        self.angles = robot.motor_angles(cable_lengths(robot, self.pose), self.tensions)
        self.noise = np.random.default_rng(1)

    def rest(self, duration: float, sideways: float = 0.0, period: float = 1.0) -> list[str]:
        """Let time pass while something pulls sideways, N, to and fro; return what is said at each SYNC."""
        pull = np.linalg.pinv(-inverse_kinematics(self.robot, self.pose).jacobian.T)[:, 0]
        said = []
        for _ in range(round(duration / CYCLE)):
            self.time += CYCLE
            swing = sideways * np.cos(2.0 * np.pi * (self.time - 5.0) / period)
            shown = self.tensions + swing * pull + self.noise.normal(scale=2.0, size=8)
            self.check.observe(self.time, SyncPair(0, self.angles, shown, NONE))
            said.append(self.check.problem(self.time))
        return said


@pytest.mark.parametrize("load", [0.0, 100.0, 300.0])
def test_a_sound_robot_may_be_enabled_from_the_first_tenth_of_a_second_on(robot: Robot, load: float) -> None:
    platform = Platform(robot, load)
    assert not any(platform.rest(1.0)[25:])
    assert platform.check.load == pytest.approx(load, abs=1.0)


def test_nothing_is_said_before_anything_is_known(robot: Robot) -> None:
    check = BalanceCheck(robot, SETTINGS)
    assert check.problem(5.0) == ""
    assert np.isnan(check.load)
    for angles, tensions in (
        (NONE, NONE),
        (np.zeros(8), np.full(8, np.nan)),
        (np.full(8, 1e6), np.full(8, 300.0)),
    ):
        check.observe(5.0, SyncPair(0, angles, tensions, NONE))
    assert check.problem(5.0) == ""


def test_a_load_that_swings_is_waited_for_and_a_steady_push_is_not(robot: Robot) -> None:
    platform = Platform(robot, 200.0)
    said = platform.rest(3.0, sideways=150.0, period=1.4)
    assert "a force along x" in said[10]
    assert not any(said[round(1.0 / CYCLE) :])
    pushed = platform.rest(4.0, sideways=150.0, period=1e6)
    assert "a force along x" in pushed[-1]
    assert "that no load explains" in pushed[-1]


@pytest.mark.parametrize(("declared", "load", "words"), [
    (100.0, 100.0, ""),
    (100.0, 112.0, "the load cells carry 265.0 kg where it should be 253.0 kg, platform and declared_load of 100 kg"),
    (-1.0, 320.0, "where it should be between 153.0 kg and 453.0 kg"),
])  # fmt: skip
def test_the_weight_is_that_of_the_platform_and_the_load(
    robot: Robot, declared: float, load: float, words: str
) -> None:
    platform = Platform(robot, load, BalanceSettings(declared, 300.0, 0.003, 0.02, 0.05))
    said = platform.rest(1.0)[-1]
    assert (words == "") is (said == "")
    assert words.split(" kg")[-1] in said


def test_a_load_cannot_hang_beside_the_platform(robot: Robot) -> None:
    platform = Platform(robot, 100.0)
    A = -inverse_kinematics(robot, platform.pose).jacobian.T
    platform.tensions = platform.tensions + np.linalg.pinv(A)[:, 4] * 300.0  # N m, of 100 kg 0.3 m beside
    assert "a moment about y" in platform.rest(1.0)[-1]
    wary = Platform(robot, 100.0, BalanceSettings(-1.0, 300.0, 0.2, 0.02, 0.05))
    wary.tensions = platform.tensions
    assert wary.rest(1.0)[-1] == ""  # an uncalibrated robot states more
