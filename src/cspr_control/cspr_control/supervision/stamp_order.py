"""Stamps of topics that have one publisher each: every message is stamped later than the one before.

One that is not comes from somebody else who publishes there too, and nobody can say which of the two is right. When
the drivers are started again they begin to count anew: the stamps go back once, and the robot is at rest.
"""

from __future__ import annotations

from cspr_control.supervision.checks import MonitoredInput

_LASTS = 1.0  # s for which a topic stays doubtful


class StampOrder:
    """Whether stamps repeat or go back; times are monotonic, s, stamps in ns."""

    def __init__(self) -> None:
        self._newest: dict[MonitoredInput, int] = {}
        self._broken: dict[MonitoredInput, float] = {}  # when each topic's last was

    def observe(self, time: float, source: MonitoredInput, stamp_ns: int) -> bool:
        """Note the stamp of a message; return whether it is out of order."""
        broken = stamp_ns <= self._newest.get(source, stamp_ns - 1)
        self._newest[source] = stamp_ns
        if broken:
            self._broken[source] = time
        return broken

    def problem(self, time: float) -> str:
        """Return which topics have more than one publisher, or an empty text."""
        return "; ".join(
            f"stamps of {source.value} repeat or go back: somebody publishes it beside {source.writer}"
            for source, moment in self._broken.items()
            if time - moment <= _LASTS
        )
