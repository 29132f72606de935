"""How the time of the mathematics grows with the number of cables and of poses."""

from __future__ import annotations

import dataclasses
from time import perf_counter

import numpy as np

from benchmarks.kinematics import CONFIG, PAYLOAD, draw, in_the_kernel
from benchmarks.timing import microseconds
from cspr_kinematics import Robot, feedforward_tensions, inverse_kinematics, solve_forward_kinematics


def with_cables(robot: Robot, m: int) -> Robot:
    """Return the shipped robot's frame and platform with m cables around it, crossed like its own."""
    angle = 2.0 * np.pi * (np.arange(m) + 0.5) / m
    exits = np.stack((2.5 * np.cos(angle), 1.5 * np.sin(angle), np.full(m, 3.0)), axis=-1)
    turned = angle + np.where(np.arange(m) % 2, 1.9, -1.9)
    height = np.where(np.arange(m) % 2, 0.2, -0.2)
    anchors = np.stack((0.3 * np.cos(turned), 0.3 * np.sin(turned), height), axis=-1)
    wide = dataclasses.replace(robot, tension_min=0.0, tension_max=20_000.0)
    return wide.with_geometry(exit_points=exits, anchor_points=anchors)


def main() -> None:
    """Print the tables."""
    shipped = Robot.from_yaml(CONFIG / "robot.yaml")
    random = np.random.default_rng(1)
    header = f"\n{'cables':>8}{'chain, one pose':>18}{'ratio':>8}{'in the kernel':>16}{'ratio':>8}"
    print(header + f"{'forward, warm':>16}{'ratio':>8}{'feasible':>10}")
    first: tuple[float, float, float] | None = None
    for m in range(6, 17, 2):
        robot = with_cables(shipped, m)
        single, batch = draw(robot, random), draw(robot, random, 1000)
        lengths = inverse_kinematics(robot, batch[0]).lengths
        near = draw(robot, np.random.default_rng(1), 1000)[0]
        times = (
            microseconds(lambda r=robot, s=single: feedforward_tensions(r, *s, PAYLOAD), 400),
            in_the_kernel(robot, batch),
            microseconds(lambda r=robot, x=lengths, g=near: solve_forward_kinematics(r, x, g), 40) / 1000,
        )
        first = first or times
        feasible = feedforward_tensions(robot, *batch, PAYLOAD).feasible.mean()
        columns = "".join(
            f"{t:>{w}.2f}{t / f:>8.2f}" for t, f, w in zip(times, first, (18, 16, 16), strict=True)
        )
        print(f"{m:>8}{columns}{feasible:>10.0%}")

    print(f"\n{'poses':>8}{'one thread, us a pose':>24}{'two threads':>14}{'gain':>8}")
    for n in (1, 10, 100, 1000, 10_000, 100_000):
        batch = draw(shipped, random, n)
        times_by_threads = []
        for threads in (1, 2):
            best = np.inf
            for _ in range(5):
                start = perf_counter()
                feedforward_tensions(shipped, *batch, PAYLOAD, threads=threads)
                best = min(best, perf_counter() - start)
            times_by_threads.append(1e6 * best / n)
        one, two = times_by_threads
        print(f"{n:>8}{one:>24.2f}{two:>14.2f}{one / two:>8.2f}")
