"""Figures 7 to 12 of the paper, drawn from plain arrays: from a simulation study or from a recorded run.

Every function returns a matplotlib figure in the style of :mod:`cspr_control.analysis.figures.style`; draw and store
inside its :func:`~cspr_control.analysis.figures.style.house_style`. Angles are degrees, as in the paper, everything
else SI. Motors and cables are the last axis of an array, in the order of ``robot.yaml``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cspr_control.analysis.figures.style import (
    COLOURS,
    EVENT_COLOUR,
    REFERENCE_COLOUR,
    WIDTH,
    controller_line,
    controller_title,
    motor_line,
)
from cspr_control.analysis.numbers.error_statistics import ErrorStatistics, before_and_after

Floats = NDArray[np.float64]


def trajectory_figure(
    time: Floats,
    position: Floats,
    tilt: Floats | None = None,
    measured: tuple[Floats, ...] | None = None,
    title: str = "Test trajectory",
) -> Figure:
    """Fig. 7: the path in space, and its coordinates over time.

    Parameters
    ----------
    time, position
        Of the reference: (n,), s, and (n, 3) in base, m.
    tilt
        Angles alpha, beta, gamma of eq. 4 (n, 3), degrees; drawn if the platform turns at all.
    measured
        Times and positions where the platform was, as it was estimated.
    """
    turns = tilt is not None and float(np.ptp(tilt, axis=0).max()) > 0.01
    figure = Figure(figsize=(WIDTH, 4.2 if turns else 3.3), layout="constrained")
    halves: Any = figure.subfigures(1, 2, width_ratios=(1.0, 1.1))
    left, right = halves
    space: Any = left.add_subplot(projection="3d")
    space.plot(*position.T, color=REFERENCE_COLOUR, linewidth=1.6, label="reference")
    if measured is not None:
        space.plot(*measured[1].T, color=COLOURS[0], linewidth=0.9, label="measured")
        space.legend(loc="upper left")
    space.scatter(*position[0], color=COLOURS[2], s=24)
    space.set(xlabel="x, m", ylabel="y, m", zlabel="z, m", title=title)
    space.tick_params(labelsize=7)
    space.xaxis.labelpad = space.yaxis.labelpad = 9
    span = np.maximum(1.05 * np.ptp(position, axis=0), 0.1)
    span = np.maximum(span, 0.2 * span.max())  # a thin box would have no room for its numbers
    middle = (position.min(axis=0) + position.max(axis=0)) / 2.0
    raised = position[0] + [0.0, 0.0, 0.12 * span[2]]
    space.text(*raised, "start", fontsize=8, ha="center", va="bottom")
    for name, low, high in zip("xyz", middle - span / 2.0, middle + span / 2.0, strict=True):
        space.set(**{f"{name}lim": (low, high)})
        space.locator_params(axis=name, nbins=max(2, round(5.0 * (high - low) / span.max())))
    space.set_box_aspect(span / span.max(), zoom=0.78)
    axes = np.atleast_1d(right.subplots(2 if turns else 1, 1, sharex=True))
    _draw_coordinates(axes[0], time, position, measured)
    if turns and tilt is not None:
        for column, name in ((0, "alpha (z)"), (1, "beta (y)"), (2, "gamma (x)")):
            axes[1].plot(time, tilt[:, column], color=COLOURS[column], label=name)
        axes[1].set(ylabel="angle, deg")
        axes[1].legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    axes[-1].set(xlabel="time, s")
    return figure


def _draw_coordinates(axis: Any, time: Floats, position: Floats, measured: tuple[Floats, ...] | None) -> None:
    shown_time, shown = (time, position) if measured is None else measured
    for column, name in enumerate("xyz"):
        if measured is not None:
            axis.plot(time, position[:, column], color=REFERENCE_COLOUR, linewidth=2.0)
        axis.plot(shown_time, shown[:, column], color=COLOURS[column], label=name)
    axis.set(ylabel="position, m")
    axis.legend(ncols=3, loc="lower center", bbox_to_anchor=(0.5, 1.0))


def tension_figure(
    time: Floats,
    dynamic: Floats,
    static: Floats,
    title: str = "Dynamic model",
    changes: Mapping[float, str] | None = None,
) -> Figure:
    """Fig. 8: tension of each cable by the dynamic model, and its deviation from the static model.

    Parameters
    ----------
    time
        (n,), s.
    dynamic, static
        Tensions (n, m) by the two models, N.
    changes
        When the payload changes, s, and how, such as ``+100 kg``.
    """
    above = (dynamic, title, "tension, N")
    below = (dynamic - static, "Deviation, dynamic minus static model", "tension, N")
    return two_panels(time, above, below, changes=changes)


def deviation_figure(statistics: Mapping[str, ErrorStatistics]) -> Figure:
    """Fig. 9: maximum, median and RMS of the models' deviation for each cable, side by side by trajectory or run."""
    figure = Figure(figsize=(WIDTH, 5.2), layout="constrained")
    axes = figure.subplots(3, 1, sharex=True)
    for axis, quantity in zip(axes, ("maximum", "median", "rms"), strict=True):
        values = {name: getattr(one, quantity) for name, one in statistics.items()}
        draw_bars(axis, values)
        axis.set(ylabel="tension, N", title="RMS" if quantity == "rms" else quantity.capitalize())
        axis.set_ylim(bottom=0.0)
    if len(statistics) > 1:
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(statistics))
    axes[0].set_title("Deviation of the dynamic from the static model: maximum")
    axes[-1].set(xlabel="cable")
    return figure


def payload_change_figure(
    time: Floats, deviation: Floats, change_time: float, cable: int = 1, unit_change: str = "payload changes"
) -> Figure:
    """Fig. 10: one cable's deviation between the models before and after the payload changes.

    Parameters
    ----------
    time
        (n,), s.
    deviation
        Dynamic less static tension of the cable (n,), N.
    change_time
        When the payload changes, s.
    cable
        Its number, counted from 1.
    unit_change
        What happens then, such as ``+100 kg``.
    """
    figure = Figure(figsize=(WIDTH, 3.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    left.plot(time, deviation, color=COLOURS[0])
    left.set(xlabel="time, s", ylabel="tension, N", title=f"Cable {cable}: dynamic minus static model")
    mark_times(left, {change_time: unit_change})
    groups = {
        "delta = before - after" if name == "delta" else name: np.array(
            [one.maximum[0], one.median[0], one.rms[0]]
        )
        for name, one in before_and_after(time, deviation[:, None], change_time).items()
    }
    draw_bars(right, groups, ("maximum", "median", "RMS"), colours=(COLOURS[4], COLOURS[0], EVENT_COLOUR))
    right.axhline(0.0, color="#444444", linewidth=0.8)
    right.set(ylabel="deviation, N")
    right.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3, columnspacing=0.8, handlelength=1.0)
    return figure


def motor_error_figure(errors: Mapping[str, Mapping[float, Floats]]) -> Figure:
    """Fig. 11: RMS position error of motors 1 to m (left to right) against load, for each controller.

    Parameters
    ----------
    errors
        By controller, then by load in kg: RMS errors (m,), degrees.
    """
    count = len(errors)
    columns = min(count, 3)
    rows = -(-count // columns)
    figure = Figure(figsize=(WIDTH, 0.5 + 2.2 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, sharey=True, squeeze=False)
    for axis, (controller, loads) in zip(axes.flat, errors.items(), strict=False):
        order = sorted(loads)
        m = len(loads[order[0]])
        width = 0.84 / m
        for k in range(m):
            heights = [loads[load][k] for load in order]
            places = np.arange(len(order)) + (k - (m - 1) / 2) * width
            axis.bar(places, heights, width * 0.9, color=motor_line(k)["color"], label=f"{k + 1}")
        axis.set_xticks(range(len(order)), [f"{load:g}" for load in order])
        axis.set(title=controller_title(controller), xlabel="load, kg")
        axis.grid(axis="x", visible=False)
    for axis in axes[:, 0]:
        axis.set(ylabel="RMS position error, deg")
    for axis in axes.flat[count:]:
        axis.set_visible(False)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), title="motor")
    return figure


def motor_error_over_time_figure(
    errors: Mapping[str, Mapping[str, tuple[Floats, Floats]]],
    motor: int = 3,
    changes: Mapping[str, Mapping[float, str]] | None = None,
) -> Figure:
    """Fig. 12: position error of one motor over time, one panel for each load and one line for each controller.

    Parameters
    ----------
    errors
        By title of the panel (such as ``100 kg``), then by controller: times (n,), s, and errors (n,), degrees.
    motor
        Its number, counted from 1.
    changes
        By title of the panel: when something changes there, s, and what, such as ``+100 kg``.
    """
    rows = len(errors)
    figure = Figure(figsize=(WIDTH, 0.7 + 1.9 * rows), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    known = list(dict.fromkeys(name for panel in errors.values() for name in panel))
    handles: dict[str, Any] = {}
    for axis, (title, panel) in zip(axes, errors.items(), strict=True):
        for controller, (time, error) in panel.items():
            line = controller_line(controller, known.index(controller))
            (handles[controller],) = axis.plot(time, error, label=controller_title(controller), **line)
        axis.set(ylabel="error, deg", title=f"Motor {motor} position error, {title}")
        mark_times(axis, (changes or {}).get(title))
    axes[-1].set(xlabel="time, s")
    figure.legend(
        list(handles.values()), [controller_title(name) for name in handles],
        loc="outside lower center", ncols=min(len(handles), 5),
    )  # fmt: skip
    return figure


def two_panels(
    time: Floats,
    above: tuple[Floats, str, str],
    below: tuple[Floats, str, str],
    changes: Mapping[float, str] | None = None,
    name: str = "cable",
) -> Figure:
    """Draw two quantities of each cable or motor over time (n,), s: values (n, m), title and label of each."""
    figure = Figure(figsize=(WIDTH, 4.6), layout="constrained")
    axes = figure.subplots(2, 1, sharex=True)
    for axis, (values, title, label) in zip(axes, (above, below), strict=True):
        for k in range(values.shape[1]):
            axis.plot(time, values[:, k], label=f"{name} {k + 1}", **motor_line(k))
        axis.set(ylabel=label, title=title)
        mark_times(axis, changes, label=axis is axes[0])
    axes[0].legend(loc="upper left", bbox_to_anchor=(1.0, 1.03), handlelength=1.4)
    axes[1].set(xlabel="time, s")
    return figure


def draw_bars(
    axis: Any,
    groups: Mapping[str, Floats],
    names: tuple[str, ...] | None = None,
    colours: tuple[str, ...] = COLOURS,
) -> None:
    """Draw bars side by side: a cluster for each place of the arrays, a bar in it for each group."""
    count = len(next(iter(groups.values())))
    width = 0.8 / len(groups)
    for index, (name, values) in enumerate(groups.items()):
        places = np.arange(count) + (index - (len(groups) - 1) / 2) * width
        axis.bar(places, values, width * 0.92, color=colours[index % len(colours)], label=name)
    axis.set_xticks(range(count), names or [str(k + 1) for k in range(count)])
    axis.grid(axis="x", visible=False)


def mark_times(axis: Any, changes: Mapping[float, str] | None, label: bool = True) -> None:
    """Mark moments (s) with vertical lines, and their texts beside them."""
    for time, text in (changes or {}).items():
        axis.axvline(time, color=EVENT_COLOUR, linestyle=":", linewidth=1.1)
        if label:
            axis.annotate(
                f" {text}",
                (time, 1.0),
                xycoords=("data", "axes fraction"),
                va="top",
                color=EVENT_COLOUR,
                fontsize=8,
            )
