"""Finding the wrench-feasible workspace: a task assessed on a grid of poses."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import FloatArray, checked, positive_integer, positive_number, single
from cspr_kinematics.errors import CableReachError, InvalidInputError
from cspr_kinematics.motion.pose import Pose
from cspr_kinematics.robot.robot import Robot
from cspr_kinematics.workspace.feasibility import Task, assess_task
from cspr_kinematics.workspace.workspace import Workspace

Progress = Callable[[int, int], None]  # poses done, poses in all

_CHUNK = 512  # poses assessed between two reports of progress
_LEVEL = ((0.0, 0.0, 0.0),)
_MOST_POSES = 50_000_000


def explore_workspace(
    robot: Robot,
    task: Task | None = None,
    *,
    lower: ArrayLike | None = None,
    upper: ArrayLike | None = None,
    spacing: float = 0.1,
    orientations: Sequence[Sequence[float]] = _LEVEL,
    lever: float = 1.0,
    threads: int = 1,
    progress: Progress | None = None,
) -> Workspace:
    """Assess `task` at every position of a grid, in each of the given orientations.

    Parameters
    ----------
    robot : Robot
    task : Task, optional
        By default, holding the empty platform at rest.
    lower, upper : array_like, shape (3,), optional
        Corners of the grid in base, m; by default the robot's `workspace_min` and `workspace_max`.
    spacing : float
        Largest distance between neighbouring positions along each axis, m.
    orientations : sequence of (alpha, beta, gamma)
        Angles of eq. 4, rad; by default the level platform alone.
    lever : float
        Length at which a moment counts as a force in the margin, m.
    threads : int
        Number of threads that share the poses.
    progress : callable, optional
        Called now and then, in this thread, with the number of poses done and the number of all poses.

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape, the corners are not in order, the spacing is not
        positive or would take more than 50 million poses, or there is no orientation.
    """
    angles = checked("orientations", orientations, 3).reshape(-1, 3)
    if not len(angles):
        raise InvalidInputError("orientations", orientations, "at least one is needed")
    axes = _axes(robot, lower, upper, spacing, _MOST_POSES // len(angles))
    shape = tuple(map(len, axes))
    count = math.prod(shape)
    total = count * len(angles)
    positive_number("lever", lever)
    positive_integer("threads", threads)
    positions = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(count, 3)
    rotations = [Pose.from_euler(np.zeros(3), *angle).rotation for angle in angles]
    margin = np.full(count, np.inf)
    smallest, largest = np.zeros(count), np.full(count, np.inf)

    def assess(first: int) -> int:
        part = slice(first, first + _CHUNK)
        for rotation in rotations:
            values = _assess(robot, positions[part], rotation, task, lever)
            margin[part] = np.minimum(margin[part], values[0])
            smallest[part] = np.maximum(smallest[part], values[1])  # NaN stays
            largest[part] = np.minimum(largest[part], values[2])
        return len(margin[part]) * len(rotations)

    done = 0
    with ThreadPoolExecutor(threads) as pool:
        parts = [pool.submit(assess, first) for first in range(0, count, _CHUNK)]
        try:
            for part in as_completed(parts):
                done += part.result()
                if progress is not None:
                    progress(done, total)
        finally:
            for part in parts:
                part.cancel()
    none = ~(smallest <= largest)
    smallest[none] = np.nan
    largest[none] = np.nan
    return Workspace(*axes, *(array.reshape(shape) for array in (margin, smallest, largest)))


def _assess(
    robot: Robot, positions: FloatArray, rotation: FloatArray, task: Task | None, lever: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return margins and payload ranges (n,) at positions (n, 3); -inf and NaN where a cable has no path."""
    try:
        result = assess_task(robot, Pose(positions, rotation), task, lever=lever)
    except CableReachError:
        if len(positions) == 1:
            return np.array([-np.inf]), np.array([np.nan]), np.array([np.nan])
        half = len(positions) // 2
        parts = [_assess(robot, part, rotation, task, lever) for part in (positions[:half], positions[half:])]
        margin, smallest, largest = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        return margin, smallest, largest
    return result.margin, result.payload_min, result.payload_max


def _axes(
    robot: Robot, lower: ArrayLike | None, upper: ArrayLike | None, spacing: float, most: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    low = single("lower", robot.workspace_min if lower is None else lower, 3)
    high = single("upper", robot.workspace_max if upper is None else upper, 3)
    if np.any(low >= high):
        raise InvalidInputError("lower", low, f"must be below upper = {high.tolist()} in every direction")
    step = positive_number("spacing", spacing)
    # Rounding errors alone must not add another plane to the grid.
    with np.errstate(over="ignore"):
        counts = np.maximum(2.0, np.ceil((high - low) / step - 1e-9) + 1.0)
        positions = float(counts.prod())
    if not positions <= most:
        raise InvalidInputError("spacing", spacing, f"{positions:.4g} positions; at most {most} are allowed")
    x, y, z = (np.linspace(a, b, int(n)) for a, b, n in zip(low, high, counts, strict=True))
    return x, y, z
