"""Readings that stand still: the noise of a sound load cell never lets it show the very same value for long."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cspr_control.estimation._cells import longest_still, note_readings


class StuckReadings:
    """Tells how long each of m readings has shown exactly the same value. Times are monotonic, s."""

    def __init__(self, count: int) -> None:
        self._readings = np.full(count, np.nan)
        self._changed = np.full(count, -math.inf)  # when each last showed another value

    def observe(self, time: float, readings: NDArray[np.float64]) -> None:
        """Note what is read (m,) at ``time``."""
        note_readings(time, readings, self._readings, self._changed)

    def longest(self, time: float, allowed: float) -> tuple[int, float] | None:
        """Return the index of the one that has stood still longest, and for how long, if longer than allowed, s."""
        index, duration = longest_still(time, self._changed)
        return (index, duration) if math.isfinite(duration) and duration > allowed else None
