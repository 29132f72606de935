"""The control cycle of a recorded run: how regular it was, and how many cycles were missed."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.recording import Recording, Window

Floats = NDArray[np.float64]

_DRIVER = "can_drives"
_STEPS = (1.0, 2.0, 5.0)


@dataclass(frozen=True)
class CycleMetrics:
    """Regularity of the control cycle.

    Attributes
    ----------
    rate
        Mean, Hz.
    median_ms, p99_ms, longest_ms
        Time from one motor state to the next, ms.
    unanswered
        States that not all motors answered in the recording; None if commands were not recorded.
    counted
        When the driver counted cycles: from its last report before the trajectories to its first one after them, as
        it reports once a second. Starts with NaN if it began to count anew in between. None if not recorded.
    cycles, missed
        As the driver counted them; a cycle is missed when not all fresh commands were on the bus in it. None if its
        reports were not recorded.
    latency_p50_us, latency_p99_us, latency_max_us
        From state to command as the driver measured it since the drives were enabled, us; NaN if not recorded.
    """

    rate: float
    median_ms: float
    p99_ms: float
    longest_ms: float
    unanswered: int | None
    counted: Window | None
    cycles: int | None
    missed: int | None
    latency_p50_us: float
    latency_p99_us: float
    latency_max_us: float

    @classmethod
    def of(cls, periods: Floats, unanswered: int | None, *counted: Any) -> CycleMetrics:
        """Return the metrics of periods (n,), s; the rest as the attributes of the same names."""
        if periods.size == 0:
            return cls(math.nan, math.nan, math.nan, math.nan, unanswered, *counted)
        median, p99, longest = (1e3 * float(x) for x in np.quantile(periods, (0.5, 0.99, 1.0)))
        return cls(1.0 / float(periods.mean()), median, p99, longest, unanswered, *counted)


def cycle_periods(recording: Recording) -> Floats:
    """Return the times between motor states that follow one another on the trajectories, s."""
    times = recording.states.time_ns
    inside = recording.in_window(times)
    return np.asarray(np.diff(times)[inside[1:] & inside[:-1]] * 1e-9)


def cycle_metrics(recording: Recording) -> CycleMetrics:
    """Evaluate the cycle while the robot was on its trajectories."""
    unanswered = None
    if recording.command_torque is not None:
        inside = recording.in_window(recording.states.time_ns)
        unanswered = int(np.isnan(recording.command_torque[inside]).any(axis=1).sum())
    return CycleMetrics.of(cycle_periods(recording), unanswered, *_driver_counts(recording))


def _driver_counts(
    recording: Recording,
) -> tuple[Window | None, int | None, int | None, float, float, float]:
    entries = recording.timeline.diagnostics.get(_DRIVER, ())
    start = recording.trajectories[0].start_ns if recording.trajectories else 0
    end = recording.trajectories[-1].end_ns if recording.trajectories else int(recording.states.time_ns[-1])
    before = next((entry for entry in reversed(entries) if entry[0] <= start), None)
    # reports come once a second: the first one after the end still counts all of it
    after = next((entry for entry in entries if entry[0] >= end), entries[-1] if entries else None)
    if after is None or after[0] < start or (counts := _cycles(after[1].values)) is None:
        return None, None, None, math.nan, math.nan, math.nan
    counts_before = None if before is None else _cycles(before[1].values)
    since = math.nan
    if before is None or counts_before is None or counts_before[0] > counts[0]:
        counts_before = 0, 0  # the counters began anew when the drives were enabled
    else:
        since = (before[0] - recording.origin_ns) * 1e-9
    window = Window("between reports of the driver", since, (after[0] - recording.origin_ns) * 1e-9)
    p50, p99, largest = (
        float(after[1].values.get(f"command_latency_{name}_us", "nan")) for name in ("p50", "p99", "max")
    )
    return window, counts[0] - counts_before[0], counts[1] - counts_before[1], p50, p99, largest


def _cycles(values: Mapping[str, str]) -> tuple[int, int] | None:
    """Return cycles and missed ones; a SYNC that was left out is a cycle that was missed as well."""
    try:
        skipped = int(values.get("skipped_sync", "0"))
        return int(values["cycles"]) + skipped, int(values["missed_cycles"]) + skipped
    except (KeyError, ValueError):
        return None


def cycle_bins(longest: float, most: int) -> Floats:
    """Return the edges of a histogram's bins: at most so many of one width, each around a multiple of it.

    The width is 1, 2 or 5 times a power of ten: so the usual periods lie in the middle of a bin, and their scatter is
    not split between two.

    Parameters
    ----------
    longest
        Largest value, s: it falls into the last bin.
    most
        Number of bins.

    Returns
    -------
    ndarray, shape (k + 1,)
        From half a width below zero, s.
    """
    least = max(longest, 1e-6) / max(most - 1, 1)
    power = 10.0 ** math.floor(math.log10(least))
    width = next(step * power for step in (*_STEPS, 10.0) if step * power >= least * (1.0 - 1e-9))
    bins: Floats = width * (np.arange(math.floor(longest / width + 0.5) + 2.0) - 0.5)
    return bins
