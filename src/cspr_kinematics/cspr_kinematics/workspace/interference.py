"""Distances between cables, and between cables and the platform."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_kinematics.arrays import FloatArray, ReadOnlyArrays, non_negative_number, single
from cspr_kinematics.compiled import in_batch, kernel_input
from cspr_kinematics.errors import InvalidInputError
from cspr_kinematics.kinematics.inverse import inverse_kinematics
from cspr_kinematics.motion.pose import Pose
from cspr_kinematics.robot.robot import Robot
from cspr_kinematics.workspace._interference import box_distances_kernel, cable_distances_kernel

# Cables whose anchor or exit points are this close together meet there by design, m.
_SAME_POINT = 1e-6


@dataclass(frozen=True, eq=False)
class Interference(ReadOnlyArrays):
    """Distances between cables, and between cables and the platform; arrays are read-only.

    Attributes
    ----------
    pairs : numpy.ndarray of int, shape (p, 2)
        Numbers of the cables of each pair, 1..m as on topics; pairs that share a point are left out.
    pair_distances : numpy.ndarray, shape (..., p)
        Smallest distance between the two cables of each pair, m.
    platform_distances : numpy.ndarray, shape (..., m)
        Smallest distance between each cable, except its end at the anchor point, and the platform's box, m;
        0 where the cable passes through the box.
    """

    pairs: NDArray[np.int64]
    pair_distances: FloatArray
    platform_distances: FloatArray

    @property
    def between_cables(self) -> FloatArray:
        """Smallest distance between any two cables, shape (...), m; infinite without a pair."""
        return np.asarray(self.pair_distances.min(axis=-1, initial=np.inf))

    @property
    def to_platform(self) -> FloatArray:
        """Smallest distance between any cable and the platform's box, shape (...), m."""
        return np.asarray(self.platform_distances.min(axis=-1))

    @property
    def nearest(self) -> NearestPair:
        """The two things that come closest to each other, and where in the batch."""
        candidates: list[NearestPair] = []
        named = [(f"cable {i}", f"cable {j}") for i, j in self.pairs]
        with_platform = [(f"cable {k + 1}", "platform") for k in range(self.platform_distances.shape[-1])]
        for distances, names in ((self.pair_distances, named), (self.platform_distances, with_platform)):
            if distances.size:
                *index, which = map(int, np.unravel_index(int(distances.argmin()), distances.shape))
                candidates.append(NearestPair(float(distances.min()), *names[which], tuple(index)))
        if not candidates:
            raise InvalidInputError("pose", self.platform_distances.shape, "the batch holds no pose")
        return min(candidates, key=lambda candidate: candidate.distance)


@dataclass(frozen=True)
class NearestPair:
    """Two things and their distance.

    Attributes
    ----------
    distance : float
        m.
    first, second : str
        "cable 1" to "cable m", or "platform".
    index : tuple of int
        Which pose of the batch it is; () for a single pose.
    """

    distance: float
    first: str
    second: str
    index: tuple[int, ...]


def cable_interference(
    robot: Robot,
    pose: Pose,
    *,
    box_center: ArrayLike | None = None,
    box_size: ArrayLike | None = None,
    anchor_zone: float = 0.05,
) -> Interference:
    """Return the distances between cables, and between cables and platform, at a pose or a batch of poses.

    Cables are straight lines without thickness, from the anchor point to the exit point or to where they leave
    their pulley.

    Parameters
    ----------
    robot : Robot
    pose : Pose
        One pose, or a batch such as the poses of a trajectory.
    box_center, box_size : array_like, shape (3,), optional
        The platform's box in platform axes, m. By default it has the robot's `platform_size`, and the same
        centre as the smallest box around the anchor points.
    anchor_zone : float
        This length of each cable next to its anchor point, which lies on the platform, is left out of the
        distances to the box, m.

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape, a size is not positive, the zone negative, or a cable
        has no path at a pose.
    """
    size = single("box_size", robot.platform_size if box_size is None else box_size, 3)
    middle = 0.5 * (robot.anchor_points.min(axis=0) + robot.anchor_points.max(axis=0))
    center = single("box_center", middle if box_center is None else box_center, 3)
    if size.min() <= 0.0:
        raise InvalidInputError("box_size", size, "every dimension must be positive")
    zone = non_negative_number("anchor_zone", anchor_zone)
    cables = inverse_kinematics(robot, pose)
    batch, m = pose.batch_shape, robot.number_of_cables
    count = math.prod(batch)
    starts = cables.anchor_points
    spans = cables.free_lengths[..., None] * cables.directions
    first, second = np.triu_indices(m, 1)
    between = [np.linalg.norm(p[first] - p[second], axis=1) for p in (robot.exit_points, robot.anchor_points)]
    pairs = np.stack((first, second), axis=1)[np.min(between, axis=0) >= _SAME_POINT]
    pair_distances, box_distances = np.empty((count, len(pairs))), np.empty((count, m))
    cable_distances_kernel(
        kernel_input(starts, count, m, 3), kernel_input(spans, count, m, 3), pairs, pair_distances
    )
    # In platform axes the box stays where it is.
    to_platform = pose.rotation
    local_starts = robot.anchor_points - center
    box_distances_kernel(
        kernel_input(np.broadcast_to(local_starts, (*batch, m, 3)), count, m, 3),
        kernel_input(spans @ to_platform, count, m, 3),
        kernel_input(0.5 * size, 3),
        zone,
        box_distances,
    )
    numbers = in_batch(pairs + 1, (len(pairs),))
    return Interference(numbers, in_batch(pair_distances, batch), in_batch(box_distances, batch))
