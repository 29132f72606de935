"""Find where the robot can do its task: margins on a grid of poses, as numbers and pictures."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cspr_kinematics import InvalidInputError, KinematicsError, Robot, Task, Workspace, explore_workspace
from cspr_kinematics.workspace.plot import PlottingUnavailableError, plot_workspace
from cspr_msgs_py.json_file import write_json
from cspr_msgs_py.programs.command_line import program_parser

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
  cspr workspace --payload 0 200 --at 0 0 1                  and what there is to say about one position

exit status: 0 done, 1 nothing could be computed or written, 2 wrong arguments, 130 interrupted"""


def main(args: Sequence[str] | None = None) -> int:
    """Run the exploration; returns the exit status."""
    options = _parse(sys.argv[1:] if args is None else args)
    try:
        return _run(options)
    except KeyboardInterrupt:
        print("workspace: interrupted; nothing was written", file=sys.stderr)
        return 130
    except (KinematicsError, OSError) as error:
        print(f"workspace: {error}", file=sys.stderr)
        return 1


def _run(options: argparse.Namespace) -> int:
    robot = Robot.from_yaml(options.robot)
    smallest, largest = options.payload
    task = Task(smallest, largest, options.center_of_mass, options.acceleration, options.angular_acceleration)
    _check_positions(options, robot)
    output = Path(options.output)
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
        progress=None if options.quiet else _show_progress,
    )
    elapsed = time.monotonic() - start
    array_file, picture_file = (output.with_name(output.name + suffix) for suffix in (".npz", ".png"))
    workspace.save(array_file)
    exploration = Exploration.of(robot, task, workspace, max(1, len(options.euler or [])), elapsed)
    print(exploration)
    if options.json is not None:
        write_json(options.json, exploration)
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
            raise InvalidInputError(
                "--at",
                position,
                f"outside the grid, {lower.tolist()} to {upper.tolist()}; see --lower, --upper",
            )


@dataclass(frozen=True)
class Exploration:
    """The numbers of an exploration, as ``--json`` writes them; None where no position is feasible.

    Attributes
    ----------
    robot, task
        What was explored, in words.
    positions, orientations
        Shape of the grid, and in how many orientations each position was examined.
    elapsed
        Time it took, s.
    feasible_share
        Of the positions.
    volume, grid_volume
        Of the workspace, and of the whole grid, m^3.
    extent
        Range of the feasible positions along x, y and z (3, 2), m.
    largest_margin, best_position
        N, and where, m.
    smallest_margin
        Where the task is feasible, N.
    payload_max, payload_max_everywhere
        At the best position, and wherever the task is feasible, kg.
    """

    robot: str
    task: str
    positions: tuple[int, ...]
    orientations: int
    elapsed: float
    feasible_share: float
    volume: float
    grid_volume: float
    extent: tuple[tuple[float, float], ...] | None = None
    largest_margin: float | None = None
    best_position: tuple[float, ...] | None = None
    smallest_margin: float | None = None
    payload_max: float | None = None
    payload_max_everywhere: float | None = None

    @classmethod
    def of(
        cls, robot: Robot, task: Task, workspace: Workspace, orientations: int, elapsed: float
    ) -> Exploration:
        """Return the numbers of a workspace; see the attributes."""
        feasible, axes = workspace.feasible, (workspace.x, workspace.y, workspace.z)
        found: dict[str, Any] = {}
        if feasible.any():
            best = np.unravel_index(int(workspace.margin.argmax()), workspace.margin.shape)
            places = np.argwhere(feasible).T
            found = {
                "extent": tuple(
                    (float(axis[at.min()]), float(axis[at.max()]))
                    for axis, at in zip(axes, places, strict=True)
                ),
                "largest_margin": float(workspace.margin[best]),
                "best_position": tuple(float(axis[k]) for axis, k in zip(axes, best, strict=True)),
                "smallest_margin": float(workspace.margin[feasible].min()),
                "payload_max_everywhere": float(workspace.payload_max[feasible].min()),
            }
        if np.isfinite(workspace.payload_max).any():
            found["payload_max"] = float(np.nanmax(workspace.payload_max))
        return cls(
            robot.name,
            _format_task(task),
            workspace.margin.shape,
            orientations,
            elapsed,
            float(feasible.mean()),
            float(workspace.volume),
            math.prod(float(axis[-1] - axis[0]) for axis in axes),
            **found,
        )

    def __str__(self) -> str:
        """Return the summary, some lines of text."""
        lines = [
            f"workspace of {self.robot}: {self.task}",
            f"  poses                 {math.prod(self.positions) * self.orientations} in {self.elapsed:.2f} s "
            f"({' x '.join(map(str, self.positions))} positions, {self.orientations} orientation"
            f"{'s' if self.orientations > 1 else ''})",
            f"  feasible              {self.feasible_share:.1%} of the positions",
            f"  volume                {self.volume:.3f} of {self.grid_volume:.3f} m^3",
        ]
        for name, (low, high) in zip("xyz", self.extent or (), strict=False):
            lines.append(f"  {name}                     {low:.3g} to {high:.3g} m")
        if self.best_position is not None:
            lines += [
                f"  largest margin        {self.largest_margin:.1f} N at ({_numbers(self.best_position)})",
                f"  smallest margin       {self.smallest_margin:.1f} N where feasible",
            ]
        if self.payload_max is not None:
            lines.append(f"  largest payload       {self.payload_max:.1f} kg at the best position")
            if self.payload_max_everywhere is not None:
                lines.append(
                    f"                        {self.payload_max_everywhere:.1f} kg wherever the task is feasible"
                )
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
    return (
        f"  at ({_numbers(position)})".ljust(24)
        + f"margin {margin:.1f} N, {abs(distance):.3f} m {side} the border"
    )


def _numbers(values: Sequence[float] | np.ndarray) -> str:
    return ", ".join(f"{value:.4g}" for value in values)


def _show_progress(done: int, total: int) -> None:
    if sys.stderr.isatty():
        end = "\n" if done == total else ""
        print(f"\r{done} of {total} poses ({done / total:.0%})", end=end, file=sys.stderr, flush=True)


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
        "--output", default="workspace", metavar="STEM",
        help="files to write, without suffix; default: %(default)s",
    )  # fmt: skip
    add("--no-picture", action="store_true", help="write no STEM.png; it needs matplotlib")
    add("--quiet", action="store_true", help="no progress on the terminal")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
