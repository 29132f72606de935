"""The numbers of runs as tables: rows of text that the terminal and the report both show."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.figures.style import controller_title
from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.analysis.numbers.mass import MassMetrics
from cspr_control.analysis.numbers.metrics import Margin, RunMetrics
from cspr_control.analysis.run_analysis import RunAnalysis

NOT_KNOWN = "-"

_MARGINS = {
    "tension_min_n": ("lowest tension, above limit", "cable", "N"),
    "tension_max_n": ("highest tension, below limit", "cable", "N"),
    "torque_nm": ("torque, below limit", "motor", "N m"),
    "speed_rad_per_s": ("speed, below limit", "motor", "rad/s"),
    "workspace_m": ("distance to workspace border", "", "m"),
}


def summary_rows(runs: Sequence[RunAnalysis]) -> list[tuple[str, list[str]]]:
    """Return one row for each quantity: its name with unit, and a text for each run."""
    metrics = [run.metrics for run in runs]
    rows: list[tuple[str, list[str]]] = [
        ("controller", [controller_title(one.controller) for one in metrics]),
        ("trajectory", [one.trajectory for one in metrics]),
        ("payload", [run.load_text() for run in runs]),
        ("evaluated, s", [_number(one.duration, 2) for one in metrics]),
    ]
    for name, errors, digits in (
        ("position error, deg", [one.position_error for one in metrics], 2),
        ("velocity error, deg/s", [one.velocity_error for one in metrics], 1),
        ("tension less model, N", [one.tension_error for one in metrics], 1),
    ):
        rows.append((f"{name}: RMS, mean", [_mean(error, "rms", digits) for error in errors]))
        rows.append((f"{name}: median, mean", [_mean(error, "median", digits) for error in errors]))
        rows.append((f"{name}: maximum", [_largest(error, digits) for error in errors]))
    rows += _mass_rows([one.mass for one in metrics])
    rows.append(("saturated commands, %", [_saturation(one) for one in metrics]))
    for key, (name, part, unit) in _MARGINS.items():
        rows.append((f"{name}, {unit}", [_margin(one.margins.get(key), part) for one in metrics]))
    rows += _cycle_rows(metrics)
    rows.append(("energy supplied, J", [_number(float(one.energy.supplied.sum()), 0) for one in metrics]))
    rows.append(("energy returned, J", [_number(float(one.energy.returned.sum()), 0) for one in metrics]))
    rows.append(("work of the cables, J", [_number(one.energy.cables, 0) for one in metrics]))
    return rows


def motor_rows(run: RunAnalysis) -> list[tuple[str, NDArray[np.float64]]]:
    """Return one row for each quantity of each motor or cable of a run: its name with unit, and the numbers (m,)."""
    one = run.metrics
    rows: list[tuple[str, NDArray[np.float64]]] = []
    for name, error in (
        ("position error, deg", one.position_error),
        ("velocity error, deg/s", one.velocity_error),
        ("tension less model, N", one.tension_error),
    ):
        if error is not None:
            rows += [
                (f"{name}: RMS", error.rms),
                (f"{name}: median", error.median),
                (f"{name}: maximum", error.maximum),
            ]
    if one.tension_bias is not None:
        rows.append(("tension less model, N: mean", one.tension_bias))
    if one.saturation is not None:
        rows.append(("saturated commands, %", 100.0 * one.saturation.share))
    rows.append(("energy supplied, J", one.energy.supplied))
    rows.append(("energy returned, J", one.energy.returned))
    return rows


def format_runs(runs: Sequence[RunAnalysis]) -> str:
    """Return the tables for a terminal."""
    rows = summary_rows(runs)
    names = [controller_title(run.name) for run in runs]
    columns = [names, *(texts for _, texts in rows)]
    widths = [max(len(column[k]) for column in columns) + 2 for k in range(len(runs))]
    first = (
        max(len(text) for text in (*(name for name, _ in rows), *(f"{n}, by motor and cable" for n in names)))
        + 2
    )
    lines = ["".ljust(first) + "".join(name.rjust(w) for name, w in zip(names, widths, strict=True))]
    lines += [
        name.ljust(first) + "".join(text.rjust(w) for text, w in zip(texts, widths, strict=True))
        for name, texts in rows
    ]
    for run, name in zip(runs, names, strict=True):
        found = motor_rows(run)
        m = run.recording.robot.number_of_cables
        lines += [
            "",
            f"{name}, by motor and cable".ljust(first) + "".join(f"{k:>9}" for k in range(1, m + 1)),
        ]
        lines += [
            label.ljust(first) + "".join(f"{text:>9}" for text in row_texts(values))
            for label, values in found
        ]
    return "\n".join(line.rstrip() for line in lines)


def row_texts(values: NDArray[np.float64]) -> list[str]:
    """Return the numbers of a row (m,) as texts of the same number of decimals: three digits of the largest."""
    finite = np.abs(values[np.isfinite(values)])
    largest = float(finite.max(initial=0.0))
    decimals = 0 if largest < 1e-9 else min(max(2 - math.floor(math.log10(largest)), 0), 6)
    return [
        _number(0.0 if abs(value) < 0.5 * 10.0**-decimals else value, decimals) for value in values.tolist()
    ]


def _short(value: float) -> str:
    if not math.isfinite(value):
        return NOT_KNOWN
    if abs(value) < 1e-9:  # nothing but rounding
        return "0"
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else NOT_KNOWN


def _mean(error: ErrorStatistics | None, quantity: str, digits: int) -> str:
    return NOT_KNOWN if error is None else _number(float(getattr(error, quantity).mean()), digits)


def _largest(error: ErrorStatistics | None, digits: int) -> str:
    if error is None or not np.isfinite(error.maximum).any():
        return NOT_KNOWN
    worst = int(np.nanargmax(error.maximum))
    return f"{_number(float(error.maximum[worst]), digits)} ({worst + 1})"


def _mass_rows(metrics: Sequence[MassMetrics | None]) -> list[tuple[str, list[str]]]:
    def texts(read: str, digits: int) -> list[str]:
        return [NOT_KNOWN if one is None else _number(getattr(one, read), digits) for one in metrics]

    def settling(one: MassMetrics | None) -> str:
        if one is None or math.isnan(one.true):
            return NOT_KNOWN
        return "never" if one.settling is None else f"{one.settling:.2f}"

    return [
        ("mass estimated at the end, kg", texts("estimate", 1)),
        ("mass true at the end, kg", texts("true", 1)),
        ("mass bias, kg", texts("bias", 2)),
        ("mass noise, kg", texts("noise", 2)),
        ("mass within 2 % after, s", [settling(one) for one in metrics]),
    ]


def _saturation(metrics: RunMetrics) -> str:
    saturation = metrics.saturation
    return NOT_KNOWN if saturation is None else _number(100.0 * float(saturation.share.mean()), 2)


def _margin(margin: Margin | None, part: str) -> str:
    if margin is None:
        return NOT_KNOWN
    where = f" ({margin.index})" if part else ""
    return f"{_short(margin.margin)}{where}"


def _cycle_rows(metrics: Sequence[RunMetrics]) -> list[tuple[str, list[str]]]:
    def missed(cycles: int | None, count: int | None) -> str:
        if cycles is None or count is None:
            return NOT_KNOWN
        return f"{count} of {cycles} ({count / max(cycles, 1):.2%})"

    cycles = [one.cycle for one in metrics]
    return [
        ("cycle rate, Hz", [_number(one.rate, 1) for one in cycles]),
        (
            "cycle median / 99 % / longest, ms",
            [_triple(one.median_ms, one.p99_ms, one.longest_ms) for one in cycles],
        ),
        ("missed cycles", [missed(one.cycles, one.missed) for one in cycles]),
        (
            "unanswered states",
            [NOT_KNOWN if one.unanswered is None else str(one.unanswered) for one in cycles],
        ),
        (
            "latency median / 99 % / longest, us",
            [_triple(one.latency_p50_us, one.latency_p99_us, one.latency_max_us) for one in cycles],
        ),
    ]


def _triple(*values: float) -> str:
    return " / ".join(_short(value) for value in values) if math.isfinite(values[0]) else NOT_KNOWN
