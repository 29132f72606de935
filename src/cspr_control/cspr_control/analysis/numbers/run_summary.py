"""The summary of a run of the demo: motor position errors, the mass estimate, the cycle; as numbers and as a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspr_msgs_py.vocabulary import controller_label

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

MASS_TOLERANCE = 0.02  # of the true mass: the band in which the estimate must stay to count as settled


@dataclass(frozen=True)
class MassTrace:
    """A mass over time: stamps in ns (n,), kg (n,)."""

    stamp_ns: IntArray
    mass: FloatArray


@dataclass(frozen=True)
class CycleStatistics:
    """What the driver counted: cycles, missed ones, and the latency of the commands in microseconds."""

    rate_hz: float
    cycles: int
    missed_cycles: int
    latency_p50_us: float
    latency_p99_us: float
    latency_max_us: float


@dataclass(frozen=True)
class RunSummary:
    """The outcome of one run; angles in degrees as in the paper's Fig. 11, masses in kg of the payload alone."""

    controller: str
    exact_mass: bool
    trajectory: str
    rms_position_error_deg: tuple[float, ...]
    max_position_error_deg: tuple[float, ...]
    mass_true_final_kg: float
    mass_estimate_final_kg: float
    mass_settling_time_s: float | None
    cycle: CycleStatistics
    bag: str

    @property
    def mean_rms_deg(self) -> float:
        """Mean over the motors of the RMS position error, degrees."""
        return float(np.mean(self.rms_position_error_deg))

    @property
    def name(self) -> str:
        """The controller, with the mass that it was told."""
        return controller_label(self.controller, self.exact_mass)

    def as_mapping(self) -> dict[str, Any]:
        """Return the summary as it is stored in summary.json."""
        cycle = self.cycle
        return {
            "controller": self.controller,
            "exact_mass": self.exact_mass,
            "trajectory": self.trajectory,
            "rms_position_error_deg": list(self.rms_position_error_deg),
            "max_position_error_deg": list(self.max_position_error_deg),
            "mean_rms_position_error_deg": self.mean_rms_deg,
            "mass_true_final_kg": self.mass_true_final_kg,
            "mass_estimate_final_kg": self.mass_estimate_final_kg,
            "mass_settling_time_s": self.mass_settling_time_s,
            "rate_hz": cycle.rate_hz,
            "cycles": cycle.cycles,
            "missed_cycles": cycle.missed_cycles,
            "command_latency_us": {
                "p50": cycle.latency_p50_us,
                "p99": cycle.latency_p99_us,
                "max": cycle.latency_max_us,
            },
            "bag": self.bag,
        }


def settling_time(estimate: MassTrace, truth: MassTrace, tolerance: float = MASS_TOLERANCE) -> float | None:
    """Time from the last change of the true mass until the estimate is within a tolerance of it for good, s.

    None when it never is, and when the estimate's record ends before the change. With no change in the record, the
    time runs from the beginning of the estimate's record.
    """
    changes = np.flatnonzero(np.abs(np.diff(truth.mass)) > 1e-6)
    start = int(truth.stamp_ns[changes[-1] + 1]) if changes.size else int(estimate.stamp_ns[0])
    after = estimate.stamp_ns >= start
    if not after.any():
        return None
    final = float(truth.mass[-1])
    outside = np.abs(estimate.mass[after] - final) > tolerance * max(final, 1.0)
    if outside[-1]:
        return None
    stamps = estimate.stamp_ns[after]
    settled = stamps[np.flatnonzero(outside)[-1] + 1] if outside.any() else stamps[0]
    return float((settled - start) * 1e-9)


def verdict(summary: RunSummary) -> str:
    """Judge a run in one line: did the cycle hold, and did the estimate find the mass."""
    faults = []
    missed = summary.cycle.missed_cycles / max(summary.cycle.cycles, 1)
    if missed >= 0.005:
        faults.append(f"{missed:.2%} of the cycles were missed (limit 0.5 %)")
    true = summary.mass_true_final_kg
    error = abs(summary.mass_estimate_final_kg - true)
    if error > 0.01 * max(true, 1.0):
        faults.append(f"the mass estimate ended {error:.1f} kg off (limit 1 %)")
    if summary.mass_settling_time_s is None or summary.mass_settling_time_s > 3.0:
        faults.append("the mass estimate did not settle to 2 % within 3 s")
    return "good" if not faults else "not good: " + "; ".join(faults)


def format_summary(summary: RunSummary) -> str:
    """Return one run as a table for a terminal."""
    m = len(summary.rms_position_error_deg)
    settling = "never" if summary.mass_settling_time_s is None else f"{summary.mass_settling_time_s:.2f} s"
    cycle = summary.cycle
    row = "  {:<22}" + "{:>8}" * (m + 1)
    lines = [
        f"{summary.name} on {summary.trajectory}",
        row.format("position error (deg)", *(f"motor {k}" for k in range(1, m + 1)), "mean"),
        row.format(
            "  RMS", *(f"{e:.2f}" for e in summary.rms_position_error_deg), f"{summary.mean_rms_deg:.2f}"
        ),
        row.format(
            "  maximum",
            *(f"{e:.2f}" for e in summary.max_position_error_deg),
            f"{np.mean(summary.max_position_error_deg):.2f}",
        ),
        f"  payload               true {summary.mass_true_final_kg:.1f} kg, estimated "
        f"{summary.mass_estimate_final_kg:.1f} kg, within 2 % after {settling}",
        f"  control cycle         {cycle.rate_hz:.1f} Hz, {cycle.missed_cycles} of {cycle.cycles} cycles missed "
        f"({cycle.missed_cycles / max(cycle.cycles, 1):.3%})",
        f"  command latency       {cycle.latency_p50_us:.0f} us median, {cycle.latency_p99_us:.0f} us 99 %, "
        f"{cycle.latency_max_us:.0f} us maximum",
        f"  verdict               {verdict(summary)}",
    ]
    return "\n".join(lines)


def format_comparison(summaries: Sequence[RunSummary]) -> str:
    """Return several runs as one table: a line each."""
    m = len(summaries[0].rms_position_error_deg)
    row = "{:<22}" + "{:>8}" * (m + 1) + "{:>9}{:>11}{:>9}{:>9}"
    lines = [
        f"RMS position error in degrees on {summaries[0].trajectory}",
        row.format(
            "controller",
            *(f"motor {k}" for k in range(1, m + 1)),
            "mean",
            "max",
            "mass error",
            "settled",
            "missed",
        ),
    ]
    for run in summaries:
        settled = "never" if run.mass_settling_time_s is None else f"{run.mass_settling_time_s:.2f} s"
        lines.append(
            row.format(
                run.name,
                *(f"{e:.2f}" for e in run.rms_position_error_deg),
                f"{run.mean_rms_deg:.2f}",
                f"{max(run.max_position_error_deg):.2f}",
                f"{run.mass_estimate_final_kg - run.mass_true_final_kg:+.2f} kg",
                settled,
                f"{run.cycle.missed_cycles}/{run.cycle.cycles}",
            )
        )
    return "\n".join(lines)
