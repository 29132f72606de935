"""Where the platform is and what it carries: every number that the robot is held to, measured in closed loop.

The controllers as config/ ships them, without ROS, on the plant of simulation.yaml alone: its survey, friction and
errors of the load cells, which the controllers are not told. 100 kg aboard and 100 kg added at 3 s except as stated.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

from benchmarks.platform_cells import cell_fault
from benchmarks.platform_live import live_against_simulated
from benchmarks.platform_poses import exact_lengths, slack_cable
from benchmarks.platform_rows import Row
from benchmarks.platform_runs import (
    growing_load,
    jumps,
    noise_at_rest,
    smooth_step,
    stability,
    stretch,
    strokes,
    unknown_pulleys,
)
from benchmarks.platform_swing import no_swing, swing
from cspr_control.errors import ControlError
from cspr_drivers.errors import DriverError
from cspr_kinematics import KinematicsError
from cspr_msgs_py.json_file import write_json


class Task(NamedTuple):
    """Some rows, by what computes them."""

    name: str
    rows: Callable[..., list[Row]]
    arguments: tuple[object, ...] = ()


TASKS = (
    Task("smooth-19, 200 kg", stretch, (1.0, 0.3)),
    Task("the same, E A believed 20 % too low", stretch, (0.8, 1.0)),
    Task("the same, E A believed 25 % too high", stretch, (1.25, 1.0)),
    Task("smooth-19", smooth_step),
    Task("strokes of 0.3 m in z, 3 m/s^2", strokes),
    Task("smooth-19, added within 0.5 s", growing_load),
    Task("paper-19", jumps),
    Task("at rest, 200 kg", noise_at_rest),
    Task("smooth-19, pulleys of 50 mm", unknown_pulleys),
    Task("cell shows 60 N more", cell_fault, ("load_cell_offset", 0.1)),
    Task("cell shows 0 N", cell_fault, ("load_cell_zero", 0.1)),
    Task("cell shows a tenth less", cell_fault, ("load_cell_gain", 0.1)),
    Task("cell is stuck", cell_fault, ("load_cell_stuck", 1.0)),
    Task("swing, 5 degrees on 0.5 m, damped", swing, (0.5, 5.0)),
    Task("the same damping, smooth-19, no sling", no_swing),
    Task("stability, computed", stability),
    Task("pose from exact lengths, frame of 1.5 m", exact_lengths),
    Task("pose from lengths, a cable 150 mm slack", slack_cable),
)


LIVE = Task("smooth-19, live against simulated", live_against_simulated)
"""Not among `TASKS`: it takes one to two minutes, and needs the CPUs to itself."""


def rows_of(task: Task) -> list[Row]:
    """Return the rows of a task; one that says why if it cannot be done."""
    try:
        return task.rows(task.name, *task.arguments)
    except (ControlError, DriverError, KinematicsError) as error:
        return [Row(task.name, "not measured", math.nan, 0.0, note=str(error))]


def table(tasks: Sequence[Task] = TASKS) -> Iterator[Row]:
    """Yield the rows in the order of the tasks, as they are done."""
    with get_context("spawn").Pool() as pool:
        for rows in pool.imap(rows_of, tasks):
            yield from rows


def _all_rows(live: bool) -> Iterator[Row]:
    """Yield the rows of the table, and those of the live run once nothing else runs."""
    yield from table()
    if live:
        yield from rows_of(LIVE)


def main(arguments: Sequence[str] = ()) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.platform", description=__doc__)
    parser.add_argument(
        "--live", action="store_true", help="then the whole graph live, against the same without ROS"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows there as well")
    chosen = parser.parse_args(arguments)
    print("100 kg aboard and 100 kg added at 3 s except as stated; smooth-19 lasts 12 s")
    print(f"{'scenario':40}{'what':46}{'measured':>10}{'aim':>11} {'unit':6}")
    rows = []
    for row in _all_rows(chosen.live):
        rows.append(row)
        print(row, flush=True)
    missed = sum(not row.reached for row in rows)
    print(f"{len(rows) - missed} of {len(rows)} aims reached")
    if chosen.json is not None:
        write_json(chosen.json, [row.values() for row in rows])


if __name__ == "__main__":
    main(sys.argv[1:])
