"""The misfit of the cables' lengths: what a sound robot leaves, what a wrong encoder does, and whom it names."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cspr_control.parameters.settings import supervision_limits
from cspr_control.supervision.length_check import LengthCheck
from cspr_kinematics import Payload, Pose, Robot, cable_lengths, holding_tensions, inverse_kinematics
from cspr_msgs_py.parameters.table import defaults
from cspr_msgs_py.wire.joint_state import JointStateSample

CYCLE = 0.004  # s
NONE = np.empty(0)
SIX_CABLES = Path(__file__).parents[2] / "kinematics" / "robot" / "six_cables.yaml"
SOUND = np.zeros(8)  # following errors, rad


class Cables:
    """A platform that moves slowly, with 200 kg, and what encoders and cells show of it."""

    def __init__(self, robot: Robot, **limits: float) -> None:
        self.robot = robot
        self.check = LengthCheck(robot, replace(supervision_limits(robot, defaults("supervisor")), **limits))
        self.time = 5.0
        self.speed = 0.1  # m/s
        self.encoder_errors = np.zeros(8)  # rad
        self.shown = np.full(8, np.nan)  # N, instead of the true tensions where it is a number
        self.cells = True
        self.frozen: int | None = None  # a motor whose encoder stands still
        self.last = np.zeros(8)

    @property
    def pose(self) -> Pose:
        x = self.speed * (self.time - 5.0)
        return Pose.from_euler(np.add(self.robot.home.position, [x, 0.5 * x, 0.3]), 0.05, 0.02, -0.03)

    def cycle(self, count: int = 1) -> list[bool]:
        """Let cycles pass; return which of them were the first of a misfit that lasts."""
        begun = []
        for _ in range(count):
            self.time += CYCLE
            stamp = round(self.time * 1e9)
            tensions = holding_tensions(self.robot, self.pose, Payload(200.0, np.zeros(3))).tensions
            angles = self.robot.motor_angles(cable_lengths(self.robot, self.pose), tensions)
            shown = np.where(np.isnan(self.shown), tensions, self.shown)
            shown_angles = angles + self.encoder_errors
            if self.frozen is not None:
                shown_angles[self.frozen] = self.last[self.frozen]
            self.last = shown_angles
            first = self.check.observe_motors(
                self.time, JointStateSample(stamp, shown_angles, NONE, NONE), angles - shown_angles
            )
            if self.cells:
                cells = JointStateSample(stamp, NONE, NONE, shown)
                first = self.check.observe_tensions(self.time, cells) or first
            begun.append(first)
        return begun

    def misfit(self, motor: int, error: float) -> float:
        """Return what an encoder's error, rad, leaves of the lengths, m."""
        J = inverse_kinematics(self.robot, self.pose).jacobian
        left = np.eye(8) - J @ np.linalg.pinv(J)
        return float(np.abs(left[:, motor] * error * self.robot.winch.transmission_ratio).max())


@pytest.fixture
def cables(robot: Robot) -> Cables:
    return Cables(robot)


def test_what_stretches_under_the_tensions_of_its_own_sync_fits(cables: Cables) -> None:
    assert not any(cables.cycle(50))
    assert cables.check.largest < 1e-7
    assert cables.check.problem(SOUND) == ""


@pytest.mark.parametrize("motor", range(8))
def test_the_error_of_an_encoder_is_found_in_three_cycles(cables: Cables, motor: int) -> None:
    cables.cycle(30)
    cables.encoder_errors[motor] = 1.2
    assert cables.cycle(5) == [False, False, True, False, False]
    assert cables.check.misfit == pytest.approx(cables.misfit(motor, 1.2), rel=0.01)
    problem = cables.check.problem(SOUND)
    assert f"misfit of {1e3 * cables.check.misfit:.2f} mm, limit 0.3" in problem
    # lengths alone leave every other cable
    assert [f"motor_{k + 1}" in problem for k in range(8)] == [k % 2 == motor % 2 for k in range(8)]
    cables.encoder_errors[motor] = 0.0
    cables.cycle()
    assert cables.check.problem(SOUND) == ""


def test_two_cycles_are_no_misfit_and_a_small_one_is_none(cables: Cables) -> None:
    cables.cycle(30)
    for _ in range(10):
        cables.encoder_errors[2] = 3.0
        assert not any(cables.cycle(2))
        cables.encoder_errors[2] = 0.0
        assert not any(cables.cycle(1))
    cables.encoder_errors[2] = 0.5
    assert not any(cables.cycle(20))
    assert 1e-4 < cables.check.misfit < 3e-4


def test_the_limit_is_what_the_robot_states(robot: Robot) -> None:
    uncalibrated = Cables(replace(robot, length_uncertainty=1e-3))
    uncalibrated.cycle(30)
    uncalibrated.encoder_errors[2] = 1.5
    assert not any(uncalibrated.cycle(20))
    uncalibrated.encoder_errors[2] = 4.0
    assert any(uncalibrated.cycle(3))


def test_a_heavy_cable_of_little_tension_sags_and_may_fit_less_well(cables: Cables) -> None:
    cables.cycle(30)
    limits = [float(cables.check.values()["length_misfit_limit"])]
    for tension in (100.0, 50.0, 30.0):
        cables.shown[6] = tension
        cables.cycle()
        length = cable_lengths(cables.robot, cables.pose)[6]
        sag = (9.81 * 0.16) ** 2 * length**3 / (24.0 * tension**2)  # of a parabola, beyond its chord
        limits.append(float(cables.check.values()["length_misfit_limit"]))
        assert limits[-1] == pytest.approx(min(3e-4 + 0.5 * sag, 3e-3), abs=1e-5)
    assert limits == sorted(limits)
    light = Cables(replace(cables.robot, cables=replace(cables.robot.cables, mass_per_metre=0.0)))
    light.shown[6] = 30.0
    light.cycle(30)
    assert float(light.check.values()["length_misfit_limit"]) == 3e-4


def test_a_slack_cable_may_fit_less_well_for_a_while(cables: Cables) -> None:
    cables.cycle(30)
    cables.encoder_errors[2] = 2.0
    cables.shown[6] = 24.0
    assert not any(cables.cycle(1))
    cables.shown[6] = np.nan
    assert not any(cables.cycle(25))  # 0.1 s
    assert any(cables.cycle(4))


def test_a_misfit_beyond_that_of_slack_cables_names_the_one_that_is(cables: Cables) -> None:
    cables.cycle(30)
    cables.encoder_errors[2] = 15.0
    cables.shown[2] = 3.0
    assert any(cables.cycle(3))
    assert cables.check.problem(SOUND).endswith(
        "limit 3.00 mm: cable_3 carries 3 N, motor_3 is 0.0 rad behind"
    )


def test_a_cell_that_does_not_answer_leaves_the_last_stretch_and_soon_the_wider_limit(cables: Cables) -> None:
    cables.cycle(30)
    cables.encoder_errors[2] = 2.0
    cables.cells = False
    assert any(cables.cycle(4))  # each is judged when the next one comes
    cables.cycle(30)
    assert cables.check.problem(SOUND) == ""
    cables.encoder_errors[2] = 15.0
    assert any(cables.cycle(4))


def test_lengths_of_no_pose_are_an_infinite_misfit(cables: Cables) -> None:
    cables.cycle(30)
    cables.encoder_errors[2] = 0.5 / cables.robot.winch.transmission_ratio
    assert any(cables.cycle(3))
    assert cables.check.misfit == math.inf
    assert cables.check.values()["length_misfit"] == "inf"
    assert "they contradict each other, limit 0.3" in cables.check.problem(SOUND)
    cables.encoder_errors[2] = 0.0
    cables.cycle()
    assert cables.check.misfit < 1e-7


@pytest.mark.parametrize("value", [math.nan, math.inf])
@pytest.mark.parametrize("what", ["encoder_errors", "shown"])
def test_what_is_no_number_fits_no_pose(cables: Cables, what: str, value: float) -> None:
    if what == "shown" and math.isnan(value):
        value = -math.inf
    cables.cycle(30)
    getattr(cables, what)[2] = value
    assert any(cables.cycle(3))
    assert cables.check.misfit == math.inf


def test_a_message_of_another_robot_fits_no_pose(cables: Cables) -> None:
    cables.cycle(30)
    for _ in range(3):
        seven = JointStateSample(9_000_000_000, np.zeros(7), NONE, NONE)
        cables.check.observe_motors(9.0, seven, SOUND)
        cables.check.observe_tensions(9.0, JointStateSample(9_000_000_000, NONE, NONE, np.full(8, 400.0)))
    assert cables.check.problem(SOUND)


@pytest.mark.parametrize("speed", [0.01, 0.1, 0.6])
def test_an_encoder_that_stands_still_is_named_in_the_first_cycle_that_tells(
    cables: Cables, speed: float
) -> None:
    cables.speed = speed
    cables.cycle(30)
    cables.frozen = 2
    cycles = cables.cycle(round(1.2 / speed))
    first = cycles.index(True)
    limit = cables.check.values()["length_misfit_limit"]
    assert (first + 1) * CYCLE * speed < 0.004  # m of the platform: 0.3 mm of misfit are 1.2 mm of cable
    assert sum(cycles) == 1
    assert 3e-4 < float(limit) < 3.6e-4
    assert "encoder of motor_3 stands still while its set-point goes on" in cables.check.problem(SOUND)


def test_a_winch_that_stands_still_is_no_misfit(cables: Cables) -> None:
    """Its encoder says what is true: the set-point goes on, and the platform does not."""
    cables.speed = 0.0
    cables.cycle(30)
    for cycle in range(20):
        stamp = round(cables.time * 1e9)
        behind = np.where(np.arange(8) == 2, 0.2 * cycle, 0.0)
        assert not cables.check.observe_motors(
            cables.time, JointStateSample(stamp, cables.last, NONE, NONE), behind
        )
    assert cables.check.problem(behind) == ""


def test_the_motor_that_alone_is_behind_its_set_point_is_named(cables: Cables) -> None:
    cables.cycle(30)
    cables.encoder_errors[2] = -2.0
    cables.cycle(3)
    behind = np.array([0.1, 9.0, 2.0, 0.0, -0.2, 0.0, 0.5, 0.0])  # that of motor 2 explains no such misfit
    assert "encoder of motor_3, which shows 2.00 rad less than wanted" in cables.check.problem(behind)
    behind[6] = 1.0
    assert "encoder or cable of one of motor_1, motor_3, motor_5, motor_7" in cables.check.problem(behind)


def test_diagnostics_show_the_largest_since_they_were_asked(cables: Cables) -> None:
    cables.cycle(30)
    cables.encoder_errors[2] = 1.0
    cables.cycle(1)
    largest = cables.check.misfit
    cables.encoder_errors[2] = 0.5
    cables.cycle(1)
    shown = cables.check.values()
    assert float(shown["length_misfit_max"]) == pytest.approx(largest, abs=1e-6)
    assert float(shown["length_misfit"]) == pytest.approx(0.5 * largest, rel=0.01)
    assert 3e-4 < float(shown["length_misfit_limit"]) < 3.6e-4
    cables.cycle(1)
    assert float(cables.check.values()["length_misfit_max"]) == pytest.approx(0.5 * largest, rel=0.01)


def test_six_cables_always_fit_and_the_check_says_that_it_is_absent() -> None:
    robot = Robot.from_yaml(SIX_CABLES)
    values = defaults("supervisor") | {"allowed_drop": 1.0}
    check = LengthCheck(robot, supervision_limits(robot, values))
    assert "six cables always fit" in check.absent
    for cycle in range(1, 9):
        tensions = JointStateSample(4_000_000 * cycle, NONE, NONE, np.full(6, 400.0))
        angles = JointStateSample(4_000_000 * cycle, np.full(6, 3.0 * cycle), NONE, NONE)
        assert not check.observe_tensions(0.004 * cycle, tensions)
        assert not check.observe_motors(0.004 * cycle, angles, np.zeros(6))
    assert check.problem(np.zeros(6)) == ""
