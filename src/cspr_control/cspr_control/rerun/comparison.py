"""A re-run against what was recorded, as numbers and as text."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.numbers.mass import mass_metrics, mass_trace
from cspr_control.analysis.timeline import Clock, Timeline
from cspr_msgs_py.bag.columns import Inertias, JointStates


@dataclass(frozen=True)
class Difference:
    """Re-run minus recorded, over all values of matching messages; zeros if nothing matches."""

    maximum: float
    rms: float

    @staticmethod
    def of(values: NDArray[np.float64]) -> Difference:
        """Return the size of some differences."""
        rms = np.sqrt((values**2).sum() / max(values.size, 1))
        return Difference(float(np.abs(values).max(initial=0.0)), float(rms))


@dataclass(frozen=True)
class MassQuality:
    """An estimate against the truth: time to settle to 2 % after the last change (s; None: never), final error (kg)."""

    settling_time: float | None
    final_error: float


@dataclass(frozen=True)
class PayloadComparison:
    """The estimates; counts of messages, kg and m."""

    recorded: int
    rerun: int
    matched: int
    mass: Difference | None
    center_of_mass: Difference | None
    recorded_quality: MassQuality | None
    rerun_quality: MassQuality | None


@dataclass(frozen=True)
class SetpointComparison:
    """The set-points; counts of messages, rad, rad/s and N m.

    ``identical`` counts messages whose every number is the same, ``identical_after`` is the time after the first
    message from which all are (s; None: never).
    """

    recorded: int
    rerun: int
    matched: int
    identical: int
    identical_after: float | None
    position: Difference | None
    velocity: Difference | None
    effort: Difference | None


def compare_payloads(
    rerun: Inertias,
    recorded: Inertias | None,
    truth: Inertias | None,
    clock: Clock,
    timeline: Timeline,
) -> PayloadComparison:
    """Compare estimates; those of one stamp belong together, and while the estimate is held it keeps its stamp.

    Parameters
    ----------
    rerun, recorded
        Re-run and recorded estimates, these None if there are none.
    truth
        What a simulated robot carried.
    clock
        Turns times of the recorder into those of the robot, ns.
    timeline
        What happened: the estimates count on trajectories, as in the analysis.
    """
    mass = center = None
    matched = 0
    if recorded is not None:
        stamps, ours, theirs = np.intersect1d(rerun.time_ns, recorded.time_ns, return_indices=True)
        matched = len(stamps)
        mass = Difference.of(rerun.mass[ours] - recorded.mass[theirs])
        center = Difference.of(rerun.center_of_mass[ours] - recorded.center_of_mass[theirs])
    return PayloadComparison(
        0 if recorded is None else len(recorded.mass),
        len(rerun.mass),
        matched,
        mass,
        center,
        *(
            None if estimate is None or truth is None else _quality(estimate, truth, clock, timeline)
            for estimate in (recorded, rerun)
        ),
    )


def _quality(
    estimate: Inertias,
    truth: Inertias,
    clock: Clock,
    timeline: Timeline,
) -> MassQuality | None:
    estimated, true = (
        mass_trace(timeline, replace(each, log_time_ns=clock(each.log_time_ns))) for each in (estimate, truth)
    )
    found = mass_metrics(estimated, true, 0)
    if found is None or math.isnan(found.true):
        return None
    return MassQuality(found.settling, found.estimate - found.true)


def compare_setpoints(rerun: JointStates, recorded: JointStates | None, since: int = 0) -> SetpointComparison:
    """Compare set-points; those of one stamp belong together. Those re-run before a time, ns, do not count."""
    if recorded is None:
        return SetpointComparison(0, len(rerun.time_ns), 0, 0, None, None, None, None)
    stamps, ours, theirs = np.intersect1d(rerun.time_ns, recorded.time_ns, return_indices=True)
    counting = rerun.log_time_ns[ours] >= since
    stamps, ours, theirs = (each[counting] for each in (stamps, ours, theirs))
    differences = {
        field: getattr(rerun, field)[ours] - getattr(recorded, field)[theirs]
        for field in ("position", "velocity", "effort")
    }
    different = np.zeros(len(stamps), dtype=bool)
    for values in differences.values():
        different |= (values != 0.0).any(axis=1)
    last = int(np.flatnonzero(different)[-1]) + 1 if different.any() else 0
    after = None if last >= len(stamps) else float((stamps[last] - stamps[0]) * 1e-9)
    return SetpointComparison(
        len(recorded.time_ns),
        len(rerun.time_ns),
        len(stamps),
        int((~different).sum()),
        after,
        **{field: Difference.of(values) for field, values in differences.items()},
    )


@dataclass(frozen=True)
class Comparison:
    """What a re-run changed."""

    parameters: dict[str, dict[str, Any]]  # those given otherwise, by node.name: recorded and rerun
    payload: PayloadComparison | None
    setpoint: SetpointComparison | None


def format_comparison(comparison: Comparison) -> str:
    """Return the comparison as some lines of text."""
    lines = [
        f"  {name:<38}{values['rerun']} (recorded with {values['recorded']})"
        for name, values in comparison.parameters.items()
    ] or ["  parameters as recorded"]
    if comparison.payload is not None:
        lines += _payload_lines(comparison.payload)
    if comparison.setpoint is not None:
        lines += _setpoint_lines(comparison.setpoint)
    return "\n".join(lines)


def _payload_lines(payload: PayloadComparison) -> list[str]:
    lines = [f"  /payload     {payload.rerun} estimates, {payload.recorded} recorded"]
    if payload.mass is not None and payload.center_of_mass is not None:
        lines.append(
            f"    mass       differs by {payload.mass.rms:.2g} kg RMS, {payload.mass.maximum:.2g} kg at most; "
            f"centre by {payload.center_of_mass.maximum * 1e3:.2g} mm at most"
        )
    for name, quality in (("recorded", payload.recorded_quality), ("re-run", payload.rerun_quality)):
        if quality is not None:
            time = quality.settling_time
            settled = "never within 2 %" if time is None else f"within 2 % after {time:.2f} s"
            lines.append(f"    {name:<10} {settled}, {quality.final_error:+z.2f} kg off at the end")
    return lines


def _setpoint_lines(setpoint: SetpointComparison) -> list[str]:
    lines = [f"  /setpoint    {setpoint.rerun} set-points, {setpoint.recorded} recorded"]
    if setpoint.position is None or setpoint.velocity is None or setpoint.effort is None:
        return lines
    since = (
        "" if setpoint.identical_after in (None, 0.0) else f", all from {setpoint.identical_after:.2f} s on"
    )
    return [
        *lines,
        f"    identical  {setpoint.identical} of {setpoint.matched} to the last bit{since}",
        f"    torque     differs by {setpoint.effort.rms:.2g} N m RMS, {setpoint.effort.maximum:.2g} N m at most",
        f"    angle      differs by {setpoint.position.maximum:.2g} rad at most, "
        f"speed by {setpoint.velocity.maximum:.2g} rad/s",
    ]
