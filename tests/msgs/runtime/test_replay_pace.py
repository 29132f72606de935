import math

import pytest

from cspr_msgs_py.runtime.replay_pace import LATEST, ReplayPace

SECOND = 1_000_000_000


def test_messages_are_due_as_far_apart_as_they_were_recorded() -> None:
    pace = ReplayPace(5 * SECOND, now=100.0, rate=2.0)
    assert pace.delay(5 * SECOND, 100.0) == 0.0
    assert pace.delay(9 * SECOND, 100.0) == 2.0
    assert pace.delay(9 * SECOND, 103.0) == -1.0
    assert pace.time_ns(101.5) == 8 * SECOND


def test_nothing_is_due_in_a_pause_and_nothing_is_made_up_for_after_it() -> None:
    pace = ReplayPace(0, now=0.0)
    pace.pause(1.0)
    assert pace.time_ns(50.0) == SECOND
    assert pace.delay(2 * SECOND, 50.0) == math.inf
    pace.pause(50.0, False)
    assert pace.delay(2 * SECOND, 50.0) == 1.0


def test_another_rate_counts_from_now_on() -> None:
    pace = ReplayPace(0, now=0.0)
    pace.change_rate(0.5, 1.0)
    assert pace.time_ns(1.0) == SECOND
    assert pace.time_ns(3.0) == 2 * SECOND


def test_a_replay_that_is_late_does_not_hurry() -> None:
    pace = ReplayPace(0, now=0.0)
    assert not pace.catch_up(SECOND, 1.0 + 0.9 * LATEST)
    assert pace.catch_up(SECOND, 1.0 + 1.1 * LATEST)
    assert pace.delay(2 * SECOND, 1.0 + 1.1 * LATEST) == pytest.approx(1.0)


def test_a_pause_from_the_start() -> None:
    pace = ReplayPace(7, now=0.0, paused=True)
    pace.pause(3.0, False)
    assert pace.time_ns(3.0) == 7
