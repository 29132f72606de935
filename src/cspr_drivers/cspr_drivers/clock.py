"""The clock of the machine: one in a process, for everything that drivers and devices time.

On a robot it is the computer's own. A simulated machine may run slower than real time: cycles, watchdogs, brakes
and the plant then take longer by the same factor, and a computer that is too slow for the machine keeps up.

Call the functions as ``clock.monotonic()``: `set_speed` replaces them.
"""

from __future__ import annotations

import time as computer
from collections.abc import Callable

monotonic: Callable[[], float] = computer.monotonic
"""Monotonic time, s."""

time: Callable[[], float] = computer.time
"""Time of day, s since 1970; also the time of frames on a virtual bus."""

time_ns: Callable[[], int] = computer.time_ns
"""Time of day, ns since 1970: ROS time."""

sleep: Callable[[float], None] = computer.sleep
"""Wait for a time in s."""

_speed = 1.0
_start_of_day = 0.0  # s since 1970 on both clocks at which they began to differ


def of_computer(stamp: float) -> float:
    """Return the machine's time of day, s, at a time of day of the computer, such as the kernel gives to frames."""
    return _start_of_day + (stamp - _start_of_day) * _speed


def on_computer(duration: float) -> float:
    """Return how long a duration, s, takes on the computer's clock, as timeouts of Python's locks want it."""
    return duration / _speed


def set_speed(speed: float) -> None:
    """Let the clock of this process run at a speed from now on.

    Parameters
    ----------
    speed
        Seconds of the machine in a second of the computer; 1 is the computer's own time. To be set before anything
        is timed: a change makes time of day jump.
    """
    global monotonic, time, time_ns, sleep, _speed, _start_of_day
    _speed = speed
    if speed == 1.0:
        monotonic, time, time_ns, sleep = computer.monotonic, computer.time, computer.time_ns, computer.sleep
        return
    start, day = computer.monotonic(), computer.time_ns()
    _start_of_day = 1e-9 * day

    def elapsed() -> float:
        return (computer.monotonic() - start) * speed

    monotonic = lambda: start + elapsed()  # noqa: E731
    time_ns = lambda: day + round(1e9 * elapsed())  # noqa: E731
    time = lambda: 1e-9 * day + elapsed()  # noqa: E731
    sleep = lambda seconds: computer.sleep(seconds / speed)  # noqa: E731
