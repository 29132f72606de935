"""How sensitive the closed loop is to what nobody knows exactly: a Latin hypercube of loops (`make sensitivity`)."""

from __future__ import annotations

import argparse
import csv
import os
import sys
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields, replace
from multiprocessing import get_context
from pathlib import Path
from time import monotonic
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import qmc, spearmanr

from cspr_control.analysis.figures.style import COLOURS, WIDTH, house_style, save_figure
from cspr_control.closed_loop.run import run
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.errors import ControlError
from cspr_control.parameters.control_settings import control_settings, robot_file
from cspr_control.parameters.experiment import AddedPayload
from cspr_control.stability.loop_configuration import LoopConfiguration
from cspr_control.stability.scan import Place, growth_at
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_kinematics import KinematicsError, Pulleys, Robot
from cspr_msgs_py.errors import MessagesError
from cspr_msgs_py.programs.command_line import number, run_program, show_progress
from cspr_msgs_py.topics import TRUE_POSE
from cspr_msgs_py.vocabulary import TrajectoryName
from studies.experiment import BARE
from studies.paper_document import fill

FloatArray = NDArray[np.float64]

RANGES = {
    "kp": (1.0, 4.0, "Kp: 1 to 4 N m/rad"),
    "kd": (0.05, 0.2, "Kd: 0.05 to 0.2 N m s/rad"),
    "late": (0.0, 2.999, "torques late: 0 to 2 cycles"),
    "inertia": (0.7, 1.4, "inertia of the winches: x 0.7 to 1.4"),
    "friction": (0.5, 2.0, "dry friction: x 0.5 to 2"),
    "viscous": (0.5, 2.0, "viscous friction: x 0.5 to 2"),
    "stiffness": (0.7, 1.3, "stiffness of the cables: x 0.7 to 1.3"),
    "offset": (0.0, 0.1, "load off centre: 0 to 0.1 m"),
    "exits": (0.0, 3e-3, "exit points off: 0 to 3 mm"),
    "pulley": (0.0, 0.05, "pulleys nobody configured: 0 to 50 mm"),
    "cell_gain": (0.0, 5e-3, "gain of the cells off: 0 to 0.5 %"),
    "cell_offset": (0.0, 5.0, "offset of the cells: 0 to 5 N"),
}
"""What is varied: smallest and largest value, and what it is in words. Errors of several are standard deviations."""

OUTCOMES = {
    "motors": "motor error, deg RMS",
    "platform": "platform error, mm RMS",
    "mass": "mass error at the end, kg",
    "settling": "mass within 2 % after, s",
    "unstable": "unstable",
}
"""What is looked at; the last one over all loops, the others over the stable ones."""

DOCUMENT = Path(__file__).parents[1] / "docs" / "stability.md"
FIGURE = DOCUMENT.with_name("sensitivity.png")
PASSED = ((0.0, 0.0, 1.0), (0.5, -0.3, 1.2), (0.4, -0.1, 1.1))  # m; places of the trajectory
LOOPS = 500
RINGING = 3.0  # times the median change of speed from cycle to cycle: such loops do not come to rest
LARGEST = 30.0  # deg RMS; and such ones do not follow
NEVER = 2.0  # s; stands for what does not settle before the end
ADDED_AT = 2.0  # s into the trajectory, when it is at full pace
LONGEST = ADDED_AT + NEVER  # s of the trajectory that are run
QUICKLY = {
    "speed": 0.7,
    "acceleration": 2.0,
    "dwell": 0.2,
}  # m/s, m/s^2, s: nothing is measured before the start
UNCALIBRATED = {
    # m: nothing says by how much the lengths may fit badly, nor how well the balance holds
    "supervisor": {"length_misfit": 0.01, "cell_accuracy": 0.1, "weight_accuracy": 0.1},
    # N, s, the most there is: nor by how much tensions and motors may disagree
    "mass_estimator": {"cell_tolerance": 60.0, "cell_confirmation": 1.0},
}
WATCHED = 250  # cycles at the end

DESCRIPTION = """\
Run closed loops on the simulated plant (smooth-19, 100 kg aboard, 100 kg more after 2 s) that differ in gains, late
torques and in what the controllers do not know, drawn as a Latin hypercube, on all cores; then rank correlations of
what went in with what came out. Each loop is also judged by the linear model of cspr stability, with the true machine.

Writes DIR/sensitivity.csv (every loop), DIR/sensitivity.png and .svg."""
EPILOG = """\
examples, as arguments of: make sensitivity ARGS="..."
  --loops 40                 a first look
  --update                   bring figure and numbers in docs/ up to date too"""


@dataclass(frozen=True)
class Varied(Scenario):
    """A run on another machine than the controllers believe.

    Attributes
    ----------
    varied
        Names and values of `RANGES`.
    """

    varied: tuple[tuple[str, float], ...] = ()

    @staticmethod
    def of(number: int, values: Sequence[float]) -> Varied:
        """Return the run of a row of the hypercube."""
        value = dict(zip(RANGES, values, strict=True))
        late, timing = (
            int(value["late"]),
            {name: getattr(BARE, name) for name in ("config", "devices", "phase")},
        )
        return Varied(
            **timing,
            trajectory=TrajectoryName.SMOOTH_19,
            duration=LONGEST,
            added=(AddedPayload(100.0, ADDED_AT),),
            seed=number,
            latency=BARE.reaction_time + late * 0.004,
            payload_center=(value["offset"], 0.0, 0.0),
            parameters={
                "motor_control_gains": {"kp": value["kp"], "kd": value["kd"]},
                **UNCALIBRATED,
                "trajectory_publisher": QUICKLY,
            },
            varied=tuple(value.items()),
        )

    def read_machine(self) -> SimulationConfig:
        """Read simulation.yaml, with what is otherwise in this run."""
        value, rng, config = dict(self.varied), np.random.default_rng(self.seed), super().read_machine()
        m, motor = config.robot.number_of_cables, config.robot.motor
        motor = replace(
            motor,
            inertia=motor.inertia * value["inertia"],
            coulomb_friction=motor.coulomb_friction * value["friction"],
            viscous_friction=motor.viscous_friction * value["viscous"],
        )
        robot = replace(config.robot, motor=motor).with_geometry(
            exit_points=config.robot.exit_points + value["exits"] * rng.standard_normal((m, 3)),
            pulleys=Pulleys(value["pulley"]),
        )
        cells = replace(
            config.load_cells,
            gain_error=(value["cell_gain"] * rng.standard_normal(m)).tolist(),
            offset=(value["cell_offset"] * rng.standard_normal(m)).tolist(),
        )
        cables = replace(config.cables, axial_stiffness=config.cables.axial_stiffness * value["stiffness"])
        return replace(config, robot=robot, load_cells=cells, cables=cables)


@dataclass(frozen=True)
class Outcome:
    """What became of a loop: errors in deg, mm and kg, settling in s; rad/s of ringing; growth foretold, 1/s."""

    motors: float
    platform: float
    mass: float
    settling: float
    ringing: float
    foretold: float
    stopped: str


def outcome(scenario: Varied) -> Outcome:
    """Run a loop, and foretell it."""
    foretold = _foretold(scenario)
    try:
        record = run(scenario, keep=True)
    except ControlError as error:
        return Outcome(np.nan, np.nan, np.nan, np.nan, np.nan, foretold, str(error))
    assert record.published is not None
    references, poses = record.published.references(), record.published.poses(TRUE_POSE.name)
    _, asked, true = np.intersect1d(references.time_ns, poses.time_ns, return_indices=True)
    moving = references.time_from_start[asked] > 0.0
    off = np.linalg.norm(references.position[asked] - poses.position[true], axis=1)[moving]
    ringing = np.diff(record.velocity_error[-WATCHED:], axis=0).std(axis=0).max()
    return Outcome(
        float(record.rms_deg.mean()),
        float(1e3 * np.sqrt(np.mean(off**2))),
        abs(record.mass_error),
        min(record.settling_time, NEVER),
        float(ringing),
        foretold,
        record.cause,
    )


def _foretold(scenario: Varied) -> float:
    """Return the growth of the linear loop of the true machine, 1/s, at the worst place; dry friction left out."""
    parameters, machine = scenario.read_parameters(), scenario.read_machine()
    believed = Robot.from_yaml(scenario.config / robot_file(parameters))
    stiffness = np.full(believed.number_of_cables, machine.cables.axial_stiffness)
    true = replace(
        believed, motor=machine.robot.motor, cables=replace(believed.cables, axial_stiffness=stiffness)
    )
    loop = LoopConfiguration.of(true, control_settings(believed, parameters), scenario.reaction_time)
    return max(growth_at(Place(position, mass), loop) for position in PASSED for mass in (100.0, 200.0))


def rings(outcomes: Sequence[Outcome]) -> NDArray[np.bool_]:
    """Return which loops were unstable: stopped, not following, or never at rest (n,)."""
    ringing, error = (np.array([getattr(each, name) for each in outcomes]) for name in ("ringing", "motors"))
    quiet = ringing <= RINGING * np.nanmedian(ringing)  # false for what is not a number
    return np.asarray(~(quiet & (error <= LARGEST)) | np.array([bool(each.stopped) for each in outcomes]))


def rank_correlations(rows: FloatArray, outcomes: Sequence[Outcome]) -> FloatArray:
    """Return Spearman's rank correlation of each range with each outcome, as they are listed above."""
    unstable = rings(outcomes)
    table = np.zeros((len(RANGES), len(OUTCOMES)))
    for column, name in enumerate(OUTCOMES):
        kept = np.full(len(rows), True) if name == "unstable" else ~unstable
        came = unstable if name == "unstable" else np.array([getattr(each, name) for each in outcomes])
        if np.ptp(came[kept].astype(float)) > 0.0:
            for row in range(len(RANGES)):
                table[row, column] = spearmanr(rows[kept, row], came[kept]).statistic
    return table


def tornado(table: FloatArray) -> Figure:
    """Draw the rank correlations: one panel for each outcome, the strongest influence on top."""
    labels = np.array([label for _, _, label in RANGES.values()])
    figure = Figure(figsize=(WIDTH, 7.4), layout="constrained")
    panels = figure.subplots(3, 2).ravel()
    for panel, title, column in zip(panels, OUTCOMES.values(), table.T, strict=False):
        order = np.argsort(np.abs(column))
        colours = [COLOURS[0] if value >= 0.0 else COLOURS[5] for value in column[order]]
        panel.barh(np.arange(len(order)), column[order], color=colours, height=0.7)
        panel.set_yticks(np.arange(len(order)), labels[order], fontsize=6.5)
        panel.set_xlim(-1.0, 1.0)
        panel.axvline(0.0, color="black", linewidth=0.6)
        panel.set_title(title, fontsize=9, loc="right")
        panel.tick_params(axis="x", labelsize=7)
        panel.grid(axis="y", visible=False)
    panels[-1].axis("off")
    panels[-1].text(
        -0.8,
        0.9,
        "Spearman's rank correlation.\nBlue: the more of it, the more\nof that; orange: the less.",
        va="top",
        fontsize=8,
    )
    return figure


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the study; returns the exit status."""
    parser = argparse.ArgumentParser(
        "sensitivity", None, DESCRIPTION, EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    whole = number("a number of loops, 4 or more", 4.0, 1e6)
    add("--loops", type=whole, default=LOOPS, metavar="N", help="default: %(default)s")
    add("--output", type=Path, default=Path("runs/sensitivity"), metavar="DIR", help="default: %(default)s")
    add("--update", action="store_true", help="also replace figure and numbers in docs/")
    options = parser.parse_args(arguments)
    return run_program(
        "sensitivity",
        lambda: _run(options),
        (ControlError, KinematicsError, MessagesError),
        "nothing is written",
    )


def _run(options: argparse.Namespace) -> None:
    began, count = monotonic(), int(options.loops)
    cores = len(os.sched_getaffinity(0))
    lower, upper = (np.array([limits[end] for limits in RANGES.values()]) for end in (0, 1))
    draw = qmc.LatinHypercube(len(RANGES), seed=np.random.default_rng(7))
    rows = qmc.scale(draw.random(count), lower, upper)
    scenarios = [Varied.of(seed, row.tolist()) for seed, row in enumerate(rows, start=1)]
    outcomes: list[Outcome] = []
    with get_context("spawn").Pool(cores, os.nice, (5,)) as pool:
        for each in pool.imap(outcome, scenarios):
            outcomes.append(each)
            left = (monotonic() - began) * (count / len(outcomes) - 1.0)
            show_progress(f"{len(outcomes)} of {count} loops, {left:.0f} s left", len(outcomes) / count)
    show_progress("")
    options.output.mkdir(parents=True, exist_ok=True)
    _write_table(options.output / "sensitivity.csv", rows, outcomes)
    table = rank_correlations(rows, outcomes)
    with house_style():
        picture, _ = save_figure(tornado(table), options.output, "sensitivity")
    took = f"{count} loops in {_duration(monotonic() - began)} on {cores} core{'s' * (cores > 1)}"
    summary = "\n".join((*_summary(rows, outcomes, table), took))
    if options.update:
        FIGURE.write_bytes(picture.read_bytes())
        shown = f"![Rank correlations of {count} loops](sensitivity.png)\n\n```\n{summary}\n```"
        DOCUMENT.write_text(fill(DOCUMENT.read_text("utf-8"), {"sensitivity": shown}), encoding="utf-8")
    print(summary)
    print(f"written to {options.output}")


def _duration(seconds: float) -> str:
    minutes, left = divmod(round(seconds), 60)
    return f"{minutes} min {left} s" if minutes else f"{left} s"


def _summary(rows: FloatArray, outcomes: Sequence[Outcome], table: FloatArray) -> list[str]:
    unstable = rings(outcomes)
    foretold = np.array([each.foretold for each in outcomes]) >= 0.0
    late = rows[:, list(RANGES).index("late")].astype(int)
    lines = [f"{'':42}" + "".join(f"{name:>10}" for name in OUTCOMES)]
    for (_, _, label), row in zip(RANGES.values(), table, strict=True):
        lines.append(f"{label:42}" + "".join(f"{value:>10.2f}" for value in row))
    for share in (50, 95):
        quantiles = [
            np.percentile(
                [getattr(each, name) for each, bad in zip(outcomes, unstable, strict=True) if not bad], share
            )
            for name in OUTCOMES
            if name != "unstable"
        ]
        lines.append(
            f"{f'{share} % of the stable loops are below':42}" + "".join(f"{q:>10.2f}" for q in quantiles)
        )
    for cycles in range(3):
        of = late == cycles
        lines.append(f"unstable with {cycles} late cycles: {unstable[of].sum()} of {of.sum()}")
    lines.append(
        f"foretold by the linear model: {(foretold & unstable).sum()} of {unstable.sum()} unstable ones, "
        f"{(~foretold & ~unstable).sum()} of {(~unstable).sum()} stable ones"
    )
    return lines


def _write_table(path: Path, rows: FloatArray, outcomes: Sequence[Outcome]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer: Any = csv.writer(file)
        writer.writerow([*RANGES, *(item.name for item in fields(Outcome)), "unstable"])
        for row, each, bad in zip(rows, outcomes, rings(outcomes), strict=True):
            writer.writerow([*(f"{value:.6g}" for value in row), *astuple(each), int(bad)])


if __name__ == "__main__":
    sys.exit(main())
