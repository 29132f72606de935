"""The numbers of runs as tables: rows of text that the terminal and the report both show."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.figures.style import controller_title
from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.analysis.numbers.mass import MassMetrics
from cspr_control.analysis.numbers.metrics import Margin
from cspr_control.analysis.numbers.platform_error import PlatformMetrics, PoseDeviation
from cspr_control.analysis.recording import recorded_time
from cspr_control.analysis.run_analysis import RunAnalysis

NOT_KNOWN = "-"

_ERRORS = (  # with their attribute of `RunMetrics`, and decimals
    ("motor position error, deg", "position_error", 2),
    ("motor velocity error, deg/s", "velocity_error", 1),
    ("measured minus model tension, N", "tension_error", 1),
)
_MARGINS = {
    "tension_min_n": ("margin to the lower tension limit", "cable", "N"),
    "tension_max_n": ("margin to the upper tension limit", "cable", "N"),
    "torque_nm": ("margin to the torque limit", "motor", "N m"),
    "speed_rad_per_s": ("margin to the speed limit", "motor", "rad/s"),
    "workspace_m": ("margin to the workspace border", "", "m"),
}
_NO_DEVIATION = PoseDeviation(math.nan, math.nan, math.nan, np.full(3, np.nan), math.nan, math.nan)
_NO_MASS = MassMetrics(math.nan, math.nan, math.nan, math.nan, math.nan, (), None)


def summary_rows(runs: Sequence[RunAnalysis]) -> list[tuple[str, list[str]]]:
    """Return one row for each quantity: its name with unit, and a text for each run."""
    columns = [_summary(run) for run in runs]
    return [(name, [column[name] for column in columns]) for name in columns[0]]


def _summary(run: RunAnalysis) -> dict[str, str]:
    """Return the numbers of one run as texts, by quantity with unit."""
    one = run.metrics
    texts = {
        "controller": controller_title(one.controller),
        "trajectory": one.trajectory,
        "payload": run.load_text(),
        "time zero, UTC": recorded_time(run.recording.origin_ns),
        "time zero, s since 1970": f"{one.time_zero:.3f}",
        "evaluated, s": _number(one.duration, 2),
    }
    texts |= _platform(one.platform)
    for name, attribute, digits in _ERRORS:
        error: ErrorStatistics | None = getattr(one, attribute)
        texts |= {
            f"{name}: RMS, mean": NOT_KNOWN if error is None else _number(error.rms.mean(), digits),
            f"{name}: median, mean": NOT_KNOWN if error is None else _number(error.median.mean(), digits),
            f"{name}: maximum": _largest(error, digits),
        }
    mass, cycle, energy = one.mass or _NO_MASS, one.cycle, one.energy
    settling = "never" if mass.settling is None else f"{mass.settling:.2f}"
    saturated = math.nan if one.saturation is None else 100.0 * one.saturation.share.mean()
    texts |= {
        "mass estimated at the end, kg": _number(mass.estimate, 1),
        "mass true at the end, kg": _number(mass.true, 1),
        "mass bias, kg": _number(mass.bias, 2),
        "mass noise, kg": _number(mass.noise, 2),
        "mass within 2 % after, s": NOT_KNOWN if math.isnan(mass.true) else settling,
        "saturated commands, %": _number(saturated, 2),
    }
    for key, (name, part, unit) in _MARGINS.items():
        texts[f"{name}, {unit}"] = _margin(one.margins.get(key), part)
    missed = NOT_KNOWN
    if cycle.cycles is not None and cycle.missed is not None:
        missed = f"{cycle.missed} of {cycle.cycles} ({cycle.missed / max(cycle.cycles, 1):.2%})"
    latency = _triple(cycle.latency_p50_us, cycle.latency_p99_us, cycle.latency_max_us)
    return texts | {
        "cycle rate, Hz": _number(cycle.rate, 1),
        "cycle median / 99 % / longest, ms": _triple(cycle.median_ms, cycle.p99_ms, cycle.longest_ms),
        "missed cycles": missed,
        "unanswered states": NOT_KNOWN if cycle.unanswered is None else str(cycle.unanswered),
        "latency median / 99 % / longest, us": latency,
        "energy supplied, J": _number(energy.supplied.sum(), 0),
        "energy returned, J": _number(energy.returned.sum(), 0),
        "work of the cables, J": _number(energy.cables, 0),
    }


def _platform(platform: PlatformMetrics | None) -> dict[str, str]:
    error = _NO_DEVIATION if platform is None else platform.error or _NO_DEVIATION
    estimate = _NO_DEVIATION if platform is None else platform.estimate or _NO_DEVIATION
    return {
        "platform judged by": NOT_KNOWN if platform is None else platform.judged_by,
        "platform error, mm: RMS": _number(error.rms_mm, 2),
        "platform error, mm: maximum": _number(error.max_mm, 2),
        "platform error, mm: mean in x / y / z": _triple(*error.mean_mm.tolist()),
        "platform turned, deg: RMS": _number(error.rotation_rms_deg, 3),
        "platform turned, deg: maximum": _number(error.rotation_max_deg, 3),
        "estimated pose's error, mm: RMS": _number(estimate.rms_mm, 2),
        "estimated pose's error, mm: maximum": _number(estimate.max_mm, 2),
    }


def motor_rows(run: RunAnalysis) -> list[tuple[str, NDArray[np.float64]]]:
    """Return one row for each quantity of each motor or cable of a run: its name with unit, and the numbers (m,)."""
    one = run.metrics
    rows: list[tuple[str, NDArray[np.float64]]] = []
    for name, attribute, _ in _ERRORS:
        error: ErrorStatistics | None = getattr(one, attribute)
        if error is not None:
            rows += [
                (f"{name}: RMS", error.rms),
                (f"{name}: median", error.median),
                (f"{name}: maximum", error.maximum),
            ]
    if one.tension_bias is not None:
        rows.append(("measured minus model tension, N: mean", one.tension_bias))
    if one.saturation is not None:
        rows.append(("saturated commands, %", 100.0 * one.saturation.share))
    rows.append(("energy supplied, J", one.energy.supplied))
    rows.append(("energy returned, J", one.energy.returned))
    return rows


def format_runs(runs: Sequence[RunAnalysis]) -> str:
    """Return the tables for a terminal."""
    rows = summary_rows(runs)
    names = [controller_title(run.name) for run in runs]
    headings = [f"{name}, by motor and cable" for name in names]
    first = max(len(text) for text in (*(name for name, _ in rows), *headings)) + 2

    def line(name: str, texts: Sequence[str], widths: Sequence[int]) -> str:
        return name.ljust(first) + "".join(text.rjust(w) for text, w in zip(texts, widths, strict=True))

    columns = [names, *(texts for _, texts in rows)]
    widths = [max(len(column[k]) for column in columns) + 2 for k in range(len(runs))]
    lines = [line(name, texts, widths) for name, texts in (("", names), *rows)]
    for run, heading in zip(runs, headings, strict=True):
        m = run.recording.robot.number_of_cables
        lines += ["", line(heading, [str(k) for k in range(1, m + 1)], m * [9])]
        lines += [line(name, row_texts(values), m * [9]) for name, values in motor_rows(run)]
    return "\n".join(line.rstrip() for line in lines)


def row_texts(values: NDArray[np.float64]) -> list[str]:
    """Return the numbers of a row (m,) as texts of the same number of decimals: three digits of the largest."""
    finite = np.abs(values[np.isfinite(values)])
    largest = float(finite.max(initial=0.0))
    decimals = 0 if largest < 1e-9 else min(max(2 - math.floor(math.log10(largest)), 0), 6)
    return [_number(value, decimals) for value in values.tolist()]


def _short(value: float) -> str:
    if not math.isfinite(value):
        return NOT_KNOWN
    if abs(value) < 1e-9:  # nothing but rounding
        return "0"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _number(value: float, digits: int) -> str:
    return f"{value:z.{digits}f}" if math.isfinite(value) else NOT_KNOWN


def _largest(error: ErrorStatistics | None, digits: int) -> str:
    if error is None or not np.isfinite(error.maximum).any():
        return NOT_KNOWN
    worst = int(np.nanargmax(error.maximum))
    return f"{_number(float(error.maximum[worst]), digits)} ({worst + 1})"


def _margin(margin: Margin | None, part: str) -> str:
    if margin is None:
        return NOT_KNOWN
    where = f" ({margin.index})" if part else ""
    return f"{_short(margin.margin)}{where}"


def _triple(*values: float) -> str:
    return " / ".join(_short(value) for value in values) if math.isfinite(values[0]) else NOT_KNOWN
