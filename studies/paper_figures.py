"""Figures 7 to 12 from the studies' numbers, in the one style of all figures."""

from __future__ import annotations

from pathlib import Path

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
from cspr_control.analysis.figures.style import house_style, save_figure
from cspr_control.reference.paper import paper_18
from cspr_kinematics import Robot
from cspr_msgs_py.vocabulary import TrajectoryName
from studies.experiment import COMPARED, LOADS, TRAJECTORIES, Case
from studies.paper_results import SHOWN_CABLE, SHOWN_MOTOR, LoopResults, TensionResults
from studies.tension_deviation import ADDED_AT, SWITCH_19


def draw_tension_figures(results: TensionResults, robot: Robot, directory: Path) -> None:
    """Draw figures 7 to 10."""
    first, third = results.first, results.third
    trajectory = paper_18(robot.trajectory_center)
    positions = np.array([trajectory.sample(t).pose.position for t in first.time.tolist()])
    cable = third.deviation[:, SHOWN_CABLE - 1]
    with house_style():
        _save(trajectory_figure(first.time, positions, title="Trajectory (18)"), directory, 7)
        title = "Tensions along (18) with 200 kg, dynamic model"
        _save(tension_figure(first.time, first.dynamic, first.static, title), directory, 8)
        _save(deviation_figure(results.accelerating), directory, 9)
        _save(payload_change_figure(third.time, cable, ADDED_AT, SHOWN_CABLE, "+100 kg"), directory, 10)


def draw_loop_figures(results: LoopResults, directory: Path) -> None:
    """Draw figures 11 and 12, each for the trajectory as printed and for the smooth one."""
    with house_style():
        for trajectory in TRAJECTORIES:
            suffix = "" if trajectory is TrajectoryName.PAPER_19 else "_smooth"
            errors = {
                name: {load: results[Case(name, trajectory, load)].rms_deg for load in LOADS}
                for name in COMPARED
            }
            _save(motor_error_figure(errors), directory, 11, suffix)
            traces = {}
            for load in LOADS:
                records = {name: results[Case(name, trajectory, load)] for name in COMPARED}
                traces[f"{load:g} kg"] = {
                    name: (record.time, np.degrees(record.position_error[:, SHOWN_MOTOR - 1]))
                    for name, record in records.items()
                }
            marked = {SWITCH_19: "switch"} if trajectory is TrajectoryName.PAPER_19 else {}
            changes = dict.fromkeys(traces, marked)
            _save(motor_error_over_time_figure(traces, SHOWN_MOTOR, changes), directory, 12, suffix)


def _save(figure: Figure, directory: Path, number: int, suffix: str = "") -> None:
    save_figure(figure, directory, f"figure_{number:02d}{suffix}")
