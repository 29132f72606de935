"""The table of what the robot is held to."""

import math

from benchmarks.platform import Task, table
from benchmarks.platform_rows import Row
from benchmarks.platform_runs import growing_load, noise_at_rest

from cspr_control.errors import ControlError


def test_rows_are_measured_in_closed_loop():
    noise, growth = table([Task("at rest", noise_at_rest), Task("growing", growing_load)])
    assert noise.scenario == "at rest"
    assert 0.001 < noise.measured < 0.1
    assert noise.reached
    assert growth.unit == "s"
    assert 0.0 <= growth.measured < 1.0


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
