"""From points and pulleys to the geometry the kernels work on, and from their faults to errors."""

from __future__ import annotations

import math

import numpy as np

from .arrays import FloatArray, frozen
from .compiled import kernel_input
from .errors import CableReachError
from .kernels.cable_kernels import INSIDE_PULLEY, NO_LENGTH, ON_SWIVEL_AXIS, PATH_EXISTS, lengths_at_poses
from .pose import Pose
from .pulleys import Pulleys

_REASONS = {
    NO_LENGTH: "its anchor point coincides with its exit point and the cable has no length",
    INSIDE_PULLEY: "cannot reach its pulley; the anchor point lies inside it",
    ON_SWIVEL_AXIS: "its anchor point lies on the swivel axis, where the pulley has no direction",
}


def path_geometry(exit_points: FloatArray, anchor_points: FloatArray, pulleys: Pulleys) -> FloatArray:
    """Return the geometry array (m, 10) of `kernels.cable_kernels`.

    Raises
    ------
    InvalidInputError
        If the pulleys are those of another number of cables.
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
