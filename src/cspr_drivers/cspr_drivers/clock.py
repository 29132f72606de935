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
    """The computer's own clock; subclasses are the clocks of machines whose time passes differently.

    Its ROS time begins with the computer's time of day and goes on as monotonic time does. The time of day itself may
    be set at any moment, by NTP or by hand, so neither age nor order of anything is taken from it.
    """

    _speed = 1.0  # s of the machine in a second of the computer

    def __init__(self) -> None:
        self._start, self._start_ns = time.monotonic(), time.time_ns()

    def monotonic(self) -> float:
        """Return monotonic time, s."""
        return time.monotonic()

    def system_ns(self) -> int:
        """Return ROS time, ns since 1970."""
        return self._start_ns + round(1e9 * (time.monotonic() - self._start))

    def time_of_day(self) -> float:
        """Return what the computer's calendar says, s since 1970: frames are stamped with it."""
        return time.time()

    def time_of_day_set_by(self) -> float:
        """Return how far the time of day has been set, s, since this clock began."""
        return self.time_of_day() - 1e-9 * self._start_ns - (time.monotonic() - self._start)

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

    def moment(self, stamp: float) -> float:
        """Return the monotonic time, s, of a frame's stamp; wrong by a step of the time of day that lies between."""
        since = self.time_of_day() - stamp  # read first: a pause between the two makes the frame younger
        return self.monotonic() - since * self._speed

    def stamp(self, moment: float) -> float:
        """Return the time of day, s since 1970, at a moment of monotonic time, s."""
        return self.time_of_day() - self.on_computer(self.monotonic() - moment)

    def on_computer(self, duration: float) -> float:
        """Return how long a duration, s, takes on the computer's clock, as timeouts of Python's locks want it."""
        return duration / self._speed


COMPUTER = Clock()


class SlowClock(Clock):
    """A clock that runs at a fraction of the computer's speed, from the computer's time at its construction.

    Parameters
    ----------
    speed
        Simulated seconds per second of the computer.
    """

    def __init__(self, speed: float) -> None:
        super().__init__()
        self._speed = speed

    def _elapsed(self) -> float:
        return (time.monotonic() - self._start) * self._speed

    def monotonic(self) -> float:
        """Return monotonic time, s."""
        return self._start + self._elapsed()

    def system_ns(self) -> int:
        """Return ROS time, ns since 1970."""
        return self._start_ns + round(1e9 * self._elapsed())

    def sleep(self, duration: float) -> None:
        """Wait for a time, s."""
        time.sleep(duration / self._speed)
