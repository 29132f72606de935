"""Steps of the computer's time of day are noticed; that it merely passes, or is slewed, is none."""

import threading
import time

import pytest

from cspr_msgs_py.runtime.time_of_day import timers_reset_at_steps, watch


class Calendar:
    """A time of day that somebody sets."""

    def __init__(self):
        self.set_by = 0.0
        self.reads = 0

    def __call__(self):
        self.reads += 1
        return time.time() + self.set_by


def wait_until(condition):
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


@pytest.fixture
def watched():
    calendar, steps, ended = Calendar(), [], threading.Event()
    watcher = threading.Thread(target=watch, args=(lambda: steps.append(calendar.set_by), ended, calendar))
    watcher.start()
    yield calendar, steps
    ended.set()
    watcher.join()


@pytest.mark.parametrize("step", [-3600.0, 0.05])
def test_a_step_is_noticed_and_told_twice(watched, step):
    calendar, steps = watched
    wait_until(lambda: calendar.reads > 3)
    assert not steps
    calendar.set_by = step
    wait_until(lambda: steps)
    reads = calendar.reads
    wait_until(lambda: calendar.reads > reads + 4)
    assert steps == [step, step]


def test_a_slewed_clock_takes_no_step(watched):
    calendar, steps = watched
    for _ in range(20):
        calendar.set_by += 0.001
        reads = calendar.reads
        wait_until(lambda reads=reads: calendar.reads > reads)
    assert not steps


class TimedNode:
    """What of a node counts here."""

    class Timer:
        resets = 0

        def reset(self):
            self.resets += 1

    def __init__(self):
        self.timers = [self.Timer(), self.Timer()]


def test_all_timers_are_reset_at_a_step(monkeypatch):
    nodes, steps = [TimedNode(), TimedNode()], []

    def step_once(on_step, ended):
        on_step()
        steps.append(1)
        ended.wait()

    monkeypatch.setattr("cspr_msgs_py.runtime.time_of_day.watch", step_once)
    with timers_reset_at_steps(nodes):
        wait_until(lambda: steps)
    assert [timer.resets for node in nodes for timer in node.timers] == [1, 1, 1, 1]
