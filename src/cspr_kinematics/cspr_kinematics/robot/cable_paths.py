"""The geometry that the kernels work on, from points and pulleys; and errors from the kernels' faults."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import FloatArray, checked, frozen, require_one_for_each_cable
from cspr_kinematics.compiled import kernel_input
from cspr_kinematics.errors import CableReachError, InvalidInputError
from cspr_kinematics.motion.pose import Pose
from cspr_kinematics.robot._cable_paths import (
    BEYOND_RANGE,
    INSIDE_PULLEY,
    NO_LENGTH,
    ON_SWIVEL_AXIS,
    PATH_EXISTS,
    lengths_at_poses,
)
from cspr_kinematics.robot.pulleys import Pulleys

MINIMUM_CABLES = 6
_REASONS = {
    NO_LENGTH: "its anchor point coincides with its exit point and the cable has no length",
    INSIDE_PULLEY: "it cannot reach its pulley, because the anchor point lies inside it",
    ON_SWIVEL_AXIS: "its anchor point lies on the swivel axis, where the pulley has no direction",
    BEYOND_RANGE: "its length exceeds the range of numbers",
}


def path_geometry(exit_points: FloatArray, anchor_points: FloatArray, pulleys: Pulleys) -> FloatArray:
    """Return the geometry array (m, 10) that the kernels of cable paths work on.

    Raises
    ------
    InvalidInputError
        If the pulleys are for a different number of cables.
    """
    m = len(exit_points)
    radii, axes = pulleys.radii(m), pulleys.axes(m)
    return frozen(np.concatenate((exit_points, anchor_points, radii[:, None], axes), axis=1))


def path_error(fault: int, cable: int, member: int, pose: Pose) -> CableReachError:
    """Return the error for a fault of cable index `cable` at the flat index `member` of a batch of poses."""
    index = tuple(int(i) for i in np.unravel_index(member, pose.batch_shape)) if pose.batch_shape else ()
    return CableReachError(_REASONS[fault], cable + 1, pose.position[index], pose.rotation[index], index)


def path_lengths(geometry: FloatArray, pose: Pose) -> FloatArray:
    """Return cable lengths (..., m) for a geometry array (m, 10), m.

    Raises
    ------
    CableReachError
        If a cable has no path.
    """
    batch = pose.batch_shape
    n = math.prod(batch)
    lengths = np.empty((*batch, len(geometry)))
    fault, cable, member = lengths_at_poses(
        geometry,
        kernel_input(pose.position, n, 3),
        kernel_input(pose.rotation, n, 3, 3),
        lengths.reshape(n, len(geometry)),
    )
    if fault != PATH_EXISTS:
        raise path_error(fault, cable, member, pose)
    return lengths


def home_lengths(
    exit_points: ArrayLike, anchor_points: ArrayLike, home: Pose, pulleys: Pulleys | None = None
) -> FloatArray:
    """Return the cable lengths (m,) at a home pose, which are the zero of the winches, m.

    For building a robot from points that do not come from a file: `Winch.home_lengths` must match them, and with
    pulleys these are not the distances between the points.

    Parameters
    ----------
    exit_points, anchor_points : array_like, shape (m, 3)
        In base and in platform, m.
    home : Pose
        A single pose.
    pulleys : Pulleys, optional
        None for fixed exit points.

    Raises
    ------
    InvalidInputError
        If there are fewer than 6 cables, the points do not match each other or the pulleys, home is a batch, or a
        cable has no path there.
    """
    exits = checked_points("exit_points", exit_points)
    anchors = checked_points("anchor_points", anchor_points)
    m = len(exits)
    if m < MINIMUM_CABLES:
        raise InvalidInputError(
            "exit_points", exits, f"{m} cables; six degrees of freedom need at least {MINIMUM_CABLES}"
        )
    require_one_for_each_cable("anchor_points", anchors, m)
    if home.batch_shape:
        raise InvalidInputError("home", home.position, "must be a single pose")
    geometry = path_geometry(exits, anchors, Pulleys.none() if pulleys is None else pulleys)
    try:
        return path_lengths(geometry, home)
    except CableReachError as error:
        reason = f"cable {error.cable} has no length at home; {error.fault}"
        if pulleys is None or not pulleys.radius.any():
            raise InvalidInputError("home", home.position, reason) from error
        home_lengths(exits, anchors, home)  # what is wrong without pulleys is not their fault
        raise InvalidInputError("pulleys.radius", pulleys.radius, reason) from error


def checked_points(name: str, value: ArrayLike) -> FloatArray:
    """Return points (m, 3) as a read-only array.

    Raises
    ------
    InvalidInputError
        If they are not finite or have another shape.
    """
    points = checked(name, value, 3)
    if points.ndim != 2:
        raise InvalidInputError(name, value, f"shape {points.shape} where (m, 3) is needed")
    return frozen(points)
