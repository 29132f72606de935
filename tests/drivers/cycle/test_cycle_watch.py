import pytest

from cspr_drivers.cycle.cycle_watch import CycleWatch
from cspr_drivers.cycle.latency import LatencyHistogram


def run(cycle, start, feedback=(0, 1), commands=(0, 1), fresh=True):
    for index in feedback:
        cycle.feedback(index, start + 0.001 + 1e-4 * index)
    for index in commands:
        cycle.command(index, fresh, start + 0.002 + 1e-4 * index)
    cycle.sync(counted=True)


def test_a_full_cycle_has_a_latency():
    cycle = CycleWatch(2)
    cycle.sync(counted=False)
    assert not cycle.feedback(1, 0.001)
    assert cycle.missing == (0,)
    assert cycle.feedback(0, 0.0015)
    cycle.command(0, True, 0.0017)
    cycle.command(1, True, 0.0019)
    cycle.sync(counted=True)
    statistics = cycle.statistics()
    assert (statistics.cycles, statistics.missed_cycles, statistics.incomplete_cycles) == (1, 0, 0)
    assert statistics.latency.count == 1
    assert statistics.latency.maximum == pytest.approx(0.0004)


def test_a_cycle_without_all_commands_is_missed():
    cycle = CycleWatch(2)
    run(cycle, 0.0, commands=(0,))
    run(cycle, 0.004, commands=(0, 0))
    run(cycle, 0.008, fresh=False)
    statistics = cycle.statistics()
    assert (statistics.cycles, statistics.missed_cycles, statistics.late_commands) == (3, 3, 2)
    assert statistics.latency.count == 0


def test_a_cycle_without_all_feedback_is_incomplete():
    cycle = CycleWatch(2)
    run(cycle, 0.0, feedback=(0,), commands=())
    statistics = cycle.statistics()
    assert (statistics.cycles, statistics.missed_cycles, statistics.incomplete_cycles) == (1, 1, 1)


def test_feedback_that_comes_twice_is_counted_and_completes_nothing():
    cycle = CycleWatch(2)
    assert not cycle.feedback(0, 0.001)
    assert not cycle.feedback(0, 0.0011)
    assert cycle.feedback(1, 0.0012)
    assert cycle.statistics().repeated_feedback == 1


def test_cycles_enter_the_statistics_only_when_counted():
    cycle = CycleWatch(2)
    cycle.sync(counted=False)
    cycle.sync(counted=False)
    assert cycle.statistics().cycles == 0
    run(cycle, 0.0)
    cycle.clear()
    assert cycle.statistics().cycles == 0
    assert cycle.statistics().latency.count == 0


def test_percentiles_of_the_latency():
    histogram = LatencyHistogram()
    for latency in range(1, 101):
        histogram.add(1e-5 * latency - 5e-6)
    summary = histogram.summary()
    assert summary.count == 100
    assert summary.p50 == pytest.approx(500e-6)
    assert summary.p99 == pytest.approx(990e-6)
    assert summary.maximum == pytest.approx(995e-6)


def test_a_very_late_command_keeps_its_value_as_maximum():
    histogram = LatencyHistogram()
    histogram.add(2.0)
    assert histogram.summary().maximum == 2.0
    assert LatencyHistogram().summary().p99 == 0.0


def answer(cycle: CycleWatch, *indices: int) -> list[bool]:
    """Deliver feedback as the driver does; returns for each frame whether it was used."""
    used = []
    for index in indices:
        late = cycle.is_late(index)
        if not late:
            cycle.feedback(index, 0.001)
        used.append(not late)
    return used


def test_an_answer_that_comes_after_the_next_sync_is_not_taken_for_the_next_answer():
    cycle = CycleWatch(2)
    cycle.sync(counted=True)
    assert answer(cycle, 0) == [True]
    cycle.sync(counted=True)  # motor 1 has not answered yet
    assert answer(cycle, 1, 0, 1) == [False, True, True]
    assert cycle.missing == ()
    cycle.sync(counted=True)
    assert answer(cycle, 0, 1) == [True, True]
    assert cycle.statistics().late_feedback == 1


def test_answers_to_two_earlier_cycles_are_told_apart():
    cycle = CycleWatch(1)
    for _ in range(3):
        cycle.sync(counted=True)
    assert answer(cycle, 0, 0, 0) == [False, False, True]


def test_an_answer_that_was_lost_costs_one_more_cycle_and_no_more():
    cycle = CycleWatch(1)
    cycle.sync(counted=True)
    cycle.sync(counted=True)  # the first answer was lost
    assert answer(cycle, 0) == [False]
    cycle.sync(counted=True)
    assert answer(cycle, 0) == [True]
    cycle.sync(counted=True)
    assert answer(cycle, 0) == [True]
