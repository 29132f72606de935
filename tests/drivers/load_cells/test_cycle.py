"""The load cells' cycle by its bytes: no bus, no thread, no clock."""

import pytest

from cspr_drivers.errors import FrameError
from cspr_drivers.load_cells.cycle import LoadCellCycle


@pytest.fixture
def cycle(config):
    cycle = LoadCellCycle(config)
    cycle.sync(10.0, 7)
    return cycle


def answer(cycle, index, data="10 27 00 00 00", now=10.001):
    return cycle.measured(now, index, bytes.fromhex(data))


def test_the_last_frame_completes_the_tensions_of_a_sync(cycle):
    assert [answer(cycle, index) for index in range(7)] == [None] * 7
    complete = answer(cycle, 7, "E8 03 00 00 00")
    assert complete == (7, pytest.approx((1000.0,) * 7 + (100.0,)))
    assert cycle.problems(10.002, {}) == {}


def test_values_after_the_set_is_complete_are_ignored(cycle, config):
    assert answer(LoadCellCycle(config), 0) is None  # before the first SYNC
    for index in (*range(7), 0):
        assert answer(cycle, index, "E8 03 00 00 00" if index else "10 27 00 00 00") is None
    assert answer(cycle, 7) == (7, pytest.approx((1000.0,) + (100.0,) * 6 + (1000.0,)))
    assert answer(cycle, 7, "E8 03 00 00 00") is None
    cycle.sync(10.004, 8)
    assert cycle.statistics().incomplete_cycles == 0


def test_a_late_value_is_counted(cycle):
    for index in range(7):
        answer(cycle, index)
    cycle.sync(10.004, 8)
    for index in range(7):
        answer(cycle, index)
    stamp_ns, tensions = answer(cycle, 7, "E8 03 00 00 00")  # the answer to SYNC 7
    assert (stamp_ns, tensions[7]) == (8, pytest.approx(100.0))
    counts = cycle.statistics().answers[7]
    assert (counts.late, counts.missing) == (1, 1)


def test_what_is_wrong_with_each_cell_is_named(cycle, config):
    late = 10.0 + 2.0 * config.timeouts.feedback
    cycle.sync(late, 8)
    cycle.configured(1, (None, 10_000))
    for index in range(6):
        assert answer(cycle, index, "10 27 00 00 02" if index == 0 else "10 27 00 00 00", now=late) is None
    assert cycle.problems(late, {"cable_8 (node 18 on main)": "restarted"}) == {
        "cable_1": "positive overload",
        "cable_2": "at the end of its measuring range",
        "cable_7": "silent",
        "cable_8": "restarted",
    }


def test_a_frame_cut_short_is_refused(cycle):
    with pytest.raises(FrameError, match="frame of 4 bytes where 5 were expected"):
        answer(cycle, 0, "10 27 00 00")


def test_a_cell_that_answers_more_often_than_it_is_asked_is_named(cycle, config):
    for turn in range(4):
        now = 10.0 + 0.004 * turn
        cycle.sync(now, 7 + turn)
        complete = [answer(cycle, index, now=now) for index in range(8)][-1]
        assert complete == (7 + turn, pytest.approx((1000.0,) * 8))
        assert answer(cycle, 2, "00 00 00 00 02", now=now) is None  # another amplifier, without a cell
    words = "answers one SYNC twice: another device has its node id"
    assert cycle.problems(now, {}) == {"cable_3": words}
    cycle.sync(now + 2.0 * config.timeouts.feedback, 20)
    for index in range(8):
        answer(cycle, index, now=now + 2.0 * config.timeouts.feedback)
    assert cycle.problems(now + 2.0 * config.timeouts.feedback, {}) == {}
