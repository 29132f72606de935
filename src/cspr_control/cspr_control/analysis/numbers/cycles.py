"""The control cycle of a recorded run: how regular it was, and how many cycles were missed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.recording import Recording
from cspr_control.analysis.timeline import Status

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
    cycles, missed
        As the driver counted them, to the last second; a cycle is missed when not all fresh commands were on the
        bus in it. None if its diagnostics were not recorded.
    latency_p50_us, latency_p99_us, latency_max_us
        From state to command as the driver measured it, us; NaN if not recorded.
    """

    rate: float
    median_ms: float
    p99_ms: float
    longest_ms: float
    unanswered: int | None
    cycles: int | None
    missed: int | None
    latency_p50_us: float
    latency_p99_us: float
    latency_max_us: float


def cycle_periods(recording: Recording) -> Floats:
    """Return the times between motor states that follow one another on the trajectories, s."""
    times = recording.states.time_ns
    judged = recording.judged(times)
    return np.asarray(np.diff(times)[judged[1:] & judged[:-1]] * 1e-9)


def cycle_metrics(recording: Recording) -> CycleMetrics:
    """Judge the cycle while the robot was on its trajectories."""
    periods = cycle_periods(recording)
    if periods.size == 0:
        rate = median = p99 = longest = math.nan
    else:
        rate = 1.0 / float(periods.mean())
        median, p99, longest = (1e3 * float(x) for x in np.quantile(periods, (0.5, 0.99, 1.0)))
    unanswered = None
    if recording.command_torque is not None:
        judged = recording.judged(recording.states.time_ns)
        unanswered = int(np.isnan(recording.command_torque[judged]).any(axis=1).sum())
    counted = _driver_counts(recording)
    return CycleMetrics(rate, median, p99, longest, unanswered, *counted)


def _driver_counts(recording: Recording) -> tuple[int | None, int | None, float, float, float]:
    entries = recording.timeline.diagnostics.get(_DRIVER, ())
    start = recording.trajectories[0].start_ns if recording.trajectories else 0
    end = recording.trajectories[-1].end_ns if recording.trajectories else int(recording.states.time_ns[-1])
    before = _values([entry for entry in entries if entry[0] <= start])
    # the diagnostics come once a second: the first ones behind the end still count all of it
    behind = [entry for entry in entries if entry[0] >= end][:1]
    after = _values(behind or [entry for entry in entries if entry[0] >= start])
    try:
        cycles, missed = _cycles(after)
    except (KeyError, ValueError):
        return None, None, math.nan, math.nan, math.nan
    try:
        cycles_before, missed_before = _cycles(before)
    except (KeyError, ValueError):
        cycles_before = missed_before = 0
    if cycles_before > cycles:  # the counters began anew when the drives were enabled
        cycles_before = missed_before = 0
    latency = [float(after.get(f"command_latency_{name}_us", "nan")) for name in ("p50", "p99", "max")]
    return cycles - cycles_before, missed - missed_before, latency[0], latency[1], latency[2]


def _values(entries: Sequence[tuple[int, Status]]) -> Mapping[str, str]:
    return entries[-1][1].values if entries else {}


def _cycles(values: Mapping[str, str]) -> tuple[int, int]:
    skipped = int(
        values.get("skipped_sync", "0")
    )  # a SYNC that was left out is a cycle that was missed as well
    return int(values["cycles"]) + skipped, int(values["missed_cycles"]) + skipped


def cycle_bins(longest: float, most: int) -> Floats:
    """Return the edges of a histogram's bins: at most so many of one width, each around a multiple of it.

    The width is 1, 2 or 5 times a power of ten: so the usual periods lie in the middle of a bin, and what is scattered
    around them is not torn in two.

    Parameters
    ----------
    longest
        What must have a place in the last bin, s.
    most
        Number of bins.

    Returns
    -------
    ndarray, shape (k + 1,)
        From half a width below zero on, s.
    """
    least = max(longest, 1e-6) / max(most - 1, 1)
    power = 10.0 ** math.floor(math.log10(least))
    width = next(step * power for step in (*_STEPS, 10.0) if step * power >= least * (1.0 - 1e-9))
    bins: Floats = width * (np.arange(math.floor(longest / width + 0.5) + 2.0) - 0.5)
    return bins
