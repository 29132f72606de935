"""Forward kinematics from a guess or by search without one, and the look for slack cables (docs/model.md)."""

from __future__ import annotations

import math

import numpy as np

from ..arrays import BoolArray, FloatArray, IntArray
from ..compiled import kernel
from .linear_kernels import assign_matrix, assign_vector, fill_matrix, fill_vector
from .pose_iteration import BEYOND_PULLEY, CONVERGED, improve_pose, length_errors
from .rotation_kernels import orthonormalise

# Without a guess: a pose that fits this well (root of the mean square, m) ends the search.
_EXACT_FIT = 1e-7
_POSITION_ITERATIONS = 12
# Square sums of errors within this factor of the least are explained by noise about as well.
_ABOUT_AS_WELL = 30.0
# Errors of this share of what is accepted at most are taken for noise.
_NOISE_SHARE = 0.2

# How a search ended, besides the ways in which an iteration does.
NO_POSE_FITS = 2
SLACK_CABLE = 3
ABOVE_FRAME = 4


@kernel
def _above(geometry: FloatArray, frame: FloatArray, position: FloatArray, rotation: FloatArray) -> bool:
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
def _misfit(error: FloatArray, weights: FloatArray) -> float:
    """Return the largest of the length errors that have a weight."""
    largest = 0.0
    for i in range(error.shape[0]):
        if weights[i] > 0.0:
            largest = max(largest, abs(error[i]))
    return largest


@kernel
def _search(
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
    pose. The search ends with an exact fit. Lengths with errors have none, and a platform that is small
    beside them fits about as well turned over: of the poses that fit about as well as the best, or whose
    errors have a root mean square below `noise`, the one turned least from home is taken.
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
            if stage == 0 and _above(geometry, frame, p, Q):
                # mirrored: the same distance below the plane
                height = frame[0] * p[0] + frame[1] * p[1] + frame[2] * p[2] - frame[3]
                for j in range(3):
                    p[j] -= 2.0 * height * frame[j]
        if status == BEYOND_PULLEY or _above(geometry, frame, p, Q):
            continue
        statuses[s], costs[s] = status, cost
        assign_vector(positions[s], p)
        assign_matrix(rotations[s], Q)
        best_cost = min(best_cost, cost)
        if status == CONVERGED and 2.0 * cost <= m * _EXACT_FIT * _EXACT_FIT:
            exact = s
            break
    if best_cost == math.inf:
        fill_vector(error, math.nan)
        fill_matrix(jacobian, math.nan)
        assign_vector(position, center)
        assign_matrix(rotation, starts[0])
        return ABOVE_FRAME, total, best_cost

    chosen, least_turned = exact, -math.inf
    acceptable = max(_ABOUT_AS_WELL * best_cost, 0.5 * m * noise * noise)
    for s in range(count):
        if exact < 0 and costs[s] <= acceptable:
            # 1 + 2 cos of the angle from the orientation at home; any minimum that was reached goes before
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


@kernel
def _find_slack(
    geometry: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    deviation: FloatArray,
    max_residual: float,
    max_misfit: FloatArray,
    max_iterations: int,
    position: FloatArray,
    rotation: FloatArray,
    home: FloatArray,
    slack: FloatArray,
) -> bool:
    """Look for cables without which the others fit; fill in by how much they are slack.

    One cable after the other is left out, the one first without which the rest fits best; at least seven are
    left, because six fit any lengths. Only a cable that is longer than its path can be slack.
    """
    m = geometry.shape[0]
    left = np.empty(m)
    assign_vector(left, weights)
    p, Q, e, J = np.empty(3), np.empty((3, 3)), np.empty(m), np.empty((m, 6))
    best_error = np.empty(m)
    fill_vector(slack, 0.0)
    count = m
    while count > 7:
        best, best_cost = -1, math.inf
        for k in range(m):
            if left[k] == 0.0:
                continue
            left[k] = 0.0
            for start in range(2):
                if start == 0:
                    assign_vector(p, position)
                    assign_matrix(Q, rotation)
                else:
                    for j in range(3):
                        p[j] = home[j]
                        for i in range(3):
                            Q[j, i] = home[3 + 3 * j + i]
                status, _, cost = improve_pose(geometry, target, left, J.shape[1], max_iterations, p, Q, e, J)
                if status == CONVERGED and cost < best_cost and e[k] < 0.0:
                    best, best_cost = k, cost
                    assign_vector(best_error, e)
            left[k] = weights[k]
        if best < 0:
            return False
        left[best] = 0.0
        count -= 1
        if _fits(best_error, left, deviation, max_residual, float(max_misfit[count])):
            longest = True
            for k in range(m):
                if left[k] == 0.0:
                    slack[k] = -best_error[k]
                    longest = longest and slack[k] > 0.0
            if not longest:
                fill_vector(slack, 0.0)
            return longest
    return False


@kernel
def _fits(
    error: FloatArray, weights: FloatArray, deviation: FloatArray, max_residual: float, max_misfit: float
) -> bool:
    """Whether no error exceeds its limit, nor their weighted square sum its own, which may be infinite."""
    if _misfit(error, weights) > max_residual:
        return False
    if max_misfit == math.inf:
        return True
    total = 0.0
    for i in range(error.shape[0]):
        if weights[i] > 0.0:
            total += (error[i] / deviation[i]) ** 2
    return total <= max_misfit


@kernel
def forward_at_poses(
    geometry: FloatArray,
    frame: FloatArray,
    starts: FloatArray,
    center: FloatArray,
    home: FloatArray,
    targets: FloatArray,
    guided: bool,
    guess_positions: FloatArray,
    guess_rotations: FloatArray,
    weights: FloatArray,
    deviation: FloatArray,
    max_residual: float,
    max_misfit: FloatArray,
    max_iterations: int,
    positions: FloatArray,
    rotations: FloatArray,
    errors: FloatArray,
    jacobians: FloatArray,
    statuses: IntArray,
    converged: BoolArray,
    slacks: FloatArray,
) -> tuple[int, int]:
    """Solve n problems; `guided` tells whether from guesses (n or 1 of them) or by search.

    Returns the number of failures and the largest number of iterations; a negative number of failures if a
    length is not positive.
    """
    failures, most_iterations = 0, 0
    m = geometry.shape[0]
    Q = np.empty((3, 3))
    for n in range(targets.shape[0]):
        for i in range(m):
            if not targets[n, i] > 0.0:
                return -targets.shape[0], 0
    for n in range(targets.shape[0]):
        p = positions[n]
        if guided:
            g = n if guess_positions.shape[0] > 1 else 0
            assign_vector(p, guess_positions[g])
            assign_matrix(Q, guess_rotations[g])
            started_above = _above(geometry, frame, p, Q)
            status, count, _ = improve_pose(
                geometry,
                targets[n],
                weights,
                jacobians.shape[2],
                max_iterations,
                p,
                Q,
                errors[n],
                jacobians[n],
            )
            if status == CONVERGED and not started_above and _above(geometry, frame, p, Q):
                status = ABOVE_FRAME
        else:
            status, count, _ = _search(
                geometry,
                frame,
                starts,
                center,
                targets[n],
                weights,
                _NOISE_SHARE * max_residual,
                max_iterations,
                p,
                Q,
                errors[n],
                jacobians[n],
            )
        fill_vector(slacks[n], 0.0)
        if status == BEYOND_PULLEY:
            fill_vector(errors[n], math.nan)
            fill_matrix(jacobians[n], math.nan)
        elif not _fits(errors[n], weights, deviation, max_residual, float(max_misfit[m])):
            if status == CONVERGED:
                status = NO_POSE_FITS
            if _find_slack(
                geometry,
                targets[n],
                weights,
                deviation,
                max_residual,
                max_misfit,
                max_iterations,
                p,
                Q,
                home,
                slacks[n],
            ):
                status = SLACK_CABLE
        orthonormalise(Q, rotations[n])
        statuses[n] = status
        converged[n] = status == CONVERGED
        if status != CONVERGED:
            failures += 1
        most_iterations = max(most_iterations, count)
    return failures, most_iterations
