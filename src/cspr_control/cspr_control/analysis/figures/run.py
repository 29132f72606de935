"""Figures of a recorded run that the paper mentions without showing; from plain arrays, in the same style.

Angles are degrees, everything else SI. Motors and cables are the last axis of an array.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cspr_control.analysis.figures.paper import mark_times
from cspr_control.analysis.figures.style import (
    COLOURS,
    EVENT_COLOUR,
    REFERENCE_COLOUR,
    WIDTH,
    controller_colour,
    controller_title,
    motor_line,
)
from cspr_control.analysis.numbers.cycles import cycle_bins

Floats = NDArray[np.float64]

_CYCLE_BINS = 120  # at most


def platform_error_figure(
    time: Floats, error: Floats, angle: Floats | None = None, changes: Mapping[float, str] | None = None
) -> Figure:
    """How far the platform was from where it should be.

    Parameters
    ----------
    time
        (n,), s.
    error
        True or measured less wanted position along x, y and z, and the distance (n, 4), mm.
    angle
        By which it was turned (n,), degrees.
    changes
        When the payload changes, s, and how, such as ``+100 kg``.
    """
    figure = Figure(figsize=(WIDTH, 3.0 if angle is None else 4.6), layout="constrained")
    axes = figure.subplots(1 if angle is None else 2, 1, sharex=True, squeeze=False)[:, 0]
    for k, name in enumerate("xyz"):
        axes[0].plot(time, error[:, k], color=COLOURS[k], linewidth=0.9, label=name)
    axes[0].plot(time, error[:, 3], color=REFERENCE_COLOUR, linewidth=1.1, label="distance")
    axes[0].set(ylabel="error, mm", title="Platform error: true or measured less wanted position")
    axes[0].legend(ncols=4, loc="best")
    if angle is not None:
        axes[1].plot(time, angle, color=COLOURS[0], linewidth=0.9)
        axes[1].set(ylabel="angle, deg", title="Platform turned")
    for axis in axes:
        mark_times(axis, changes, label=axis is axes[0])
    axes[-1].set(xlabel="time, s")
    return figure


def measured_tensions_figure(
    time: Floats, measured: Floats, predicted: Floats, changes: Mapping[float, str] | None = None
) -> Figure:
    """Tension of each cable as measured and as the dynamic model predicts it, one panel for each cable.

    Parameters
    ----------
    time
        (n,), s.
    measured, predicted
        (n, m), N.
    changes
        When the payload changes, s, and how, such as ``+100 kg``.
    """
    m = measured.shape[1]
    rows = -(-m // 2)
    figure = Figure(figsize=(WIDTH, 0.6 + 1.3 * rows), layout="constrained")
    axes = figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False)
    low, high = _visible(np.concatenate((measured, predicted)))
    for k in range(m):
        axis = axes[k // 2, k % 2]
        (line,) = axis.plot(time, measured[:, k], color=motor_line(k)["color"], linewidth=0.8)
        (model,) = axis.plot(time, predicted[:, k], color="#444444", linewidth=0.9, linestyle="--")
        axis.set_title(f"cable {k + 1}", fontsize=8.5)
        axis.set_ylim(low, high)
        mark_times(axis, changes, label=k < 2)
        if k == 0:
            figure.legend([line, model], ["measured", "dynamic model"], loc="outside lower center", ncols=2)
    for axis in axes[:, 0]:
        axis.set(ylabel="tension, N")
    for axis in axes[-1]:
        axis.set(xlabel="time, s")
    for axis in axes.flat[m:]:
        axis.set_visible(False)
    return figure


def _visible(values: Floats) -> tuple[float, float]:
    """Return limits that show nearly all values well; single peaks may leave the picture."""
    low, high = np.nanquantile(values, (0.002, 0.998))
    margin = 0.08 * max(float(high - low), 1.0)
    return float(low) - margin, float(high) + margin


def mass_figure(
    runs: Mapping[str, tuple[Floats, Floats]], truth: Mapping[str, tuple[Floats, Floats]]
) -> Figure:
    """Estimated mass of the payload against the true one, kg; runs by name, times in s."""
    figure = Figure(figsize=(WIDTH, 4.2 if truth else 2.8), layout="constrained")
    axes = figure.subplots(2 if truth else 1, 1, sharex=True, squeeze=False)[:, 0]
    for index, (name, (time, mass)) in enumerate(runs.items()):
        colour = controller_colour(name, index)
        axes[0].plot(time, mass, color=colour, label=f"estimated, {controller_title(name)}")
        if name in truth:
            known_time, known = truth[name]
            place = np.maximum(np.searchsorted(known_time, time, side="right") - 1, 0)
            axes[1].plot(time, mass - known[place], color=colour)
    for index, (known_time, known) in enumerate(truth.values()):
        style = {"label": "true"} if index == 0 else {}
        axes[0].step(
            known_time, known, where="post", color=REFERENCE_COLOUR, linestyle="--", zorder=3, **style
        )
    axes[0].set(ylabel="mass, kg", title="Payload")
    axes[0].set_ylim(bottom=min(0.0, axes[0].get_ylim()[0]))
    axes[0].legend(loc="lower right")
    if truth:
        axes[1].axhline(0.0, color=REFERENCE_COLOUR, linewidth=0.8)
        axes[1].set(ylabel="mass, kg", title="Estimated minus true mass")
    axes[-1].set(xlabel="time, s")
    return figure


def cycle_histogram_figure(periods: Mapping[str, Floats], nominal: float) -> Figure:
    """How long the control cycles were; periods in s by run, and the nominal one."""
    figure = Figure(figsize=(WIDTH, 3.0), layout="constrained")
    axis = figure.subplots()
    longest = max((float(p.max()) for p in periods.values() if p.size), default=nominal)
    bins = 1e3 * cycle_bins(max(1.5 * nominal, longest), _CYCLE_BINS)
    for index, (name, period) in enumerate(periods.items()):
        colour = controller_colour(name, index)
        counts, edges = np.histogram(1e3 * period, bins)
        axis.stairs(counts, edges, color=colour, fill=len(periods) == 1, label=controller_title(name))
    axis.axvline(1e3 * nominal, color=EVENT_COLOUR, linestyle=":", label=f"nominal, {1e3 * nominal:g} ms")
    axis.set_yscale("symlog", linthresh=1.0)
    axis.set_ylim(bottom=0.0)
    axis.set(xlabel="time between motor states, ms", ylabel="cycles", title="Control cycle")
    axis.legend(loc="upper right")
    return figure
