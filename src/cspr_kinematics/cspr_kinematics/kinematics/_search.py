"""Search for the pose below the frame that fits lengths, without a guess (docs/model.md, section 5)."""

from __future__ import annotations

import math

import numpy as np

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.kinematics._iteration import BEYOND_PULLEY, CONVERGED, improve_pose, length_errors
from cspr_kinematics.motion._linear import assign_matrix, assign_vector, fill_matrix, fill_vector

# A pose that fits this well (root of the mean square, m) ends the search.
EXACT_FIT = 1e-7
_POSITION_ITERATIONS = 12
# Sums of squared errors within this factor of the least are about equally well explained by noise.
ABOUT_AS_WELL = 30.0

# How a search ended, in addition to the outcomes of an iteration.
ABOVE_FRAME = 4


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
def search_pose(
    geometry: FloatArray,
    frame: FloatArray,
    starts: FloatArray,
    center: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    noise: float,
    max_iterations: int,
    position: FloatArray,
    rotation: FloatArray,
    error: FloatArray,
    jacobian: FloatArray,
) -> tuple[int, int, float]:
    """Find a pose without a guess: a fit below the frame, from orientations (s, 3, 3), the first at home.

    For each, the position alone is found first, from `center`, which is a well-behaved problem; then the
    pose. The search ends at an exact fit. Lengths with errors have none, and a platform that is small
    compared with them fits about as well upside down: of the poses that fit about as well as the best, or
    whose errors have a root mean square below `noise`, the one turned least from home is taken.
    """
    m = geometry.shape[0]
    count = starts.shape[0]
    p, Q, e, J = np.empty(3), np.empty((3, 3)), np.empty(m), np.empty((m, 6))
    positions, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    statuses, costs = np.empty(count, dtype=np.int64), np.full(count, math.inf)
    best_cost, total, exact = math.inf, 0, -1
    for s in range(count):
        assign_vector(p, center)
        assign_matrix(Q, starts[s])
        status, cost = CONVERGED, math.inf
        for stage in range(2):
            unknowns, limit = (3, _POSITION_ITERATIONS) if stage == 0 else (6, max_iterations)
            status, iterations, cost = improve_pose(geometry, target, weights, unknowns, limit, p, Q, e, J)
            total += iterations
            if status == BEYOND_PULLEY:
                break
            if stage == 0 and above_frame(geometry, frame, p, Q):
                # mirrored: the same distance below the plane
                height = frame[0] * p[0] + frame[1] * p[1] + frame[2] * p[2] - frame[3]
                for j in range(3):
                    p[j] -= 2.0 * height * frame[j]
        if status == BEYOND_PULLEY or above_frame(geometry, frame, p, Q):
            continue
        statuses[s], costs[s] = status, cost
        assign_vector(positions[s], p)
        assign_matrix(rotations[s], Q)
        best_cost = min(best_cost, cost)
        if status == CONVERGED and 2.0 * cost <= m * EXACT_FIT * EXACT_FIT:
            exact = s
            break
    if best_cost == math.inf:
        fill_vector(error, math.nan)
        fill_matrix(jacobian, math.nan)
        assign_vector(position, center)
        assign_matrix(rotation, starts[0])
        return ABOVE_FRAME, total, best_cost

    chosen, least_turned = exact, -math.inf
    acceptable = max(ABOUT_AS_WELL * best_cost, 0.5 * m * noise * noise)
    for s in range(count):
        if exact < 0 and costs[s] <= acceptable:
            # 1 + 2 cos of the angle from the orientation at home; any minimum that was reached is preferred
            turned = 4.0 if statuses[s] == CONVERGED else 0.0
            for i in range(3):
                for j in range(3):
                    turned += rotations[s, i, j] * starts[0, i, j]
            if turned > least_turned:
                chosen, least_turned = s, turned
    assign_vector(position, positions[chosen])
    assign_matrix(rotation, rotations[chosen])
    cost = length_errors(geometry, target, weights, position, rotation, error, jacobian)
    return int(statuses[chosen]), total, cost
