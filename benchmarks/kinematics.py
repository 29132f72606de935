"""Time of the control cycle's mathematics: one pose at a time and in batches, as ratios within one run."""

from __future__ import annotations

from collections.abc import Callable
from time import perf_counter

import numpy as np

from benchmarks.closed_loop import CONFIG
from cspr_kinematics import (
    Acceleration,
    Pose,
    Robot,
    Twist,
    distribute_tensions,
    forward_kinematics,
    inverse_kinematics,
    required_wrench,
)

BATCH = 10_000


def microseconds(function: Callable[[], object], repetitions: int) -> float:
    """Best mean time of three series, us."""
    times = []
    for _ in range(3):
        start = perf_counter()
        for _ in range(repetitions):
            function()
        times.append((perf_counter() - start) / repetitions)
    return min(times) * 1e6


def main() -> None:
    """Print the table."""
    robot = Robot.from_yaml(CONFIG / "robot.yaml")
    random = np.random.default_rng(0)

    def motion(*shape: int) -> tuple[Pose, Twist, Acceleration]:
        position = robot.home.position + random.uniform(-0.3, 0.3, (*shape, 3))
        angles = random.uniform(-0.1, 0.1, (3, *shape))
        return (
            Pose.from_euler(position, *angles),
            Twist(random.normal(size=(*shape, 3)), random.normal(size=(*shape, 3))),
            Acceleration(random.normal(size=(*shape, 3)), random.normal(size=(*shape, 3))),
        )

    single, batch = motion(), motion(BATCH)
    lengths = inverse_kinematics(robot, single[0]).lengths
    limits = robot.tension_min, robot.tension_max

    def feedforward(case: tuple[Pose, Twist, Acceleration]) -> None:
        cables = inverse_kinematics(robot, case[0])
        distribute_tensions(cables.wrench_matrix, required_wrench(robot, *case), *limits)

    base = microseconds(lambda: inverse_kinematics(robot, single[0]), 2000)
    rows = [
        ("inverse kinematics, wrench matrix", base),
        ("required wrench", microseconds(lambda: required_wrench(robot, *single), 2000)),
        ("whole feed-forward: with minimum-norm tensions", microseconds(lambda: feedforward(single), 1000)),
        (
            f"whole feed-forward in a batch of {BATCH}, per pose",
            microseconds(lambda: feedforward(batch), 3) / BATCH,
        ),
        (
            "forward kinematics from a guess 1 cm away",
            microseconds(
                lambda: forward_kinematics(
                    robot, lengths, Pose(single[0].position + 0.01, single[0].rotation)
                ),
                300,
            ),
        ),
    ]
    print(f"{'':50}{'us':>10}{'ratio':>10}")
    for name, time in rows:
        print(f"{name:50}{time:>10.2f}{time / base:>10.2f}")
