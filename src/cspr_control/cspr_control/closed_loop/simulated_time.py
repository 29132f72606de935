"""Simulated time: it passes from event to event, as quickly as these are dealt with."""

from __future__ import annotations

import threading
from collections.abc import Callable
from heapq import heappop, heappush
from math import inf
from queue import Queue, SimpleQueue
from typing import Any, Protocol

from cspr_drivers.clock import Clock

BEGIN = 1000.0  # s, monotonic time at which a simulation begins
_TURN = 0.002  # s from one turn of a thread to its next: threads take time, and leave the buses some room
_SYSTEM_NS = 1_700_000_000_000_000_000  # ROS time less monotonic time


class Source(Protocol):
    """Something with events of its own that it keeps in order itself, such as a bus with its frames."""

    def next_end(self) -> float | None:
        """Return when the next event is due, s; None while there is none."""

    def deal(self, now: float) -> None:
        """Deal with what is due."""


class SimulatedTime(Clock):
    """A clock that stands still between events, and what is to happen when.

    All that happens at one moment happens in the order in which it was scheduled, so a run gives the same bytes each
    time. What waits in a thread of its own, as drivers do for answers of their devices, is started with `start`: such
    a thread runs only while the simulation waits for it, and only one does at a time.
    """

    def __init__(self) -> None:
        self.set_by = 0.0  # s, how far somebody has set the time of day
        self._now = BEGIN
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._count = 0
        self._sources: list[Source] = []
        self._waiting: list[_Task] = []
        self._busy = False
        self._task: _Task | None = None  # whose turn it is

    # Events

    def at(self, time: float, action: Callable[[], None]) -> None:
        """Do something at a monotonic time, s."""
        self._count += 1
        heappush(self._events, (time, self._count, action))

    def every(self, period: float, action: Callable[[], None], begin: float | None = None) -> None:
        """Do something regularly, from a monotonic time, s, on; by default from now on."""
        first = self._now if begin is None else begin

        def again(number: int = 0) -> None:
            self.at(first + (number + 1) * period, lambda: again(number + 1))
            action()

        self.at(first, again)

    def add(self, source: Source) -> None:
        """Deal with the events of a source as well."""
        self._sources.append(source)

    def wait(self, duration: float) -> None:
        """Let a time, s, pass."""
        self._run(self._now + duration, lambda: False)

    def wait_until(self, condition: Callable[[], bool], limit: float) -> bool:
        """Let time pass until something is so, for a time, s, at most; return whether it is."""
        return condition() or self._run(self._now + limit, condition)

    def _run(self, end: float, condition: Callable[[], bool]) -> bool:
        events, sources, waiting = self._events, self._sources, self._waiting
        self._busy = True
        try:
            while True:
                due, source = (events[0][0] if events else inf), None
                for candidate in sources:
                    time = candidate.next_end()
                    if time is not None and time <= due:
                        due, source = time, candidate
                if due > end:
                    break
                if due > self._now:
                    self._now = due
                if source is None:
                    heappop(events)[2]()
                else:
                    source.deal(self._now)
                if waiting:
                    self._let_tasks_run()
                if condition():
                    return True
        finally:
            self._busy = False
        self._now = max(self._now, end)
        return condition()

    # Clock

    def monotonic(self) -> float:
        """Return monotonic time, s."""
        return self._now

    def system_ns(self) -> int:
        """Return ROS time, ns since 1970."""
        return _SYSTEM_NS + round(self._now * 1e9)

    def time_of_day(self) -> float:
        """Return what the calendar says, s since 1970."""
        return self._now + 1e-9 * _SYSTEM_NS + self.set_by

    def time_of_day_set_by(self) -> float:
        """Return how far somebody has set the time of day, s."""
        return self.set_by

    def stamp(self, moment: float) -> float:
        """Return the time of day, s since 1970, at a moment of monotonic time, s."""
        return moment + 1e-9 * _SYSTEM_NS + self.set_by

    def sleep(self, duration: float) -> None:
        """Let a time, s, pass for the caller; for one that is called by an event itself, it passes without others."""
        if self._task is not None:
            self._task.wait(SimpleQueue(), self._now + duration)
        elif self._busy:
            self._now += duration
        else:
            self.wait(duration)

    def take(self, queue: Queue[Any] | SimpleQueue[Any], timeout: float | None = None) -> Any:
        """Return what comes next in a queue, waiting for it up to a time, s; raises `queue.Empty` after it."""
        if self._task is not None:
            self._task.wait(queue, inf if timeout is None else self._now + timeout)
        elif not self._busy:
            self.wait_until(lambda: not queue.empty(), inf if timeout is None else timeout)
        return queue.get_nowait()

    def on_computer(self, duration: float) -> float:
        """Return 0: nothing here waits on the computer's clock."""
        return 0.0

    def start(self, target: Callable[[], None], name: str) -> _Task:
        """Run a function that waits by this clock as a thread of the simulation; its turn comes after the event."""
        task = _Task(self, target, name)
        self._waiting.append(task)
        self.at(self._now, lambda: None)
        return task

    def end_tasks(self) -> None:
        """End what was started, wherever it waits."""
        for task in tuple(self._waiting):
            task.cancel()

    def _let_tasks_run(self) -> None:
        now = self._now
        for task in self._waiting:
            if now >= task.next_turn and (not task.queue.empty() or now >= task.deadline):
                task.take_turn()
                break  # others have their turn after the next event


class _Task:
    """A thread that runs only while the simulation waits for it."""

    def __init__(self, time: SimulatedTime, target: Callable[[], None], name: str) -> None:
        self.next_turn = self.deadline = -inf
        self.queue: Queue[Any] | SimpleQueue[Any] = SimpleQueue()
        self._time = time
        self._target = target
        self._turn, self._done = threading.Semaphore(0), threading.Semaphore(0)
        self._cancelled = False
        self._ended = False
        self._error: BaseException | None = None
        threading.Thread(target=self._run, name=name, daemon=True).start()

    def is_alive(self) -> bool:
        """Return whether it has not come to its end."""
        return not self._ended

    def join(self, timeout: float | None = None) -> None:
        """Let time, s, pass until it has come to its end."""
        if not self._time._busy:
            self._time.wait_until(lambda: self._ended, inf if timeout is None else timeout)

    def cancel(self) -> None:
        """Let it end where it waits."""
        self._cancelled = True
        self.take_turn()

    def take_turn(self) -> None:
        """Let it run until it waits again; called by the simulation."""
        time = self._time
        before, time._task = time._task, self
        self._turn.release()
        self._done.acquire()
        time._task = before
        if self._ended:
            time._waiting.remove(self)
        if self._error is not None:
            raise self._error

    def wait(self, queue: Queue[Any] | SimpleQueue[Any], deadline: float) -> None:
        """Wait until something is in a queue or a monotonic time, s, has come; called by the thread."""
        self.queue, self.deadline, self.next_turn = queue, deadline, self._time.monotonic() + _TURN
        for moment in {self.next_turn, deadline} - {inf}:
            self._time.at(moment, lambda: None)  # it is looked at after each event
        self._done.release()
        self._turn.acquire()
        if self._cancelled:
            raise SystemExit

    def _run(self) -> None:
        self._turn.acquire()
        try:
            if not self._cancelled:
                self._target()
        except SystemExit:
            pass
        except BaseException as error:  # the simulation raises it in its own thread
            self._error = error
        self._ended = True
        self._done.release()
