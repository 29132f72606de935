"""All figures of one or more recorded runs, stored as PNG and SVG."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cspr_control.analysis.figures import paper as paper_figures
from cspr_control.analysis.figures import run as run_figures
from cspr_control.analysis.figures.style import house_style, save_figure
from cspr_control.analysis.numbers.cycles import cycle_periods
from cspr_control.analysis.numbers.mass import MassChange
from cspr_control.analysis.page.decimation import envelope
from cspr_control.analysis.run_analysis import RunAnalysis
from cspr_kinematics import Pose

Floats = NDArray[np.float64]

MOTOR_OF_FIGURE_12 = 3
CABLE_OF_FIGURE_10 = 1
_NO_DEVIATION = 0.01  # N, below which the two models agree
_POINTS = 3000  # a line of a picture has no more to show


def save_figures(
    runs: Sequence[RunAnalysis], directory: Path, progress: Callable[[str], None] | None = None
) -> list[Path]:
    """Draw and store every figure that the runs have the data for.

    Parameters
    ----------
    runs
        At least one.
    directory
        For figures of all runs together; those of a single run among several go into a directory of its name there.
    progress
        Called with the name of each figure before it is drawn.

    Returns
    -------
    list of Path
        The PNG files; an SVG lies beside each.
    """
    stored = []
    with house_style():
        for name, draw in _drawings(runs):
            if progress is not None:
                progress(name)
            figure = draw()
            if figure is not None:
                stored.append(save_figure(figure, directory, name)[0])
    return stored


def _drawings(runs: Sequence[RunAnalysis]) -> Iterator[tuple[str, Callable[[], Figure | None]]]:
    for run in runs:
        prefix = "" if len(runs) == 1 else f"{run.slug}/"
        for name, draw in _ONE_RUN.items():
            yield prefix + name, lambda draw=draw, run=run: draw(run)  # type: ignore[misc]
    for name, draw_all in _ALL_RUNS.items():
        yield name, lambda draw_all=draw_all: draw_all(runs)  # type: ignore[misc]


def _trajectory(run: RunAnalysis) -> Figure | None:
    references = run.recording.references
    if references is None:
        return None
    pose = Pose.from_quaternion(references.position, references.quaternion_xyzw)
    time, position, tilt = _in_window(run, references.time_ns, pose.position, np.degrees(pose.euler))
    if time.size < 2:
        return None
    poses = run.recording.poses
    measured = None if poses is None else _in_window(run, poses.time_ns, poses.position)
    return paper_figures.trajectory_figure(time, position, tilt, measured, run.metrics.trajectory)


def _model_tensions(run: RunAnalysis) -> Figure | None:
    if run.predicted is None:
        return None
    time, dynamic, static = _in_window(
        run, run.predicted.time_ns, run.predicted.dynamic, run.predicted.static
    )
    if time.size < 2:
        return None
    title = f"Dynamic model along {run.metrics.trajectory}"
    return paper_figures.tension_figure(time, dynamic, static, title, run.load_changes())


def payload_change(run: RunAnalysis) -> tuple[MassChange, NDArray[np.int64], Floats] | None:
    """Return the data of Fig. 10: the first payload change, times (n,) in ns, and the models' deviation (n, 1).

    As in the paper, only while the platform accelerates: after that there is no deviation to compare. None if
    the payload does not change, or only later.
    """
    if run.predicted is None or run.metrics.mass is None or not run.metrics.mass.changes:
        return None
    change = run.metrics.mass.changes[0]
    deviation = run.predicted.deviation[:, [CABLE_OF_FIGURE_10 - 1]]
    counted = run.recording.in_window(run.predicted.time_ns)
    accelerated = np.flatnonzero(counted & (np.abs(deviation[:, 0]) > _NO_DEVIATION))
    if accelerated.size == 0:
        return None
    time_ns = run.predicted.time_ns
    if run.recording.seconds(time_ns[accelerated[[-1]]])[0] <= change.time:
        return None
    counted[accelerated[-1] + 1 :] = False
    return change, time_ns[counted], deviation[counted]


def _payload_change(run: RunAnalysis) -> Figure | None:
    found = payload_change(run)
    if found is None:
        return None
    change, time_ns, deviation = found
    time, values = envelope(run.recording.seconds(time_ns), deviation, _POINTS)
    text = f"{change.mass - change.mass_before:+g} kg"
    return paper_figures.payload_change_figure(time, values[:, 0], change.time, CABLE_OF_FIGURE_10, text)


def _measured_tensions(run: RunAnalysis) -> Figure | None:
    tensions = run.recording.tensions
    if tensions is None or run.predicted is None:
        return None
    predicted = run.predicted.dynamic_at(tensions.time_ns)
    time, measured, predicted = _in_window(run, tensions.time_ns, tensions.effort, predicted)
    if time.size < 2:
        return None
    return run_figures.measured_tensions_figure(time, measured, predicted, run.load_changes())


def _cable_lengths(run: RunAnalysis) -> Figure | None:
    states = run.recording.states
    time, lengths = _in_window(run, states.time_ns, run.recording.cable_lengths())
    if time.size < 2:
        return None
    change = (lengths - lengths[0], "Change from the start", "length, m")
    return paper_figures.two_panels(time, (lengths, "Cable lengths", "length, m"), change)


def _motor_errors(run: RunAnalysis) -> Figure | None:
    if run.errors is None:
        return None
    errors = np.degrees(run.errors.position), np.degrees(run.errors.velocity)
    time, position, velocity = _in_window(run, run.errors.time_ns, *errors)
    if time.size < 2:
        return None
    above = (position, "Motor position error", "error, deg")
    below = (velocity, "Motor velocity error", "error, deg/s")
    return paper_figures.two_panels(time, above, below, run.load_changes(), "motor")


def _platform_error(run: RunAnalysis) -> Figure | None:
    if run.platform is None:
        return None
    error, angle = run.platform, run.platform.angle
    turned = np.full(error.time_ns.size, np.nan) if angle is None else np.degrees(angle)
    values = np.column_stack((1e3 * error.position, 1e3 * error.distance, turned))
    time, shown = _in_window(run, error.time_ns, values)
    if time.size < 2:
        return None
    rotation = None if angle is None else shown[:, 4]
    return run_figures.platform_error_figure(time, shown[:, :4], rotation, run.load_changes())


def _model_deviation(runs: Sequence[RunAnalysis]) -> Figure | None:
    deviations = {run.name: run.model_deviation() for run in runs}
    statistics = {name: size for name, size in deviations.items() if size is not None}
    return paper_figures.deviation_figure(statistics) if statistics else None


def _errors_by_load(runs: Sequence[RunAnalysis]) -> Figure | None:
    errors = {run.name: run.errors_by_load() for run in runs}
    errors = {name: loads for name, loads in errors.items() if loads}
    return paper_figures.motor_error_figure(errors) if errors else None


def _error_over_time(runs: Sequence[RunAnalysis]) -> Figure | None:
    panels: dict[str, dict[str, tuple[Floats, Floats]]] = {}
    changes: dict[str, dict[float, str]] = {}
    for run in runs:
        if run.errors is not None and run.errors.position.shape[1] >= MOTOR_OF_FIGURE_12:
            error = np.degrees(run.errors.position[:, [MOTOR_OF_FIGURE_12 - 1]])
            time, values = _in_window(run, run.errors.time_ns, error)
            if time.size:
                panel = run.load_text()
                panels.setdefault(panel, {})[run.name] = (time, values[:, 0])
                changes.setdefault(panel, run.load_changes())
    return paper_figures.motor_error_over_time_figure(panels, MOTOR_OF_FIGURE_12, changes) if panels else None


def _mass(runs: Sequence[RunAnalysis]) -> Figure | None:
    estimates: dict[str, tuple[Floats, Floats]] = {}
    truths: dict[str, tuple[Floats, Floats]] = {}
    for run in runs:
        for payload, into in ((run.recording.estimate, estimates), (run.recording.truth, truths)):
            if payload is not None:
                time, mass = _in_window(run, payload.log_time_ns, payload.mass[:, None])
                if time.size:
                    into[run.name] = (time, mass[:, 0])
    return run_figures.mass_figure(estimates, truths) if estimates else None


def _cycle_histogram(runs: Sequence[RunAnalysis]) -> Figure | None:
    periods = {run.name: cycle_periods(run.recording) for run in runs}
    if not any(period.size for period in periods.values()):
        return None
    return run_figures.cycle_histogram_figure(periods, nominal_period(runs[0]))


def nominal_period(run: RunAnalysis) -> float:
    """Return the period that the cycle should have, s: that of the recorded rate, else the most frequent one."""
    try:
        return 1.0 / float(run.recording.information["control_rate"])
    except (KeyError, ValueError, ZeroDivisionError):
        return float(np.median(np.diff(run.recording.states.time_ns))) * 1e-9


def _in_window(run: RunAnalysis, time_ns: NDArray[np.int64], *values: Floats) -> tuple[Floats, ...]:
    """Return times (n,) in s and each of the values (n, k) on the trajectories, no more than a picture can show."""
    counted = run.recording.in_window(time_ns)
    time = run.recording.seconds(time_ns[counted])
    parts = [envelope(time, each[counted], _POINTS) for each in values]
    return parts[0][0], *(part for _, part in parts)


_ONE_RUN: dict[str, Callable[[RunAnalysis], Figure | None]] = {
    "platform_error": _platform_error,
    "fig07_trajectory": _trajectory,
    "fig08_model_tensions": _model_tensions,
    "fig10_payload_change": _payload_change,
    "measured_tensions": _measured_tensions,
    "cable_lengths": _cable_lengths,
    "motor_errors": _motor_errors,
}
_ALL_RUNS: dict[str, Callable[[Sequence[RunAnalysis]], Figure | None]] = {
    "fig09_model_deviation": _model_deviation,
    "fig11_motor_error_by_load": _errors_by_load,
    "fig12_motor_error": _error_over_time,
    "mass_estimate": _mass,
    "cycle_histogram": _cycle_histogram,
}
