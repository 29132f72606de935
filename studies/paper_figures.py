"""Figures 7 to 12 from the studies' numbers, in the one style of all figures."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cspr_control.analysis.figures.paper import (
    deviation_figure,
    motor_error_figure,
    motor_error_over_time_figure,
    payload_change_figure,
    tension_figure,
    trajectory_figure,
)
from cspr_control.analysis.figures.style import (
    COLOURS,
    EVENT_COLOUR,
    REFERENCE_COLOUR,
    WIDTH,
    controller_line,
    controller_title,
    house_style,
    save_figure,
)
from cspr_control.reference.paper import paper_18
from cspr_kinematics import Robot
from cspr_msgs_py.vocabulary import TrajectoryName
from studies.experiment import BEYOND, COMPARED, LOADS, TRAJECTORIES, controllers_of
from studies.geometries import Geometry
from studies.loop_results import LoopResults
from studies.paper_results import SHOWN_CABLE, SHOWN_MOTOR, TensionResults
from studies.simulation_statements import OUTSTANDING
from studies.tension_deviation import ADDED_AT, SWITCH_19


def draw_geometries(geometries: Sequence[Geometry], directory: Path) -> None:
    """Draw what figure 6 shows of the paper's robot: its cables at the centre of the trajectories."""
    with house_style():
        figure = Figure(figsize=(WIDTH, 3.0), layout="constrained")
        for place, geometry in enumerate(geometries, 1):
            axis: Any = figure.add_subplot(1, len(geometries), place, projection="3d")
            _draw_geometry(axis, geometry.robot)
            axis.set(title=f"{geometry.name.capitalize()} geometry")
        _save(figure, directory, 6)


def _draw_geometry(axis: Any, robot: Robot) -> None:
    corners = robot.platform_size / 2.0 * np.array(list(product((-1.0, 1.0), repeat=3)))
    flips = 1.0 - 2.0 * np.eye(3)
    center = robot.trajectory_center
    for edge in ((corner, corner * flip) for corner in corners for flip in flips):
        axis.plot(*(np.array(edge) + center).T, color=REFERENCE_COLOUR, linewidth=0.8)
    for k, (leaves, holds) in enumerate(zip(robot.exit_points, robot.anchor_points + center, strict=True)):
        outstanding = k + 1 in OUTSTANDING
        colour, width = (EVENT_COLOUR, 1.5) if outstanding else (COLOURS[0], 0.9)
        axis.plot(*np.stack((leaves, holds), axis=1), color=colour, linewidth=width)
        beside = np.sign(leaves) * ((0.0, 0.25, 0.0) if outstanding else (-0.35, 0.0, 0.0))
        axis.text(*(leaves + beside * (1.0, -1.0, 1.0)), f"{k + 1}", color=colour, fontsize=8, ha="center")
    low = np.append(-robot.frame_size[:2] / 2.0, 0.0)
    for name, start, length in zip("xyz", low, robot.frame_size, strict=True):
        label = {} if name == "z" else {f"{name}label": f"{name}, m"}  # it would be cut off
        axis.set(**{f"{name}lim": (start, start + length)}, **label)
        axis.locator_params(axis=name, nbins=4)
    axis.tick_params(labelsize=7)
    axis.set_box_aspect(robot.frame_size.copy(), zoom=0.85)
    axis.view_init(elev=24.0, azim=-68.0)


def draw_tension_figures(results: TensionResults, geometry: Geometry, directory: Path) -> None:
    """Draw figures 7 to 10 for a geometry."""
    robot, suffix = geometry.robot, geometry.suffix
    first, third = results.first, results.third
    trajectory = paper_18(robot.trajectory_center)
    positions = np.array([trajectory.sample(t).pose.position for t in first.time.tolist()])
    cable = third.deviation[:, SHOWN_CABLE - 1]
    with house_style():
        _save(trajectory_figure(first.time, positions, title="Trajectory (18)"), directory, 7)
        title = f"Tensions along (18) with 200 kg, dynamic model, {geometry.name} geometry"
        _save(tension_figure(first.time, first.dynamic, first.static, title), directory, 8, suffix)
        _save(deviation_figure(results.accelerating), directory, 9, suffix)
        _save(
            payload_change_figure(third.time, cable, ADDED_AT, SHOWN_CABLE, "+100 kg"), directory, 10, suffix
        )


def draw_loop_figures(results: LoopResults, directory: Path) -> None:
    """Draw figures 11 and 12 with a geometry, each for the trajectory as printed and for the smooth one."""
    k = SHOWN_MOTOR - 1
    shown = controllers_of(results.geometry)
    with house_style():
        for trajectory in TRAJECTORIES:
            printed = trajectory is TrajectoryName.PAPER_19
            suffix = f"{'' if printed else '_smooth'}{results.geometry.suffix}"
            runs = {name: {load: results.record(name, trajectory, load) for load in LOADS} for name in shown}
            errors = {
                name: {load: one.rms_deg for load, one in of_loads.items()} for name, of_loads in runs.items()
            }
            _save(motor_error_figure(errors), directory, 11, suffix)
            traces = {
                f"{load:g} kg": {
                    name: (runs[name][load].time, np.degrees(runs[name][load].position_error[:, k]))
                    for name in shown
                }
                for load in LOADS
            }
            changes = dict.fromkeys(traces, {SWITCH_19: "switch"} if printed else {})
            _save(motor_error_over_time_figure(traces, SHOWN_MOTOR, changes), directory, 12, suffix)


def draw_platform_figure(results: LoopResults, directory: Path) -> None:
    """Draw what the paper observes without showing it, along smooth-19: velocity errors, and the platform's error."""
    heaviest = LOADS[-1]
    with house_style():
        figure = Figure(figsize=(WIDTH, 4.6), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        for index, name in enumerate((*COMPARED, *BEYOND)):
            one = results.record(name, TrajectoryName.SMOOTH_19, heaviest)
            line, title = controller_line(name, index), controller_title(name)
            above.plot(one.time, one.velocity_error[:, SHOWN_MOTOR - 1], label=title, **line)
            below.plot(one.time, 1e3 * np.linalg.norm(one.platform_error, axis=1), **line)
        above.set(
            ylabel="error, rad/s", title=f"Motor {SHOWN_MOTOR} velocity error, smooth-19, {heaviest:g} kg"
        )
        below.set(ylabel="error, mm", xlabel="time, s", title="True position error of the platform")
        below.set_ylim(bottom=0.0)
        figure.legend(*above.get_legend_handles_labels(), loc="outside lower center", ncols=4)
        save_figure(figure, directory, "platform_and_velocity")


def _save(figure: Figure, directory: Path, number: int, suffix: str = "") -> None:
    save_figure(figure, directory, f"figure_{number:02d}{suffix}")
