"""Time of the control cycle's mathematics: one pose at a time and in batches, as ratios within one run."""

from __future__ import annotations

import os
import subprocess
import sys
from time import perf_counter

import numpy as np

from benchmarks import plain_numpy
from benchmarks.problems import CONFIG, PAYLOAD, chain, motions
from benchmarks.timing import microseconds, print_table, seconds
from cspr_kinematics import (
    Pose,
    Robot,
    distribute_tensions,
    forward_kinematics,
    inverse_kinematics,
    required_wrench,
    solve_forward_kinematics,
)

BATCH = 100_000

# What is aimed at on two cores of a 2024 server, us or, for batches, us per pose.
_CHAIN = "cables, wrench and bounded tensions"
_BATCH_CHAIN = f"the same, batch of {BATCH}, one thread"
_WARM = "forward kinematics, from 1 cm away"
_TWO_THREADS = f"the same, batch of {BATCH}, tensions on two threads"
_IMPORT = "import of the package"
AIMS = {_CHAIN: 35.0, _BATCH_CHAIN: 4.0, _TWO_THREADS: 3.0, _WARM: 25.0}


def compare(robot: Robot, title: str, with_numpy: bool) -> None:
    """Print the table for one robot."""
    random = np.random.default_rng(0)
    single, batch = motions(robot, random), motions(robot, random, BATCH)
    lengths = inverse_kinematics(robot, single[0]).lengths
    batch_lengths = inverse_kinematics(robot, batch[0]).lengths
    limits = robot.tension_min, robot.tension_max
    guess = Pose(single[0].position + 0.01 / np.sqrt(3.0), single[0].rotation)
    near = Pose(batch[0].position + 0.01 / np.sqrt(3.0), batch[0].rotation)
    A, w = inverse_kinematics(robot, single[0]).wrench_matrix, required_wrench(robot, *single, PAYLOAD)

    def in_numpy() -> None:
        _, matrix = plain_numpy.wrench_matrix(robot, single[0])
        plain_numpy.bounded(matrix, plain_numpy.wrench(robot, *single, PAYLOAD), *limits)

    whole = microseconds(lambda: chain(robot, *single), 1000)
    rows = [
        (_CHAIN, whole),
        (
            "  inverse kinematics, wrench matrix",
            microseconds(lambda: inverse_kinematics(robot, single[0]), 1000),
        ),
        ("  required wrench", microseconds(lambda: required_wrench(robot, *single, PAYLOAD), 1000)),
        (
            "  bounded tensions (closest)",
            microseconds(lambda: distribute_tensions(A, w, *limits, method="closest"), 1000),
        ),
        ("constructing a pose", microseconds(lambda: Pose(single[0].position, single[0].rotation), 1000)),
        (_WARM, microseconds(lambda: forward_kinematics(robot, lengths, guess), 1000)),
        ("forward kinematics without a guess", microseconds(lambda: forward_kinematics(robot, lengths), 400)),
    ]
    per_pose = 1e6 / BATCH
    rows.append((_BATCH_CHAIN, per_pose * seconds(lambda: chain(robot, *batch))))
    if (os.cpu_count() or 1) > 1:
        two = per_pose * seconds(lambda: chain(robot, *batch, threads=2), perf_counter)
        rows.append((_TWO_THREADS, two))
    warm = per_pose * seconds(lambda: solve_forward_kinematics(robot, batch_lengths, near))
    rows.append((f"forward kinematics, from 1 cm away, batch of {BATCH}", warm))
    if with_numpy:
        rows.append(("plain numpy: chain, one pose", microseconds(in_numpy, 400)))
    factor = 1.0 if with_numpy else 2.0
    print_table(title, rows, whole, {name: factor * aim for name, aim in AIMS.items()})


def import_time() -> float:
    """CPU time of importing all public names in a process of its own, less that of an empty one, us."""

    def of_children() -> float:
        times = os.times()
        return times.children_user + times.children_system

    def run(code: str) -> float:
        return seconds(lambda: subprocess.run([sys.executable, "-c", code], check=True), of_children)

    return 1e6 * (run("from cspr_kinematics import *") - run("pass"))


def main() -> None:
    """Print the tables."""
    imported = import_time()
    print_table("once", [(_IMPORT, imported)], imported, {_IMPORT: 1e6})
    compare(Robot.from_yaml(CONFIG / "robot.yaml"), "fixed exit points, 8 cables", with_numpy=True)
    compare(Robot.from_yaml(CONFIG / "robot_pulleys.yaml"), "pulleys, 8 cables", with_numpy=False)
