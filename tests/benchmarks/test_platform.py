"""The table of what the robot is held to."""

import math
from types import SimpleNamespace

import pytest
from benchmarks import platform_live, platform_poses
from benchmarks.platform import LIVE, Task, rows_of, table
from benchmarks.platform_poses import exact_lengths, slack_cable
from benchmarks.platform_rows import Row
from benchmarks.platform_runs import growing_load, noise_at_rest
from scipy.spatial.transform import Rotation
from studies.live_agreement import Compared

from cspr_control.errors import ControlError
from cspr_kinematics import Pose, solve_forward_kinematics


def test_rows_are_measured_in_closed_loop():
    noise, growth = table([Task("at rest", noise_at_rest), Task("growing", growing_load)])
    assert noise.scenario == "at rest"
    assert 0.001 < noise.measured < 0.1
    assert noise.reached
    assert growth.unit == "s"
    assert 0.0 <= growth.measured < 1.0


def test_no_wrong_pose_passes_for_a_right_one():
    for rows in (exact_lengths("small frame"), slack_cable("slack")):
        (row,) = rows
        assert row.reached
        assert (row.measured, row.aim) == (0, 0)


def test_a_pose_that_is_turned_over_and_a_loose_tolerance_are_counted(monkeypatch):
    over = Rotation.from_rotvec([0.0, 3.0, 0.0]).as_matrix()

    def loose(robot, lengths, guess):
        if guess is robot.home:
            guess = Pose(guess.position, over)
        return solve_forward_kinematics(robot, lengths, guess, length_deviation=0.1)

    monkeypatch.setattr(platform_poses, "solve_forward_kinematics", loose)
    (turned,), (slack,) = exact_lengths("small frame"), slack_cable("slack")
    assert not turned.reached
    assert turned.measured > 50
    assert not slack.reached
    assert slack.measured > 100


def test_a_live_run_is_compared_number_by_number(monkeypatch, tmp_path):
    """The demo is not run: what it would leave is made up, as are the numbers without ROS."""
    live = SimpleNamespace(missed=0.002)
    numbers = [
        Compared("platform's RMS error, mm", 0.33, 0.3, 0.1, share=True),
        Compared("mass, kg", 200.4, 200.0, 0.5),
    ]
    done = SimpleNamespace(returncode=0, stderr="")
    monkeypatch.setattr(platform_live.subprocess, "run", lambda *arguments, **options: done)
    monkeypatch.setattr(platform_live.LiveRun, "read", lambda directory: live)
    monkeypatch.setattr(platform_live, "agreement", lambda run: SimpleNamespace(numbers=lambda: numbers))
    missed, platform, mass = rows_of(LIVE)
    assert (missed.measured, missed.unit, missed.reached) == (0.2, "%", True)
    assert platform.measured == pytest.approx(10.0)
    assert (mass.unit, mass.reached) == ("kg", True)
    done.returncode, done.stderr = 1, "no robot"
    (failed,) = rows_of(LIVE)
    assert not failed.reached
    assert "no robot" in failed.note


def _fails(name: str) -> list[Row]:
    raise ControlError("the robot stopped")


def test_what_cannot_be_measured_is_missed_and_says_why():
    (row,) = table([Task("broken", _fails)])
    assert not row.reached
    assert math.isnan(row.measured)
    assert "the robot stopped" in str(row)


def test_an_aim_is_an_upper_or_a_lower_limit():
    assert Row("", "", 0.2, 0.2).reached
    assert not Row("", "", 0.21, 0.2).reached
    assert not Row("", "", 0.19, 0.2, at_least=True).reached
    assert "MISSED" in str(Row("", "", 0.21, 0.2))
