"""A low-pass of two equal poles, for any number of deviations that must be delayed alike."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cspr_control.estimation._payload_filter import smooth


class TwoPoles:
    """Two first-order low-passes in series for deviations, which are none until the samples say so.

    They begin at zero, not at their first sample: one cycle alone is several times as far off as what is left of the
    noise after the filter. Times are monotonic, s.
    """

    def __init__(self) -> None:
        self._time = math.nan
        self._first = self._second = np.empty((1, 0))

    def clear(self) -> None:
        """Begin anew with the next sample."""
        self._time = math.nan

    def update(self, time: float, samples: NDArray[np.float64], time_constant: float) -> NDArray[np.float64]:
        """Return the filtered samples (k,) at ``time``, which change with the next ones; the time constant in s."""
        if math.isnan(self._time):
            self._first, self._second = np.zeros((2, 1, len(samples)))
        else:
            smooth(time - self._time, time_constant, samples[None], self._first, self._second)
        self._time = time
        filtered: NDArray[np.float64] = self._second[0]
        return filtered
