"""Motor speeds as differences of positions."""

from __future__ import annotations

from collections.abc import Sequence


class PositionDifference:
    """Speed over the time that really passed between two samples, so that jitter of the SYNC does no harm."""

    def __init__(self) -> None:
        self._time = 0.0
        self._angles: tuple[float, ...] = ()

    def update(self, time: float, angles: Sequence[float]) -> list[float] | None:
        """Return the mean speeds since the sample before, rad/s, or `None` for the first sample.

        Parameters
        ----------
        time
            Moment at which the positions were latched, s; later than that of the sample before.
        angles
            Motor angles, rad (m,).
        """
        elapsed = time - self._time
        before, self._time, self._angles = self._angles, time, tuple(angles)
        if not before or elapsed <= 0.0:
            return None
        return [(now - then) / elapsed for now, then in zip(angles, before, strict=True)]
