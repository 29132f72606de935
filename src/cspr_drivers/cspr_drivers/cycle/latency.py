"""Distribution of the command latency, kept in constant memory while the robot runs for days."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BIN = 10e-6  # s
BINS = 5000  # 50 ms; anything later counts in the last bin, its exact value in the maximum


@dataclass(frozen=True)
class LatencySummary:
    """Median, 99th percentile and maximum, s, of `count` latencies; all zero when there were none."""

    count: int = 0
    p50: float = 0.0
    p99: float = 0.0
    maximum: float = 0.0


NO_LATENCY = LatencySummary()


class LatencyHistogram:
    """Histogram of latencies with bins of 10 us."""

    def __init__(self) -> None:
        self._counts = np.zeros(BINS, dtype=np.int64)
        self._count = 0
        self._maximum = 0.0

    def add(self, latency: float) -> None:
        """Add one latency, s."""
        self._counts[min(BINS - 1, max(0, int(latency / BIN)))] += 1
        self._count += 1
        self._maximum = max(self._maximum, latency)

    def summary(self) -> LatencySummary:
        """Return the distribution so far; percentiles are the upper edge of their bin."""
        return LatencySummary(self._count, self._percentile(0.50), self._percentile(0.99), self._maximum)

    def _percentile(self, fraction: float) -> float:
        if self._count == 0:
            return 0.0
        place = int(np.searchsorted(np.cumsum(self._counts), fraction * self._count))
        return min((place + 1) * BIN, self._maximum)
