"""The clock of the machine, passed to everything that times drives, load cells, buses and the simulated plant.

On a robot it is the computer's own. A simulated machine may run slower than real time: cycles, watchdogs, brakes
and the plant then take longer by the same factor, and a slow computer keeps up.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from queue import Queue, SimpleQueue
from typing import Any, Protocol


class Thread(Protocol):
    """What can be done with a thread that was started."""

    def is_alive(self) -> bool:
        """Return whether it has not come to its end."""
        ...

    def join(self, timeout: float | None = None) -> None:
        """Wait until it has, up to a time, s."""
        ...


class Clock:
    """The computer's own clock; subclasses are the clocks of machines whose time passes differently."""

    def monotonic(self) -> float:
        """Return monotonic time, s."""
        return time.monotonic()

    def system(self) -> float:
        """Return the time of day, s since 1970; frames on a virtual bus are stamped with it."""
        return time.time()

    def system_ns(self) -> int:
        """Return the time of day, ns since 1970: ROS time."""
        return time.time_ns()

    def sleep(self, duration: float) -> None:
        """Wait for a time, s."""
        time.sleep(duration)

    def take(self, queue: Queue[Any] | SimpleQueue[Any], timeout: float | None = None) -> Any:
        """Return what comes next in a queue, waiting for it up to a time, s; raises `queue.Empty` after it."""
        return queue.get(timeout=None if timeout is None else self.on_computer(timeout))

    def start(self, target: Callable[[], None], name: str) -> Thread:
        """Run a function in a thread, in which it waits by this clock's `sleep` and `take` alone."""
        thread = threading.Thread(target=target, name=name, daemon=True)
        thread.start()
        return thread

    def of_computer(self, stamp: float) -> float:
        """Return this clock's time of day, s, at a time of day of the computer, such as the kernel gives to frames."""
        return stamp

    def on_computer(self, duration: float) -> float:
        """Return how long a duration, s, takes on the computer's clock, as timeouts of Python's locks want it."""
        return duration


COMPUTER = Clock()


class SlowClock(Clock):
    """A clock that runs at a fraction of the computer's speed, from the computer's time at its construction.

    Parameters
    ----------
    speed
        Simulated seconds per second of the computer.
    """

    def __init__(self, speed: float) -> None:
        self._speed = speed
        self._start = time.monotonic()
        self._day_ns = time.time_ns()

    def _elapsed(self) -> float:
        return (time.monotonic() - self._start) * self._speed

    def monotonic(self) -> float:
        """Return monotonic time, s."""
        return self._start + self._elapsed()

    def system(self) -> float:
        """Return the time of day, s since 1970."""
        return 1e-9 * self._day_ns + self._elapsed()

    def system_ns(self) -> int:
        """Return the time of day, ns since 1970."""
        return self._day_ns + round(1e9 * self._elapsed())

    def sleep(self, duration: float) -> None:
        """Wait for a time, s."""
        time.sleep(duration / self._speed)

    def of_computer(self, stamp: float) -> float:
        """Return this clock's time of day, s, at a time of day of the computer."""
        start = 1e-9 * self._day_ns
        return start + (stamp - start) * self._speed

    def on_computer(self, duration: float) -> float:
        """Return how long a duration, s, takes on the computer's clock."""
        return duration / self._speed
