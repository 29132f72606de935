"""How the time of the mathematics grows with the number of cables and of poses."""

from __future__ import annotations

from functools import partial
from time import perf_counter

import numpy as np

from benchmarks.problems import CONFIG, HIGH, LOW, Problem, chain, motions, with_cables, wrenches
from benchmarks.tensions import own, time_of
from benchmarks.timing import microseconds, seconds
from cspr_kinematics import (
    Pose,
    Robot,
    available_wrenches,
    distribute_tensions,
    inverse_kinematics,
    solve_forward_kinematics,
)

COLUMNS = (
    "chain",
    "forward, warm",
    "closest",
    "steps",
    "infeasible",
    "steps",
    "centre",
    "faces",
)


def growth_with_cables() -> None:
    """Print times of one pose from 6 to 16 cables."""
    random = np.random.default_rng(1)
    print(f"\n{'us for one pose':>16}" + "".join(f"{title:>14}" for title in COLUMNS))
    rows = []
    for m in range(6, 17):
        robot = with_cables(m)
        single, batch = motions(robot, random), motions(robot, random, 1000)
        lengths = inverse_kinematics(robot, batch[0]).lengths
        near = Pose(batch[0].position + 0.01 / np.sqrt(3.0), batch[0].rotation)
        within, beyond = (wrenches(m, 40, feasible=feasible) for feasible in (True, False))
        closest, center = own("closest")(m), own("analytic_center")(m)
        rows.append(
            [
                microseconds(partial(chain, robot, *single), 400),
                microseconds(partial(solve_forward_kinematics, robot, lengths, near), 40) / 1000,
                time_of(closest, within),
                most_steps(within),
                time_of(closest, beyond),
                most_steps(beyond),
                time_of(center, within),
                time_of(lambda A, w: available_wrenches(A, LOW, HIGH).margin(w), within[:5]),
            ]
        )
        print(f"{f'{m} cables':>16}" + "".join(f"{value:>14.4g}" for value in rows[-1]))
    ratios = [last / first if first else 0.0 for first, last in zip(rows[0], rows[-1], strict=True)]
    print(f"{'ratio 16 to 6':>16}" + "".join(f"{ratio:>14.1f}" if ratio else f"{'':>14}" for ratio in ratios))


def most_steps(problems: list[Problem]) -> int:
    """Largest number of steps that `closest` takes; at most 20 per cable and 100 in all."""
    return max(int(distribute_tensions(A, w, LOW, HIGH, "closest").steps) for A, w in problems)


def growth_with_poses() -> None:
    """Print the time per pose in batches, on one thread and on two."""
    robot, random = Robot.from_yaml(CONFIG / "robot.yaml"), np.random.default_rng(1)
    problems = wrenches(8, 40, feasible=True)
    print(f"\n{'us per pose, 8 cables':>22}{'chain':>12}{'2 threads':>12}{'gain':>8}", end="")
    print(f"{'closest':>12}{'2 threads':>12}{'gain':>8}")
    for n in (1, 10, 100, 1000, 10_000, 100_000):
        batch = motions(robot, random, n)
        A = np.resize(np.stack([A for A, _ in problems]), (n, 6, 8))
        w = np.resize(np.stack([w for _, w in problems]), (n, 6))
        all_of_it, tensions = (
            [1e6 / n * seconds(partial(call, threads=threads), perf_counter) for threads in (1, 2)]
            for call in (
                partial(chain, robot, *batch),
                partial(distribute_tensions, A, w, LOW, HIGH, "closest"),
            )
        )
        cells = [f"{one:>12.2f}{two:>12.2f}{one / two:>8.2f}" for one, two in (all_of_it, tensions)]
        print(f"{n:>22}" + "".join(cells))


def main() -> None:
    """Print the tables."""
    growth_with_cables()
    growth_with_poses()
