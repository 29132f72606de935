"""One self-contained page about one or more recorded runs: numbers, figures, the robot in motion, the configuration."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from datetime import UTC, datetime
from importlib import resources
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.configuration import describe, differences, parsed
from cspr_control.analysis.figures.all_figures import CABLE_OF_FIGURE_10, payload_change
from cspr_control.analysis.figures.style import (
    COLOURS,
    DASHED_CONTROLLERS,
    controller_colour,
    controller_title,
)
from cspr_control.analysis.numbers.cycles import cycle_bins, cycle_periods
from cspr_control.analysis.numbers.error_statistics import before_and_after
from cspr_control.analysis.numbers.tables import motor_rows, row_texts, summary_rows
from cspr_control.analysis.page.decimation import envelope
from cspr_control.analysis.page.packing import Packer
from cspr_control.analysis.run_analysis import RunAnalysis
from cspr_control.analysis.timeline import Event, EventKind, Span
from cspr_control.markers.tension_colours import TENSION_COLOURS

Floats = NDArray[np.float64]
Times = NDArray[np.int64]

_SAMPLES: Final = 32_000
"""Samples of a column of all runs together: 60 s at 250 Hz of two runs are whole, of longer ones the peaks stay."""

_POSES: Final = 6_000  # of a run: every 10th of a second of ten minutes
_BINS: Final = 80  # of the histogram of cycles, at most
_PARTS: Final = ("data.js", "plot.js", "scene.js", "report.js")


def write_report(runs: Sequence[RunAnalysis], path: Path) -> None:
    """Write the report as one HTML file that needs no other file and no network.

    Parameters
    ----------
    runs
        At least one, all of one robot; shown side by side.
    path
        The file to write.
    """
    packer = Packer()
    description = _description(runs, packer)
    page = resources.files("cspr_control.analysis") / "page"
    scripts = "\n".join((page / name).read_text(encoding="utf-8") for name in _PARTS)
    # "</" would end the script element; inside a JSON string a slash may be escaped
    text = json.dumps(description, allow_nan=False, ensure_ascii=False).replace("</", "<\\/")
    html = (page / "report.html").read_text(encoding="utf-8")
    for place, content in (
        ("/*STYLE*/", (page / "report.css").read_text(encoding="utf-8")),
        ("/*SCRIPT*/", scripts),
        ("/*SAMPLES*/", packer.text()),
        ("/*DESCRIPTION*/", text),
    ):
        before, _, after = html.partition(place)
        html = before + content + after
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(html, encoding="utf-8")


def _description(runs: Sequence[RunAnalysis], packer: Packer) -> dict[str, Any]:
    robot = runs[0].recording.robot
    windows = [run.recording.window for run in runs]
    whole = [run.recording.seconds(run.recording.states.time_ns[[0, -1]]) for run in runs]
    tensions = [run.recording.tensions.effort for run in runs if run.recording.tensions is not None]
    # a momentary peak may exceed the scale: the colours show what lasts
    scale = max(
        (1.1 * float(np.quantile(t, 0.95)) for t in tensions if t.size),
        default=float(robot.tension_max.max()),
    )
    recorded = datetime.fromtimestamp(runs[0].recording.origin_ns * 1e-9, UTC)
    many = f"{len(runs)} runs" if len(runs) > 1 else controller_title(runs[0].name)
    return {
        "title": f"{robot.name}: {many}",
        "subtitle": f"{', '.join(dict.fromkeys(run.metrics.trajectory for run in runs))} · "
        f"recorded {recorded:%Y-%m-%d %H:%M} UTC · {', '.join(str(run.recording.path) for run in runs)}",
        "motors": robot.number_of_cables,
        "colours": COLOURS,
        "tension_colours": TENSION_COLOURS,
        "tension_scale": _round_up(scale),
        "window": [min(one.start for one in windows), max(one.end for one in windows)],
        "whole": [float(min(span[0] for span in whole)), float(max(span[1] for span in whole))],
        "robot": {
            "exit_points": robot.exit_points.tolist(),
            "anchor_points": robot.anchor_points.tolist(),
            "frame_size": robot.frame_size.tolist(),
            "platform_size": robot.platform_size.tolist(),
            "tension_min": robot.tension_min.tolist(),
        },
        "summary": [[name, texts] for name, texts in summary_rows(runs)],
        "by_motor": [
            [name if len(runs) == 1 else f"{controller_title(run.name)}: {name}", row_texts(values)]
            for run in runs
            for name, values in motor_rows(run)
        ],
        "differences": _configuration_differences(runs),
        "runs": [_run(run, index, packer, _SAMPLES // max(2, len(runs))) for index, run in enumerate(runs)],
    }


def _run(run: RunAnalysis, index: int, packer: Packer, limit: int) -> dict[str, Any]:
    recording = run.recording
    timeline, deviation = recording.timeline, run.model_deviation()

    def seconds(time_ns: int) -> float:
        return (time_ns - recording.origin_ns) * 1e-9

    def spans(found: Sequence[Span]) -> list[dict[str, Any]]:
        return [{"start": seconds(s.start_ns), "end": seconds(s.end_ns), "name": s.name} for s in found]

    return {
        "title": controller_title(run.name),
        "color": controller_colour(run.name, index),
        "dashed": run.name in DASHED_CONTROLLERS,
        "remarks": run.remarks,
        "states": spans(timeline.states),
        "trajectories": spans(timeline.trajectories),
        "events": [
            {"time": seconds(event.time_ns), "kind": event.kind.value, "text": event.text}
            for event in sorted((*timeline.events, *_payload_events(run)), key=lambda event: event.time_ns)
        ],
        "information": recording.information,
        "configuration": dict(sorted(recording.configuration.files.items())),
        "deviation": None
        if deviation is None
        else {name: _plain(size) for name, size in vars(deviation).items()},
        "change": _change(run),
        "errors_by_load": [[load, _plain(values)] for load, values in sorted(run.errors_by_load().items())],
        "cycles": _cycles(run),
        "blocks": _blocks(run, packer, limit),
    }


def _blocks(run: RunAnalysis, packer: Packer, limit: int) -> dict[str, Any]:
    """Return the run's samples by name; the page names their columns."""
    recording, predicted = run.recording, run.predicted
    states, tensions = recording.states, recording.tensions
    blocks: dict[str, Any] = {}

    def add(name: str, time_ns: Times, *values: Floats) -> None:
        blocks[name] = packer.add(
            *envelope(recording.seconds(time_ns), np.concatenate(values, axis=1), limit)
        )

    if run.platform is not None:
        angle = run.platform.angle
        turned = np.full(run.platform.time_ns.size, np.nan) if angle is None else np.degrees(angle)
        distances = (1e3 * run.platform.position, 1e3 * run.platform.distance[:, None], turned[:, None])
        add("platform", run.platform.time_ns, *distances)
    torque = states.effort if states.effort.shape[1] else np.full(states.position.shape, np.nan)
    add("states", states.time_ns, torque, recording.cable_lengths())
    if run.errors is not None:
        add("errors", run.errors.time_ns, np.degrees(run.errors.position), np.degrees(run.errors.velocity))
    if predicted is not None:
        add("model", predicted.time_ns, predicted.dynamic, predicted.deviation)
    if tensions is not None:
        deviation = []
        if predicted is not None:
            model = predicted.dynamic_at(tensions.time_ns)
            covered = (tensions.time_ns >= predicted.time_ns[0]) & (tensions.time_ns <= predicted.time_ns[-1])
            deviation.append(np.where(covered[:, None], tensions.effort - model, np.nan))
        add("tensions", tensions.time_ns, tensions.effort, *deviation)
    for name, payload in (("estimate", recording.estimate), ("truth", recording.truth)):
        if payload is not None:
            order = np.argsort(payload.log_time_ns, kind="stable")
            add(name, payload.log_time_ns[order], payload.mass[order, None])
    for name, poses in (("reference", recording.references), ("pose", recording.poses)):
        if poses is not None:  # a pose is one thing: no extremes of its coordinates, but every k-th of them
            every = slice(None, None, -(-poses.time_ns.size // _POSES))
            quaternion = _continuous(poses.quaternion_xyzw)
            values = np.concatenate((poses.position, quaternion), axis=1)[every]
            blocks[name] = packer.add(recording.seconds(poses.time_ns[every]), values)
    return blocks


def _continuous(quaternions: Floats) -> Floats:
    """Return the same rotations without jumps from q to -q, so that one may interpolate between them."""
    flips = np.einsum("ni,ni->n", quaternions[1:], quaternions[:-1]) < 0.0
    signs = np.concatenate(([1.0], np.where(flips, -1.0, 1.0))).cumprod()
    return np.asarray(quaternions * signs[:, None])


def _payload_events(run: RunAnalysis) -> list[Event]:
    mass = run.metrics.mass
    return [
        Event(
            run.recording.origin_ns + round(change.time * 1e9),
            EventKind.PAYLOAD,
            f"payload {change.mass_before:g} kg to {change.mass:g} kg",
        )
        for change in (mass.changes if mass is not None else ())
    ]


def _change(run: RunAnalysis) -> dict[str, Any] | None:
    found = payload_change(run)
    if found is None:
        return None
    change, time_ns, deviation = found
    parts = before_and_after(run.recording.seconds(time_ns), deviation, change.time)
    return {
        "text": f"cable {CABLE_OF_FIGURE_10}, {change.mass - change.mass_before:+g} kg",
        **{
            name: _plain(np.array([one.maximum[0], one.median[0], one.rms[0]])) for name, one in parts.items()
        },
    }


def _cycles(run: RunAnalysis) -> dict[str, Any] | None:
    periods = cycle_periods(run.recording)
    if periods.size == 0:
        return None
    edges = 1e3 * cycle_bins(float(periods.max()), _BINS)
    counts, _ = np.histogram(1e3 * periods, edges)
    return {
        "centers": [f"{center:.4g}" for center in (edges[:-1] + edges[1:]) / 2],
        "counts": counts.tolist(),
    }


def _configuration_differences(runs: Sequence[RunAnalysis]) -> list[str]:
    """Return where the configurations of several runs differ from the first one's, one line for each file."""
    first = runs[0].recording.configuration
    lines = []
    for run in runs[1:]:
        other = run.recording.configuration
        for name in sorted(first.files.keys() & other.files.keys()):
            found = differences(parsed(first.files[name]), parsed(other.files[name]))
            if found:
                names = controller_title(runs[0].name), controller_title(run.name)
                lines.append(f"{name}: {describe(found, f'in {names[0]}', f'in {names[1]}')}")
    return lines


def _plain(values: Floats) -> list[float | None]:
    return [float(f"{value:.6g}") if math.isfinite(value) else None for value in values.tolist()]


def _round_up(value: float) -> float:
    """Return the next number of two digits."""
    if value <= 0.0:
        return 1.0
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return float(math.ceil(value / step - 1e-9) * step)
