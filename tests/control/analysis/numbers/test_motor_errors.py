"""Motor errors on traces whose answers are known beforehand."""

from __future__ import annotations

import numpy as np
import pytest

from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.analysis.numbers.motor_errors import motor_errors
from cspr_control.errors import ControlError
from cspr_msgs_py.bag.columns import JointStates

PERIOD = 4_000_000  # ns


def ramp(stamps: np.ndarray, speed: float, offset: float = 0.0) -> JointStates:
    position = speed * stamps[:, None] * 1e-9 * np.ones(8) + offset
    return JointStates(
        0, stamps, stamps, ("motor",) * 8, position, np.full_like(position, speed), 0.0 * position
    )


def test_setpoints_are_carried_to_the_time_of_the_state() -> None:
    states = np.arange(100) * PERIOD
    jitter = np.random.default_rng(3).integers(-300_000, 300_000, 100)
    errors = motor_errors(ramp(states + jitter, 100.0), ramp(states, 103.0, offset=0.25))
    expected = 0.25 + 3.0 * (states + jitter) * 1e-9
    np.testing.assert_allclose(errors.position, np.tile(expected[:, None], 8), atol=1e-9)
    np.testing.assert_allclose(errors.velocity, 3.0, atol=1e-9)


def test_a_lost_setpoint_is_bridged_by_the_one_before() -> None:
    states = np.arange(100) * PERIOD
    errors = motor_errors(ramp(states, 100.0), ramp(np.delete(states, 30), 100.0, 0.1))
    assert errors.time_ns.size == 100
    np.testing.assert_allclose(errors.position, 0.1, atol=1e-9)


def test_states_before_the_first_setpoint_and_long_after_the_last_are_left_out() -> None:
    states = np.arange(1000) * PERIOD
    errors = motor_errors(ramp(states, 1.0), ramp(states[100:200], 1.0))
    assert errors.time_ns[0] == states[100]
    assert errors.time_ns[-1] == states[199 + 125]  # half a second


def test_nothing_to_compare_is_an_error() -> None:
    trace = ramp(np.arange(10) * PERIOD, 1.0)
    nothing = ramp(np.zeros(0, np.int64), 1.0)
    with pytest.raises(ControlError, match="0 set-points"):
        motor_errors(trace, nothing)
    with pytest.raises(ControlError, match="no motor state has a set-point"):
        motor_errors(trace, ramp(trace.time_ns + 10**12, 1.0))


def test_statistics_of_an_error() -> None:
    statistics = ErrorStatistics.of(np.array([[3.0, 0.0], [-4.0, 0.0], [0.0, 0.0]]))
    np.testing.assert_allclose(statistics.rms, [np.sqrt(25.0 / 3.0), 0.0])
    np.testing.assert_allclose(statistics.median, [3.0, 0.0])
    np.testing.assert_allclose(statistics.maximum, [4.0, 0.0])
    assert np.isnan(ErrorStatistics.of(np.empty((0, 2))).rms).all()
