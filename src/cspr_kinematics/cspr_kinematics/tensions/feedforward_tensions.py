"""The mathematics of one control cycle in one call, for a single state of motion or a batch."""

from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    broadcast_batch,
    checked,
    frozen,
    positive_integer,
)
from cspr_kinematics.compiled import in_batch, in_chunks, kernel_input
from cspr_kinematics.dynamics.dynamics import motion_arrays, total_parameters
from cspr_kinematics.errors import InvalidInputError, SingularWrenchMatrixError
from cspr_kinematics.motion.pose import Acceleration, Pose, Twist
from cspr_kinematics.robot._cable_paths import PATH_EXISTS
from cspr_kinematics.robot.cable_paths import path_error
from cspr_kinematics.robot.rigid_body import Payload
from cspr_kinematics.robot.robot import Robot
from cspr_kinematics.tensions._feedforward_tensions import BEYOND_RANGE, SINGULAR_MATRIX, feedforward_at_poses

# Below this many states a thread costs more than it saves.
_LEAST_PER_THREAD = 500
_NO_WRENCH = frozen(np.zeros((1, 6)))
_EQUAL_WEIGHTS = frozen(np.ones(6))


class FeedforwardTensions(NamedTuple):
    """What a motion asks of the cables; arrays are read-only.

    Attributes
    ----------
    lengths, length_rates : numpy.ndarray, shape (..., m)
        Of the cables, m and m/s.
    wrench_matrix : numpy.ndarray, shape (..., 6, m)
        A.
    wrench : numpy.ndarray, shape (..., 6)
        What the cables must supply, N and N m.
    tensions : numpy.ndarray, shape (..., m)
        Within the robot's limits: of those that give the wrench the nearest to the reference, of those that
        do not the ones with the least weighted wrench error, N.
    feasible : numpy.ndarray of bool, shape (...)
        Whether they give the wrench (within 1e-6 of its norm).
    residual : numpy.ndarray, shape (...)
        Norm of the wrench error A t - w; newton and newton metre count alike.
    status : numpy.ndarray of int, shape (...)
        A `TensionStatus` for each.
    """

    lengths: FloatArray
    length_rates: FloatArray
    wrench_matrix: FloatArray
    wrench: FloatArray
    tensions: FloatArray
    feasible: BoolArray
    residual: FloatArray
    status: IntArray


def feedforward_tensions(
    robot: Robot,
    pose: Pose,
    twist: Twist,
    acceleration: Acceleration,
    payload: Payload | None = None,
    external_wrench: ArrayLike | None = None,
    *,
    reference: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    threads: int = 1,
) -> FeedforwardTensions:
    """Return cable lengths and bounded tensions for a motion: the work of a control cycle in one call.

    The same as `inverse_kinematics`, `required_wrench` and `distribute_tensions` with method "closest" within
    the robot's limits, without the way through Python between them.

    Parameters
    ----------
    robot, pose, twist, acceleration, payload, external_wrench
        As in `required_wrench`.
    reference : float or array_like, shape (m,), optional
        Tensions to come near to, N; by default zero, which makes them those of least norm.
    weights : array_like, shape (6,), optional
        Of the squared components of the wrench error where the wrench is out of reach; by default newton and
        newton metre count alike.
    threads : int
        Over which a batch is divided.

    Raises
    ------
    CableReachError
        If a cable has no path.
    SingularWrenchMatrixError
        If a wrench matrix has lost a rank.
    InvalidInputError
        If the batch axes do not broadcast, or a value is not finite, has another shape, or a weight is not
        positive.
    """
    external = _NO_WRENCH
    if external_wrench is not None:
        external = checked("external_wrench", external_wrench, 6)
        pose = _for_each(external.shape[:-1], pose)
    batch, (rotations, omega, a, alpha) = motion_arrays(pose, twist, acceleration)
    if external_wrench is not None:
        if external.ndim > 1:
            external = np.broadcast_to(external, (*batch, 6))
        external = kernel_input(external, external.size // 6, 6)
    m, n = robot.number_of_cables, math.prod(batch)
    positions = kernel_input(_with_batch(pose.position, batch), n, 3)
    velocities = kernel_input(_with_batch(twist.linear, batch), n, 3)
    limits = _limits_of(robot)
    near = limits.none if reference is None else _per_cable("reference", reference, m)
    share = _EQUAL_WEIGHTS if weights is None else _checked_weights(weights)

    parameters = total_parameters(robot, payload)
    lengths, length_rates, tensions = np.empty((n, m)), np.empty((n, m)), np.empty((n, m))
    wrench_matrix, wrench, residual = np.empty((n, 6, m)), np.empty((n, 6)), np.empty(n)
    feasible, status = np.empty(n, dtype=np.bool_), np.empty(n, dtype=np.int64)

    model = robot.path_geometry, parameters
    motion = positions, rotations, velocities, omega, a, alpha
    constants = limits.t_min, limits.t_max, near, share
    outputs = lengths, length_rates, wrench_matrix, wrench, tensions, feasible, residual, status

    def work(first: int, end: int) -> None:
        part = slice(first, end)
        load = external if len(external) == 1 else external[part]
        arguments: list[Any] = [*model, *(x[part] for x in motion), load, *constants]
        arguments += [x[part] for x in outputs]
        fault, cable, member = feedforward_at_poses(*arguments)
        faults.append((fault, cable, first + member))

    faults: list[tuple[int, int, int]] = []
    if positive_integer("threads", threads) == 1:
        everything: list[Any] = [*model, *motion, external, *constants, *outputs]
        faults = [feedforward_at_poses(*everything)]
    else:
        in_chunks(work, n, threads, _LEAST_PER_THREAD)
    for fault, cable, member in faults:
        if fault == SINGULAR_MATRIX:
            raise _singular(wrench_matrix[member], member, batch)
        if fault == BEYOND_RANGE:
            raise InvalidInputError(
                "wrench", wrench[member], "exceeds, or its tensions do, the range of numbers"
            )
        if fault != PATH_EXISTS:
            whole = Pose.trusted(positions.reshape(*batch, 3), rotations.reshape(*batch, 3, 3))
            raise path_error(fault, cable, member, whole)
    return FeedforwardTensions(
        in_batch(lengths, batch),
        in_batch(length_rates, batch),
        in_batch(wrench_matrix, batch),
        in_batch(wrench, batch),
        in_batch(tensions, batch),
        feasible.reshape(batch),
        residual.reshape(batch),
        status.reshape(batch),
    )


class _Limits(NamedTuple):
    """Tension limits of a robot, and a reference of zero, (m,) each."""

    t_min: FloatArray
    t_max: FloatArray
    none: FloatArray


@functools.lru_cache(maxsize=16)
def _limits_of(robot: Robot) -> _Limits:
    m = robot.number_of_cables
    return _Limits(*(frozen(np.full(m, x)) for x in (robot.tension_min, robot.tension_max, 0.0)))


def _for_each(wrenches: tuple[int, ...], pose: Pose) -> Pose:
    """Return `pose` repeated along the batch axes of external wrenches that it does not have itself.

    Raises
    ------
    InvalidInputError
        If the two do not broadcast.
    """
    batch = broadcast_batch(pose=pose.batch_shape, external_wrench=wrenches)
    if batch == pose.batch_shape:
        return pose
    return Pose.trusted(
        np.broadcast_to(pose.position, (*batch, 3)), np.broadcast_to(pose.rotation, (*batch, 3, 3))
    )


def _with_batch(vectors: FloatArray, batch: tuple[int, ...]) -> FloatArray:
    return vectors if vectors.shape[:-1] == batch else np.broadcast_to(vectors, (*batch, 3))


def _per_cable(name: str, value: ArrayLike, m: int) -> FloatArray:
    array = checked(name, value)
    if array.shape not in ((), (m,)):
        raise InvalidInputError(name, value, f"shape {array.shape} where () or ({m},) is needed")
    return frozen(np.broadcast_to(array, (m,)))


def _checked_weights(weights: ArrayLike) -> FloatArray:
    array = checked("weights", weights)
    if array.shape != (6,) or array.min() <= 0.0:
        raise InvalidInputError("weights", weights, "must be six positive numbers")
    return frozen(array)


def _singular(wrench_matrix: FloatArray, member: int, batch: tuple[int, ...]) -> SingularWrenchMatrixError:
    index = tuple(int(i) for i in np.unravel_index(member, batch)) if batch else ()
    return SingularWrenchMatrixError(
        "some wrench cannot be supplied by any tensions",
        wrench_matrix,
        np.linalg.svd(wrench_matrix)[1],
        index,
    )
