"""The size of an error in three numbers, as the paper gives it: RMS, median, maximum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ErrorStatistics:
    """Size of an error of each motor or cable, each (m,): of its absolute value, in the error's unit."""

    rms: Floats
    median: Floats
    maximum: Floats

    @classmethod
    def of(cls, error: Floats) -> ErrorStatistics:
        """Return the statistics of an error (n, m); NaN without samples."""
        if len(error) == 0:
            nothing = np.full(error.shape[1], np.nan)
            return cls(nothing, nothing, nothing)
        size = np.abs(error)
        return cls(np.sqrt((size**2).mean(axis=0)), np.median(size, axis=0), size.max(axis=0))

    def __sub__(self, other: ErrorStatistics) -> ErrorStatistics:
        """Return the difference of two statistics."""
        return ErrorStatistics(self.rms - other.rms, self.median - other.median, self.maximum - other.maximum)


def before_and_after(time: Floats, error: Floats, change_time: float) -> dict[str, ErrorStatistics]:
    """Return the statistics of an error (n, m) ``before`` and ``after`` a change, and ``delta``: before minus after."""
    before, after = (ErrorStatistics.of(error[part]) for part in (time < change_time, time >= change_time))
    return {"before": before, "after": after, "delta": before - after}
