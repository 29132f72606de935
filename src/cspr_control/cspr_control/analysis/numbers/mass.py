"""How good the estimate of the payload's mass was."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.recording import Recording
from cspr_control.analysis.timeline import Timeline
from cspr_msgs_py.bag.columns import Inertias

MASS_TOLERANCE = 0.02  # of the true mass: the band in which the estimate must stay to count as settled
LEAST_TOLERANCE = 1.0  # kg, of every band around the true mass: 2 % of an empty platform could never be met
_LEAST_CHANGE = 1e-3  # kg, the least difference that counts as a change of the true mass


@dataclass(frozen=True)
class MassTrace:
    """A mass over time: stamps in ns (n,), kg (n,)."""

    stamp_ns: NDArray[np.int64]
    mass: NDArray[np.float64]

    def between(self, start: int, end: int) -> MassTrace:
        """Return the part from one stamp on and before another, ns."""
        part = (self.stamp_ns >= start) & (self.stamp_ns < end)
        return MassTrace(self.stamp_ns[part], self.mass[part])


@dataclass(frozen=True)
class MassChange:
    """One change of the true payload.

    Attributes
    ----------
    time
        When, s.
    mass_before, mass
        The true ones before and after, kg.
    settling
        Time until the estimate stays within 2 % of the true mass, s; None if it never does before the next change.
    """

    time: float
    mass_before: float
    mass: float
    settling: float | None


@dataclass(frozen=True)
class MassMetrics:
    """The estimate while the robot was on its trajectories; NaN without a true mass to compare with.

    Attributes
    ----------
    estimate, true
        At the end, kg.
    bias, noise
        Mean and standard deviation of the estimate's error once it has settled, kg (of the estimate itself, less
        its mean, without a true mass). Where it never settles: in the second half of what is left.
    rms
        RMS error over all of the time, kg.
    changes
        Of the true mass, in the order of time.
    settling
        After the last change, s; without one from the start of the record. None if it never settles.
    """

    estimate: float
    true: float
    bias: float
    noise: float
    rms: float
    changes: tuple[MassChange, ...]
    settling: float | None


def recorded_mass(recording: Recording) -> MassMetrics | None:
    """Evaluate the estimated mass of a recording; None if it has none on its trajectories."""
    if recording.estimate is None:
        return None
    estimate = mass_trace(recording.timeline, recording.estimate)
    truth = None if recording.truth is None else mass_trace(recording.timeline, recording.truth)
    return mass_metrics(estimate, truth, recording.origin_ns)


def mass_trace(timeline: Timeline, payload: Inertias) -> MassTrace:
    """Return a payload's mass on the trajectories, by the time at which each message was there.

    The estimate keeps the stamp of its newest measurement while it is held: what counts is when it was there.
    """
    counted = timeline.counts(payload.log_time_ns)
    return MassTrace(payload.log_time_ns[counted], payload.mass[counted])


def mass_metrics(estimate: MassTrace, truth: MassTrace | None, origin_ns: int) -> MassMetrics | None:
    """Compare an estimate with the truth; None without an estimate.

    Parameters
    ----------
    estimate, truth
        In the order of time.
    origin_ns
        Time zero of the results, ns.
    """
    if estimate.mass.size == 0:
        return None
    if truth is None or truth.mass.size == 0:
        late = estimate.mass[estimate.mass.size // 2 :]
        return MassMetrics(
            float(estimate.mass[-1]), math.nan, math.nan, float(late.std()), math.nan, (), None
        )
    known = np.maximum(np.searchsorted(truth.stamp_ns, estimate.stamp_ns, side="right") - 1, 0)
    error = estimate.mass - truth.mass[known]
    changes = _changes(estimate, truth, origin_ns)
    settling = changes[-1].settling if changes else settling_time(estimate, truth)
    start = _last_change_ns(truth) or int(estimate.stamp_ns[0])
    steady = _steady(estimate.stamp_ns, start, settling)
    return MassMetrics(
        float(estimate.mass[-1]),
        float(truth.mass[-1]),
        float(error[steady].mean()),
        float(error[steady].std()),
        float(np.sqrt((error**2).mean())),
        changes,
        settling,
    )


def settling_time(estimate: MassTrace, truth: MassTrace) -> float | None:
    """Time from the last change of the true mass until the estimate is within the band around it for good, s.

    The band is `MASS_TOLERANCE` of the true mass, and `LEAST_TOLERANCE` at least.

    None when it never is, and when the estimate's record ends before the change. With no change in the record, the
    time runs from the beginning of the estimate's record.
    """
    start = _last_change_ns(truth) or int(estimate.stamp_ns[0])
    after = estimate.stamp_ns >= start
    if not after.any():
        return None
    final = float(truth.mass[-1])
    outside = np.abs(estimate.mass[after] - final) > max(MASS_TOLERANCE * final, LEAST_TOLERANCE)
    if outside[-1]:
        return None
    stamps = estimate.stamp_ns[after]
    settled = stamps[np.flatnonzero(outside)[-1] + 1] if outside.any() else stamps[0]
    return float((settled - start) * 1e-9)


def _steady(stamps: NDArray[np.int64], start: int, settling: float | None) -> NDArray[np.bool_]:
    """Return which samples count for bias and noise; at least one."""
    begin = start + round(settling * 1e9) if settling is not None else (start + int(stamps[-1])) // 2
    return stamps >= min(begin, int(stamps[-1]))


def change_indices(mass: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return the indices of the first samples of a new mass."""
    return np.flatnonzero(np.abs(np.diff(mass)) > _LEAST_CHANGE) + 1


def _last_change_ns(truth: MassTrace) -> int | None:
    places = change_indices(truth.mass)
    return int(truth.stamp_ns[places[-1]]) if places.size else None


def _changes(estimate: MassTrace, truth: MassTrace, origin_ns: int) -> tuple[MassChange, ...]:
    places = change_indices(truth.mass)
    if places.size == 0:
        return ()
    ends = [*truth.stamp_ns[places[1:]].tolist(), int(estimate.stamp_ns[-1]) + 1]
    changes = []
    for place, end in zip(places.tolist(), ends, strict=True):
        start = int(truth.stamp_ns[place - 1])
        settling = settling_time(estimate.between(start, end), truth.between(start, end))
        time = float((truth.stamp_ns[place] - origin_ns) * 1e-9)
        changes.append(MassChange(time, float(truth.mass[place - 1]), float(truth.mass[place]), settling))
    return tuple(changes)
