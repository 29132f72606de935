"""Simulated time: the order of events, and threads that take turns with it."""

from queue import Empty, SimpleQueue

import pytest

from cspr_control.closed_loop.simulated_time import BEGIN, SimulatedTime


@pytest.fixture
def time():
    return SimulatedTime()


def test_events_happen_in_the_order_of_their_times_and_then_as_asked_for(time):
    happened = []
    for moment, name in ((0.2, "late"), (0.1, "first"), (0.1, "second")):
        time.at(BEGIN + moment, lambda name=name: happened.append((name, round(time.monotonic() - BEGIN, 6))))
    time.wait(0.15)
    assert happened == [("first", 0.1), ("second", 0.1)]
    assert time.monotonic() == BEGIN + 0.15
    time.wait(1.0)
    assert happened[2:] == [("late", 0.2)]


def test_what_happens_regularly_keeps_its_grid(time):
    moments = []
    time.every(0.004, lambda: moments.append(time.system_ns()))
    begin = time.system_ns()
    time.wait(40.0)
    assert [moment - begin for moment in moments[::1000]] == [
        4_000_000_000 * k for k in range(len(moments[::1000]))
    ]


def test_an_event_that_takes_time_delays_the_later_ones(time):
    moments = []
    time.at(BEGIN + 0.1, lambda: time.sleep(0.5))
    time.at(BEGIN + 0.2, lambda: moments.append(time.monotonic()))
    time.wait(1.0)
    assert moments == [BEGIN + 0.6]
    assert time.monotonic() == BEGIN + 1.0


def test_a_thread_waits_in_simulated_time(time):
    queue: SimpleQueue[str] = SimpleQueue()
    heard = []

    def listen():
        heard.append((time.take(queue, 1.0), time.monotonic()))
        with pytest.raises(Empty):
            time.take(queue, 1.0)
        heard.append(("nothing", time.monotonic()))
        time.sleep(2.0)
        heard.append(("slept", time.monotonic()))

    task = time.start(listen, "listener")
    time.at(BEGIN + 0.5, lambda: queue.put("word"))
    task.join(10.0)
    assert not task.is_alive()
    words, moments = zip(*heard, strict=True)
    assert words == ("word", "nothing", "slept")
    assert [moment - BEGIN for moment in moments] == pytest.approx([0.5, 1.5, 3.5], abs=0.003)


def test_what_goes_wrong_in_a_thread_is_raised_where_time_passes(time):
    def fail():
        time.sleep(0.1)
        raise ValueError("broken")

    task = time.start(fail, "failing")
    with pytest.raises(ValueError, match="broken"):
        time.wait(1.0)
    assert not task.is_alive()


def test_threads_can_be_ended_where_they_wait(time):
    reached = []

    def wait():
        time.take(SimpleQueue())
        reached.append("the end")

    task = time.start(wait, "waiting")
    time.wait(1.0)
    assert task.is_alive()
    time.end_tasks()
    assert not task.is_alive()
    assert reached == []
