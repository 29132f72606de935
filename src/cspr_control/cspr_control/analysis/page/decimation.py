"""Fewer points that look the same: the extremes of each stretch of time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def envelope(time: Floats, values: Floats, limit: int) -> tuple[Floats, Floats]:
    """Return at most `limit` samples that keep every peak and every gap.

    The time is cut into stretches with the same number of samples. Each becomes two samples, with the smallest and
    the largest value of each column in the order in which they came.

    Parameters
    ----------
    time
        (n,), in order.
    values
        (n, k); NaN where there is nothing: a stretch of nothing else stays a gap.
    limit
        At least 4.

    Returns
    -------
    time, values
        (j,) and (j, k), j <= limit; unchanged if n <= limit.
    """
    n = time.size
    if n <= limit:
        return time, values
    length = -(-2 * n // limit)
    count = -(-n // length)
    padded = np.full((count * length, values.shape[1]), np.nan)
    padded[:n] = values
    stretches = padded.reshape(count, length, values.shape[1])
    absent = np.isnan(stretches)
    low = np.where(absent, np.inf, stretches)
    high = np.where(absent, -np.inf, stretches)
    first_low = low.argmin(axis=1) <= high.argmax(axis=1)
    smallest, largest = low.min(axis=1), high.max(axis=1)
    gone = absent.all(axis=1)
    smallest[gone] = largest[gone] = np.nan
    result = np.empty((2 * count, values.shape[1]))
    result[0::2] = np.where(first_low, smallest, largest)
    result[1::2] = np.where(first_low, largest, smallest)
    times = np.empty(2 * count)
    starts = np.arange(count) * length
    ends = np.minimum(starts + length, n) - 1
    times[0::2] = time[starts] + 0.25 * (time[ends] - time[starts])
    times[1::2] = time[starts] + 0.75 * (time[ends] - time[starts])
    return times, result
