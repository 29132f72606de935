"""Robots, motions and wrenches that the benchmarks share."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

from cspr_kinematics import (
    Acceleration,
    CableProperties,
    Payload,
    Pose,
    Robot,
    TensionResult,
    Twist,
    distribute_tensions,
    home_lengths,
    inverse_kinematics,
    required_wrench,
)
from cspr_kinematics.compiled import kernel_input

CONFIG = Path(__file__).parents[1] / "config"
PAYLOAD = Payload(100.0, [0.0, 0.0, 0.1])
LOW, HIGH = 100.0, 900.0  # N, limits of the tensions in `wrenches`

Motion = tuple[Pose, Twist, Acceleration]
Problem = tuple[np.ndarray, np.ndarray]  # wrench matrix (6, m), wrench (6,)


def with_cables(m: int) -> Robot:
    """Return the shipped robot's frame and platform with m cables around it, crossed like its own."""
    angle = 2.0 * np.pi * (np.arange(m) + 0.5) / m
    exits = np.stack((2.5 * np.cos(angle), 1.5 * np.sin(angle), np.full(m, 3.0)), axis=-1)
    odd = np.arange(m) % 2 == 1
    turned = angle + np.where(odd, 1.9, -1.9)
    anchors = np.stack((0.3 * np.cos(turned), 0.3 * np.sin(turned), np.where(odd, 0.2, -0.2)), axis=-1)
    shipped = Robot.from_yaml(CONFIG / "robot.yaml")
    winch = dataclasses.replace(shipped.winch, home_lengths=home_lengths(exits, anchors, shipped.home))
    return dataclasses.replace(
        shipped,
        exit_points=exits,
        anchor_points=anchors,
        winch=winch,
        tension_min=np.zeros(m),
        tension_max=np.full(m, 20_000.0),
        cables=CableProperties(),
    )


def motions(robot: Robot, random: np.random.Generator, *shape: int) -> Motion:
    """Lively motions around the home pose."""
    position = robot.home.position + random.uniform(-0.3, 0.3, (*shape, 3))
    angles = random.uniform(-0.1, 0.1, (3, *shape))
    return (
        Pose.from_euler(position, *angles),
        Twist(random.normal(size=(*shape, 3)), random.normal(size=(*shape, 3))),
        Acceleration(random.normal(size=(*shape, 3)), random.normal(size=(*shape, 3))),
    )


def chain(
    robot: Robot, pose: Pose, twist: Twist, acceleration: Acceleration, threads: int = 1
) -> TensionResult:
    """Cables, wrench and bounded tensions: the mathematics of a control cycle."""
    A = inverse_kinematics(robot, pose).wrench_matrix
    w = required_wrench(robot, pose, twist, acceleration, PAYLOAD)
    return distribute_tensions(A, w, robot.tension_min, robot.tension_max, "closest", threads=threads)


def wrenches(m: int, count: int, *, feasible: bool) -> list[Problem]:
    """Wrenches whose nearest tensions have active limits, with some room left; or wrenches out of reach."""
    robot, random = with_cables(m), np.random.default_rng(m)
    problems: list[Problem] = []
    while len(problems) < count:
        place = random.uniform([-0.8, -0.5, 0.5], [0.8, 0.5, 1.5])
        A = inverse_kinematics(robot, Pose.from_euler(place, *random.uniform(-0.1, 0.1, 3))).wrench_matrix
        if not feasible:
            w = 2000.0 * random.normal(size=6)
            chosen = not distribute_tensions(A, w, LOW, HIGH, "closest").feasible
        else:
            w = A @ random.uniform(LOW, HIGH, m)
            room = distribute_tensions(A, w, LOW, HIGH, "analytic_center").margin > 1.0
            active = distribute_tensions(A, w, LOW, HIGH, "closest").margin <= 1e-9 * HIGH
            chosen = bool(room and (active or m == 6))  # 6 cables leave no choice
        if chosen:
            problems.append((A, kernel_input(w, 6)))
    return problems
