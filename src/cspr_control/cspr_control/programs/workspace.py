"""Find where the robot can do its task: margins on a grid of poses, as numbers and pictures."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cspr_kinematics import InvalidInputError, KinematicsError, Robot, Task, Workspace, explore_workspace
from cspr_kinematics.workspace.plot import PlottingUnavailableError, plot_workspace
from cspr_msgs_py.json_file import write_json
from cspr_msgs_py.programs.command_line import (
    output_path,
    program_parser,
    run_program,
    show_progress,
)

DESCRIPTION = """\
Find the wrench-feasible workspace: the poses at which the cables, within their limits, can hold every
payload of a range with every acceleration of a box.

Writes STEM.npz (x, y, z, margin, payload_min, payload_max; cspr_kinematics.Workspace.load reads it) and
STEM.png (slices coloured by the margin), and prints a summary. No ROS graph is needed or touched. The margin
of a pose is the smallest additional wrench, in newton, that makes part of the task impossible."""
EPILOG = """\
examples:
  cspr workspace                                             the empty platform of config/robot.yaml at rest, level
  cspr workspace --payload 0 200 --acceleration 1 1 1        0 to 200 kg, each with 1 m/s^2 along every axis
  cspr workspace --euler 0 0 0 --euler 0 0.1 0 --spacing 0.05
  cspr workspace --robot config/robot_pulleys.yaml --lower -2.4 -1.4 0 --upper 2.4 1.4 3 --output runs/pulleys
  cspr workspace --payload 0 200 --at 0 0 1                  and what there is to say about one position"""


def main(args: Sequence[str] | None = None) -> int:
    """Run the exploration; returns the exit status."""
    options = _parse(sys.argv[1:] if args is None else args)
    return run_program("workspace", lambda: _run(options), (KinematicsError,), "nothing was written")


def _run(options: argparse.Namespace) -> int:
    robot = Robot.from_yaml(options.robot, "name the robot's file with --robot FILE")
    smallest, largest = options.payload
    task = Task(smallest, largest, options.center_of_mass, options.acceleration, options.angular_acceleration)
    _check_positions(options, robot)
    output: Path = options.output
    output.parent.mkdir(parents=True, exist_ok=True)
    start = time.monotonic()
    workspace = explore_workspace(
        robot,
        task,
        lower=options.lower,
        upper=options.upper,
        spacing=options.spacing,
        orientations=options.euler or [(0.0, 0.0, 0.0)],
        lever=options.lever,
        threads=options.threads,
        progress=_show_progress,
    )
    elapsed = time.monotonic() - start
    array_file, picture_file = (output.with_name(output.name + suffix) for suffix in (".npz", ".png"))
    workspace.save(array_file)
    numbers = _numbers_of(robot, task, workspace, max(1, len(options.euler or [])))
    print(_format_summary(numbers, elapsed))
    if options.json is not None:
        write_json(options.json, numbers)
    for position in options.at or []:
        print(_format_position(workspace, position))
    print(f"  arrays                {array_file}")
    if options.no_picture:
        return 0
    try:
        plot_workspace(workspace, picture_file, f"{robot.name}: {_format_task(task)}")
    except PlottingUnavailableError as error:
        print(f"workspace: no picture: {error} (or leave it out with --no-picture)", file=sys.stderr)
        return 1
    print(f"  picture               {picture_file}")
    return 0


def _check_positions(options: argparse.Namespace, robot: Robot) -> None:
    """Refuse positions outside the grid before it is explored, which may take minutes."""
    lower = np.asarray(robot.workspace_min if options.lower is None else options.lower)
    upper = np.asarray(robot.workspace_max if options.upper is None else options.upper)
    for position in options.at or []:
        if not (np.all(lower <= position) and np.all(position <= upper)):
            grid = f"the grid, {lower.tolist()} to {upper.tolist()}"
            raise InvalidInputError("--at", position, f"outside {grid}; see --lower, --upper")


def _numbers_of(robot: Robot, task: Task, workspace: Workspace, orientations: int) -> dict[str, Any]:
    """Return the summary of an exploration as ``--json`` writes it; no margins and payloads of what is not feasible."""
    axes, feasible = (workspace.x, workspace.y, workspace.z), workspace.feasible
    numbers: dict[str, Any] = {
        "robot": robot.name,
        "task": _format_task(task),
        "positions": workspace.margin.shape,
        "orientations": orientations,
        "feasible_share": feasible.mean(),
        "volume_m3": workspace.volume,
        "grid_volume_m3": math.prod(float(axis[-1] - axis[0]) for axis in axes),
    }
    if feasible.any():
        best = np.unravel_index(int(workspace.margin.argmax()), workspace.margin.shape)
        places = np.argwhere(feasible).T
        numbers |= {
            "extent_m": [(axis[at.min()], axis[at.max()]) for axis, at in zip(axes, places, strict=True)],
            "largest_margin_n": workspace.margin[best],
            "best_position_m": [axis[k] for axis, k in zip(axes, best, strict=True)],
            "smallest_margin_n": workspace.margin[feasible].min(),
            "payload_everywhere_kg": workspace.payload_max[feasible].min(),
        }
    if np.isfinite(workspace.payload_max).any():
        numbers["largest_payload_kg"] = np.nanmax(workspace.payload_max)
    return numbers


def _format_summary(numbers: dict[str, Any], elapsed: float) -> str:
    orientations = numbers["orientations"]
    lines = [
        f"workspace of {numbers['robot']}: {numbers['task']}",
        f"  poses                 {math.prod(numbers['positions']) * orientations} in {elapsed:.2f} s "
        f"({' x '.join(map(str, numbers['positions']))} positions, {orientations} orientation"
        f"{'s' if orientations > 1 else ''})",
        f"  feasible              {numbers['feasible_share']:.1%} of the positions",
        f"  volume                {numbers['volume_m3']:.3f} of {numbers['grid_volume_m3']:.3f} m^3",
    ]
    for name, (low, high) in zip("xyz", numbers.get("extent_m", ()), strict=False):
        lines.append(f"  {name}                     {low:.3g} to {high:.3g} m")
    if "best_position_m" in numbers:
        lines += [
            f"  largest margin        {numbers['largest_margin_n']:.1f} N at ({_numbers(numbers['best_position_m'])})",
            f"  smallest margin       {numbers['smallest_margin_n']:.1f} N where feasible",
        ]
    if "largest_payload_kg" in numbers:
        lines.append(f"  largest payload       {numbers['largest_payload_kg']:.1f} kg at the best position")
    if "payload_everywhere_kg" in numbers:
        everywhere = numbers["payload_everywhere_kg"]
        lines.append(f"                        {everywhere:.1f} kg wherever the task is feasible")
    return "\n".join(lines)


def _format_task(task: Task) -> str:
    parts = [f"payload {task.payload_min:g} to {task.payload_max:g} kg"]
    if task.linear_acceleration.any():
        parts.append(f"acceleration {_numbers(task.linear_acceleration)} m/s^2")
    if task.angular_acceleration.any():
        parts.append(f"angular acceleration {_numbers(task.angular_acceleration)} rad/s^2")
    return ", ".join(parts)


def _format_position(workspace: Workspace, position: Sequence[float]) -> str:
    margin, distance = float(workspace.margin_at(position)), float(workspace.distance_to_boundary(position))
    side = "inside" if margin >= 0.0 else "outside"
    place = f"  at ({_numbers(position)})"
    return f"{place:<24}margin {margin:.1f} N, {abs(distance):.3f} m {side} the border"


def _numbers(values: Sequence[float] | np.ndarray) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


def _show_progress(done: int, total: int) -> None:
    show_progress("" if done == total else f"{done} of {total} poses ({done / total:.0%})")


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = program_parser("workspace", DESCRIPTION, EPILOG, json="the summary")
    add = parser.add_argument
    vector: dict[str, Any] = {"nargs": 3, "type": float, "metavar": ("X", "Y", "Z")}
    zero = (0.0, 0.0, 0.0)
    add("--robot", default="config/robot.yaml", metavar="FILE", help="default: %(default)s")
    add(
        "--payload", nargs=2, type=float, default=(0.0, 0.0), metavar=("MIN", "MAX"),
        help="range of the payload's mass, kg; default: none",
    )  # fmt: skip
    add(
        "--center-of-mass", **vector, default=zero,
        help="of the payload, in platform axes, m; default: the platform's origin",
    )  # fmt: skip
    add(
        "--acceleration", **vector, default=zero,
        help="largest linear acceleration along each axis of base, in both senses, m/s^2; default: at rest",
    )  # fmt: skip
    add(
        "--angular-acceleration", **vector, default=zero,
        help="the same about each axis, rad/s^2; default: at rest",
    )  # fmt: skip
    add(
        "--euler", action="append", nargs=3, type=float, metavar=("ALPHA", "BETA", "GAMMA"),
        help="orientation, angles about z, y, x, rad; may be given several times: the task must be possible "
        "in all of them; default: level",
    )  # fmt: skip
    add("--lower", **vector, help="lower corner of the grid, m; default: workspace_min of the robot")
    add("--upper", **vector, help="upper corner of the grid, m; default: workspace_max of the robot")
    add("--spacing", type=float, default=0.1, metavar="M", help="of the grid, m; default: %(default)s")
    add(
        "--lever", type=float, default=1.0, metavar="M",
        help="length at which a moment counts as a force in the margin, m; default: %(default)s",
    )  # fmt: skip
    add(
        "--at", action="append", **vector,
        help="also print margin and distance to the border at this position; may be given several times",
    )  # fmt: skip
    add(
        "--threads", type=int, default=os.cpu_count() or 1, metavar="N",
        help="default: one for each core, %(default)s here",
    )  # fmt: skip
    add(
        "--output", type=output_path, default="workspace", metavar="STEM",
        help="files to write, without suffix; default: %(default)s",
    )  # fmt: skip
    add("--no-picture", action="store_true", help="write no STEM.png; it needs matplotlib")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
