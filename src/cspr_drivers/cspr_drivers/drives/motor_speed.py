"""Motor speeds as differences of positions."""

from __future__ import annotations

from collections.abc import Sequence


class PositionDifference:
    """Speed over the measured time between two samples, so that jitter of the SYNC does no harm.

    Parameters
    ----------
    time_constant
        Of a low-pass filter of first order, s; 0 for none. It smooths the steps of a coarse encoder and delays the
        speed by as much.
    """

    def __init__(self, time_constant: float = 0.0) -> None:
        self._time_constant = time_constant
        self._time = 0.0
        self._angles: tuple[float, ...] = ()
        self._speeds: list[float] | None = None

    def clear(self) -> None:
        """Start over: the next sample has nothing to do with those before."""
        self._angles = ()
        self._speeds = None

    def update(self, time: float, angles: Sequence[float]) -> list[float] | None:
        """Return the speeds since the sample before, rad/s, or `None` for the first sample.

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
        speeds = [(now - then) / elapsed for now, then in zip(angles, before, strict=True)]
        if self._time_constant and self._speeds is not None:
            share = elapsed / (self._time_constant + elapsed)
            speeds = [old + share * (new - old) for old, new in zip(self._speeds, speeds, strict=True)]
        self._speeds = speeds
        return speeds
