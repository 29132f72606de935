"""Search for all poses below the frame that fit lengths, without a guess (docs/model.md, section 5)."""

from __future__ import annotations

import math

import numpy as np

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.kinematics._iteration import (
    BEYOND_PULLEY,
    CONVERGED,
    cosine_between,
    improve_pose,
    length_errors,
)
from cspr_kinematics.motion._linear import assign_matrix, assign_vector, fill_matrix, fill_vector

_POSITION_ITERATIONS = 12
# Poses turned by less than this from each other are one pose: cosine of 3 degrees.
SAME = 0.9986

# How a search ended, in addition to the outcomes of an iteration.
ABOVE_FRAME = 4
AMBIGUOUS = 7


@kernel
def above_frame(geometry: FloatArray, frame: FloatArray, position: FloatArray, rotation: FloatArray) -> bool:
    """Whether the centre of the anchor points lies above the frame's plane n^T x = d, `frame` = (n, d)."""
    m = geometry.shape[0]
    height = -frame[3]
    for j in range(3):
        center = position[j]
        for k in range(3):
            total = 0.0
            for i in range(m):
                total += geometry[i, 3 + k]
            center += rotation[j, k] * total / m
        height += frame[j] * center
    return bool(height > 0.0)


@kernel
def improve_from(
    geometry: FloatArray,
    frame: FloatArray,
    mirrored: bool,
    target: FloatArray,
    weights: FloatArray,
    max_iterations: int,
    position: FloatArray,
    rotation: FloatArray,
    error: FloatArray,
    jacobian: FloatArray,
) -> tuple[int, int, float]:
    """Improve a pose that may be far off: the position alone first, which is a well-behaved problem.

    With `mirrored`, a position above the frame is taken to the same distance below it in between.
    """
    status, total, cost = improve_pose(
        geometry, target, weights, 3, _POSITION_ITERATIONS, position, rotation, error, jacobian
    )
    if status == BEYOND_PULLEY:
        return status, total, cost
    if mirrored and above_frame(geometry, frame, position, rotation):
        height = frame[0] * position[0] + frame[1] * position[1] + frame[2] * position[2] - frame[3]
        for j in range(3):
            position[j] -= 2.0 * height * frame[j]
    status, count, cost = improve_pose(
        geometry, target, weights, 6, max_iterations, position, rotation, error, jacobian
    )
    return status, total + count, cost


@kernel
def search_pose(
    geometry: FloatArray,
    frame: FloatArray,
    starts: FloatArray,
    center: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    limit: float,
    rivalry: float,
    max_iterations: int,
    position: FloatArray,
    rotation: FloatArray,
    error: FloatArray,
    jacobian: FloatArray,
    other: FloatArray,
) -> tuple[int, int, float]:
    """Find a pose without a guess: a fit below the frame, from orientations (s, 3, 3), the first at home.

    A platform that is small compared with its cables fits their lengths about as well when turned over, and six
    lengths fit many poses. Of those whose costs are within `limit`, and not above the least by more than `rivalry`,
    the one turned least from home is taken. If there are others the outcome is AMBIGUOUS, and `other`
    (12,) the next best, position and rotation.
    """
    count = starts.shape[0]
    p, Q = np.empty(3), np.empty((3, 3))
    positions, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    statuses, costs = np.empty(count, dtype=np.int64), np.full(count, math.inf)
    best, best_cost, total = -1, math.inf, 0
    for s in range(count):
        assign_vector(p, center)
        assign_matrix(Q, starts[s])
        status, iterations, cost = improve_from(
            geometry, frame, True, target, weights, max_iterations, p, Q, error, jacobian
        )
        total += iterations
        if status == BEYOND_PULLEY or above_frame(geometry, frame, p, Q):
            continue
        statuses[s], costs[s] = status, cost
        assign_vector(positions[s], p)
        assign_matrix(rotations[s], Q)
        if cost < best_cost:
            best, best_cost = s, cost
    if best < 0:
        fill_vector(error, math.nan)
        fill_matrix(jacobian, math.nan)
        assign_vector(position, center)
        assign_matrix(rotation, starts[0])
        return ABOVE_FRAME, total, best_cost

    acceptable = min(limit, best_cost + rivalry)
    chosen, least_turned = best, -math.inf
    for s in range(count):
        if statuses[s] == CONVERGED and costs[s] <= acceptable:
            cosine = cosine_between(rotations[s], starts[0])
            if cosine > least_turned:
                chosen, least_turned = s, cosine
    status, next_cost = int(statuses[chosen]), math.inf
    for s in range(count):
        rival = statuses[s] == CONVERGED and costs[s] <= min(acceptable, next_cost)
        if rival and cosine_between(rotations[s], rotations[chosen]) < SAME:
            status, next_cost = AMBIGUOUS, costs[s]
            assign_vector(other[:3], positions[s])
            assign_vector(other[3:], rotations[s].ravel())
    assign_vector(position, positions[chosen])
    assign_matrix(rotation, rotations[chosen])
    cost = length_errors(geometry, target, weights, position, rotation, error, jacobian)
    return status, total, cost
