"""Where the search for a pose without a guess starts: orientations, a position, the plane of the frame."""

from __future__ import annotations

import functools
import math
from itertools import product
from typing import NamedTuple

import numpy as np

from cspr_kinematics.arrays import FloatArray, frozen
from cspr_kinematics.kinematics.accuracy import Tolerance, tolerance
from cspr_kinematics.motion._rotation import turn
from cspr_kinematics.robot.robot import Robot

# Exit points count as coplanar when they are off the plane by less than this share of their extent.
_FLATNESS = 0.1
# Orientations tried besides that of the home pose: turned and tilted from it by these angles, rad.
_TURNS = (0.0, 0.8, -0.8, 1.6, -1.6, 2.4, -2.4, 3.14)
_TILTS = (0.0, 0.6, -0.6)


class PoseSearch(NamedTuple):
    """Where the search without a guess starts, and what is constant for the kernels."""

    frame: FloatArray  # (4,): the plane n^T x = d, n upwards, above which no platform hangs
    starts: FloatArray  # (s, 3, 3)
    center: FloatArray  # (3,): middle of the workspace
    home: FloatArray  # (12,): position and rotation
    tolerance: Tolerance  # of what robot.length_deviation explains


@functools.lru_cache(maxsize=16)
def pose_search(robot: Robot) -> PoseSearch:
    """Return where the search for poses of a robot starts; computed once for each robot."""
    base = robot.home.rotation
    starts = np.empty((len(_TURNS) * len(_TILTS) ** 2, 3, 3))
    tilted = np.empty((3, 3))
    by_angle = sorted(product(_TURNS, _TILTS, _TILTS), key=lambda angles: math.hypot(*angles))
    for start, (about_z, x, y) in zip(starts, by_angle, strict=True):
        turn(x, y, 0.0, np.eye(3), tilted)
        turn(0.0, 0.0, about_z, base @ tilted, start)
    return PoseSearch(
        frozen(_frame_plane(robot)),
        frozen(starts),
        frozen(0.5 * (robot.workspace_min + robot.workspace_max)),
        frozen(np.concatenate((robot.home.position, base.ravel()))),
        tolerance(np.full(robot.number_of_cables, robot.length_deviation)),
    )


def _frame_plane(robot: Robot) -> FloatArray:
    """Return (n, d) of the exit points' plane; if they are not coplanar, of the level one through the highest."""
    exits = robot.exit_points
    middle = exits.mean(axis=0)
    _, extents, axes = np.linalg.svd(exits - middle)
    normal = axes[2] * np.sign(axes[2, 2])
    if extents[2] < _FLATNESS * extents[1] and normal[2] > 0.5:
        return np.append(normal, normal @ middle)
    return np.array([0.0, 0.0, 1.0, exits[:, 2].max()])
