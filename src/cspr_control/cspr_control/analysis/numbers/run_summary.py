"""The summary of a run: what a user asks first of its metrics, under the keys of summary.json and as a table.

Nothing is computed here: each number is one of `RunMetrics`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cspr_control.analysis.numbers.cycles import CycleMetrics
from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.analysis.numbers.mass import LEAST_TOLERANCE, MassMetrics
from cspr_control.analysis.numbers.metrics import RunMetrics
from cspr_control.analysis.numbers.platform_error import PlatformMetrics, PoseDeviation
from cspr_control.analysis.recording import Window
from cspr_control.errors import ControlError
from cspr_msgs_py.json_file import plain
from cspr_msgs_py.vocabulary import controller_label


@dataclass(frozen=True, eq=False)
class RunSummary:
    """The outcome of one run: a view of its metrics.

    Attributes
    ----------
    controller, exact_mass, trajectory
        What was run.
    window
        The window of the numbers; the driver's counts have their own (`CycleMetrics.counted`).
    position_error
        Of each motor (m,), degrees at its shaft, as in the paper's Fig. 11.
    mass
        Of the payload alone.
    platform
        Of the true or measured pose; None if there is none.
    time_zero
        From which times count, the start of the first trajectory: ROS time, s.
    bag
        Where it is recorded; empty if it is not.
    cause
        The fault that stopped the robot, in words; empty if none did.
    """

    controller: str
    exact_mass: bool
    trajectory: str
    window: Window
    position_error: ErrorStatistics
    mass: MassMetrics
    cycle: CycleMetrics
    platform: PlatformMetrics | None = None
    time_zero: float = math.nan
    bag: str = ""
    cause: str = ""

    @classmethod
    def of(cls, metrics: RunMetrics, *, controller: str, exact_mass: bool, cause: str = "") -> RunSummary:
        """Return the summary of a recorded run that a fault stopped, in words, if one did.

        Raises
        ------
        ControlError
            If the recording lacks what the summary needs.
        """
        position, mass, cycle = metrics.position_error, metrics.mass, metrics.cycle
        lacking = [
            text
            for text, there in (
                ("a trajectory that was followed", metrics.window.name == "trajectory"),
                ("set-points on it", position is not None and bool(np.isfinite(position.rms).all())),
                ("the estimated and the true payload on it", mass is not None and math.isfinite(mass.true)),
            )
            if not there
        ]
        if lacking or position is None or mass is None:
            raise ControlError(f"{metrics.bag} lacks {', '.join(lacking)}: there is nothing to summarise")
        return cls(
            controller,
            exact_mass,
            metrics.trajectory,
            metrics.window,
            position,
            mass,
            cycle,
            metrics.platform,
            metrics.time_zero,
            metrics.bag,
            cause,
        )

    @property
    def name(self) -> str:
        """The controller, with the mass that it was given."""
        return controller_label(self.controller, self.exact_mass)

    @property
    def platform_deviations(self) -> tuple[PoseDeviation | None, PoseDeviation | None]:
        """The platform's error, and that of its estimated pose; None for what is not known."""
        return (None, None) if self.platform is None else (self.platform.error, self.platform.estimate)

    @property
    def mean_rms_deg(self) -> float:
        """Mean over the motors of the RMS position error, degrees."""
        return float(self.position_error.rms.mean())

    @property
    def missed_share(self) -> float:
        """Share of the control cycles that were missed."""
        return (self.cycle.missed or 0) / max(self.cycle.cycles or 0, 1)

    def as_mapping(self) -> dict[str, Any]:
        """Return the summary as it is stored in summary.json: over ``window``, where a number names no other."""
        cycle, mass = self.cycle, self.mass
        error, estimate = self.platform_deviations
        mapping: dict[str, Any] = plain(
            {
                "controller": self.controller,
                "exact_mass": self.exact_mass,
                "trajectory": self.trajectory,
                "time_zero": self.time_zero,
                "window": self.window,
                "platform_judged_by": self.platform and self.platform.judged_by,
                "rms_platform_error_mm": error and error.rms_mm,
                "max_platform_error_mm": error and error.max_mm,
                "mean_platform_error_z_mm": error and error.mean_mm[2],
                "rms_platform_rotation_error_deg": error and error.rotation_rms_deg,
                "max_platform_rotation_error_deg": error and error.rotation_max_deg,
                "rms_platform_estimate_error_mm": estimate and estimate.rms_mm,
                "max_platform_estimate_error_mm": estimate and estimate.max_mm,
                "rms_position_error_deg": self.position_error.rms,
                "max_position_error_deg": self.position_error.maximum,
                "mean_rms_position_error_deg": self.mean_rms_deg,
                "mass_true_final_kg": mass.true,
                "mass_estimate_final_kg": mass.estimate,
                "mass_settling_time_s": mass.settling,
                "rate_hz": cycle.rate,
                "cycles_window": cycle.counted,
                "cycles": cycle.cycles,
                "missed_cycles": cycle.missed,
                "command_latency_window": "since the drives were enabled",
                "command_latency_us": {
                    "p50": cycle.latency_p50_us,
                    "p99": cycle.latency_p99_us,
                    "max": cycle.latency_max_us,
                },
                "bag": self.bag,
                "cause": self.cause,
            }
        )
        return mapping


def verdict(summary: RunSummary) -> str:
    """Return in one line what stopped the robot, or whether the cycle held and the estimate found the mass."""
    if summary.cause:
        return f"stopped: {summary.cause}"
    faults = []
    if summary.missed_share >= 0.005:
        faults.append(f"{summary.missed_share:.2%} of the cycles were missed (limit 0.5 %)")
    mass = summary.mass
    error = abs(mass.estimate - mass.true)
    if error > max(0.01 * mass.true, LEAST_TOLERANCE):
        faults.append(
            f"the mass estimate ended {error:.1f} kg off (limit 1 %, {LEAST_TOLERANCE:g} kg at least)"
        )
    if mass.settling is None or mass.settling > 3.0:
        faults.append(f"the mass estimate did not settle to 2 % ({LEAST_TOLERANCE:g} kg at least) within 3 s")
    return "good" if not faults else "not good: " + "; ".join(faults)


def format_summary(summary: RunSummary) -> str:
    """Return one run as a table for a terminal."""
    errors, mass, cycle = summary.position_error, summary.mass, summary.cycle
    m = len(errors.rms)
    row = "  {:<22}" + "{:>8}" * (m + 1)
    lines = [
        f"{summary.name} on {summary.trajectory}",
        *_platform(summary),
        row.format("position error (deg)", *(f"motor {k}" for k in range(1, m + 1)), "mean"),
        row.format("  RMS", *(f"{e:.2f}" for e in errors.rms), f"{summary.mean_rms_deg:.2f}"),
        row.format("  maximum", *(f"{e:.2f}" for e in errors.maximum), f"{errors.maximum.mean():.2f}"),
        f"  payload               true {mass.true:.1f} kg, estimated {mass.estimate:z.1f} kg, "
        f"{'never within 2 %' if mass.settling is None else f'within 2 % after {_settled(mass)}'}",
        f"  control cycle         {cycle.rate:.1f} Hz, "
        + (
            "no driver to count its cycles"
            if cycle.cycles is None
            else f"{cycle.missed} of {cycle.cycles} cycles missed ({summary.missed_share:.3%})"
        ),
        *(
            []
            if math.isnan(cycle.latency_p50_us)
            else [
                f"  command latency       {cycle.latency_p50_us:.0f} us median, {cycle.latency_p99_us:.0f} us 99 %, "
                f"{cycle.latency_max_us:.0f} us maximum"
            ]
        ),
        f"  verdict               {verdict(summary)}",
    ]
    return "\n".join(lines)


def format_comparison(summaries: Sequence[RunSummary]) -> str:
    """Return several runs as one table, one line per run."""
    motors = [f"motor {k}" for k in range(1, len(summaries[0].position_error.rms) + 1)]
    row = "{:<22}{:>9}" + "{:>8}" * (len(motors) + 2) + "{:>11}{:>9}{:>9}"
    lines = [
        f"RMS position error on {summaries[0].trajectory}: of the platform in mm, of the motors in degrees",
        row.format("controller", "platform", *motors, "mean", "max", "mass error", "settled", "missed"),
    ]
    lines += [
        row.format(
            run.name,
            "-" if (error := run.platform_deviations[0]) is None else f"{error.rms_mm:.2f}",
            *(f"{e:.2f}" for e in run.position_error.rms),
            f"{run.mean_rms_deg:.2f}",
            f"{run.position_error.maximum.max():.2f}",
            f"{run.mass.estimate - run.mass.true:+z.2f} kg",
            _settled(run.mass),
            f"{run.cycle.missed}/{run.cycle.cycles}",
        )
        for run in summaries
    ]
    return "\n".join(lines)


def _platform(summary: RunSummary) -> list[str]:
    """Return what is said of the platform, one or two lines."""
    error, estimate = summary.platform_deviations
    if summary.platform is None or error is None:
        return ["  platform error        not known: there is no true or measured pose"]
    text = (
        f"  platform error        RMS {error.rms_mm:.2f} mm, maximum {error.max_mm:.2f} mm, mean in z "
        f"{error.mean_mm[2]:+z.2f} mm"
    )
    if math.isfinite(error.rotation_rms_deg):
        text += f", turned by {error.rotation_rms_deg:.3f} deg RMS"
    lines = [f"{text}, by {summary.platform.judged_by}"]
    if estimate is not None:
        lines.append(
            f"  estimated pose        RMS {estimate.rms_mm:.2f} mm, maximum {estimate.max_mm:.2f} mm off that"
        )
    return lines


def _settled(mass: MassMetrics) -> str:
    return "never" if mass.settling is None else f"{mass.settling:.2f} s"
