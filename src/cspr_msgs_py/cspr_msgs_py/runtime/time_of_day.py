"""Steps of the computer's time of day, which people set and NTP corrects while nodes run.

The timers of rclpy's executor wait for a moment of the monotonic clock. But a build for many Linuxes, as the wheels
are, does without the waits on that clock that came with glibc 2.30: it waits for a time of day instead, and when that
is set back by an hour, an hour longer. A timer that is reset begins to wait anew.
"""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rclpy.node import Node

_PERIOD = 0.02  # s between looks: as often as the fastest timer of a node
_STEP = 0.005  # s; NTP moves what it slews by 10 us in that time
_SIMULTANEOUS = 0.001  # s within which both clocks must have been read to be compared


@contextmanager
def timers_reset_at_steps(nodes: Sequence[Node]) -> Iterator[None]:
    """Reset the timers of all nodes whenever the time of day is set, while the block runs."""

    def reset() -> None:
        for node in nodes:
            for timer in node.timers:
                timer.reset()

    ended = threading.Event()
    watcher = threading.Thread(target=watch, args=(reset, ended), name="time of day", daemon=True)
    watcher.start()
    try:
        yield
    finally:
        ended.set()
        watcher.join()


def watch(
    on_step: Callable[[], None], ended: threading.Event, time_of_day: Callable[[], float] = time.time
) -> None:
    """Call `on_step` at each step of the time of day, s, until `ended` is set.

    And once more a look later: somebody may have read the time before the step, and begun to wait after it.
    """
    start: float | None = None
    again = False
    while not ended.wait(_PERIOD):
        before = time.monotonic()
        difference = time_of_day() - before
        if time.monotonic() - before > _SIMULTANEOUS:
            continue
        stepped = start is not None and abs(difference - start) > _STEP
        if stepped or again:
            on_step()
        start, again = difference, stepped
