"""The clock of the control cycle: a thread that is paced by absolute monotonic time."""

from __future__ import annotations

import threading
from collections.abc import Callable

from cspr_drivers.clock import COMPUTER, Clock
from cspr_drivers.thread_end import EndHandler, telling


class CycleClock:
    """Calls `tick` once a period.

    The moments lie on a fixed grid: a late call does not shift the later ones. Moments that pass while
    a call takes too long are skipped and counted; they are not caught up in a burst.

    Parameters
    ----------
    period
        Time between two calls, s.
    tick
        What is called, in this clock's own thread, with the monotonic time, s. What it raises ends the
        thread.
    clock
        Clock of the machine.
    on_end
        Told when the thread has ended so.

    Attributes
    ----------
    period, tick
        As given.
    skipped
        Moments that were left out since the last `clear`.
    worst_lateness
        Largest delay of a call behind its moment since the last `clear`, s.
    """

    def __init__(
        self,
        period: float,
        tick: Callable[[float], None],
        clock: Clock = COMPUTER,
        on_end: EndHandler = lambda problem: None,
    ) -> None:
        self.period = period
        self.tick = tick
        self._clock = clock
        self._stopping = threading.Event()
        run = telling(self._run, "cycle clock", on_end)
        self._thread = threading.Thread(target=run, name="cycle clock", daemon=True)
        self.clear()

    def start(self) -> None:
        """Begin to call."""
        self._thread.start()

    def stop(self) -> None:
        """Stop calling; returns when the last call has ended."""
        self._stopping.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout=1.0)

    def clear(self) -> None:
        """Restart the statistics."""
        self.skipped = 0
        self.worst_lateness = 0.0

    @property
    def running(self) -> bool:
        """Whether the clock is calling."""
        return self._thread.is_alive()

    def _run(self) -> None:
        due = self._clock.monotonic()
        while not self._stopping.is_set():
            now = self._clock.monotonic()
            if now < due:
                self._clock.sleep(due - now)
                now = self._clock.monotonic()
            self.worst_lateness = max(self.worst_lateness, now - due)
            self.tick(now)
            due += self.period
            behind = self._clock.monotonic() - due
            if behind > self.period:
                left_out = int(behind / self.period)
                self.skipped += left_out
                due += left_out * self.period
