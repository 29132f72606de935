"""Forward kinematics from a guess or by search without one, for batches (docs/model.md, section 5)."""

from __future__ import annotations

import math

import numpy as np

from cspr_kinematics.arrays import BoolArray, FloatArray, IntArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.kinematics._iteration import (
    BEYOND_PULLEY,
    CONVERGED,
    cosine_between,
    improve_pose,
)
from cspr_kinematics.kinematics._search import (
    ABOVE_FRAME,
    AMBIGUOUS,
    SAME,
    above_frame,
    improve_from,
    search_pose,
)
from cspr_kinematics.kinematics._slack import NO_SLACK_FOUND, SLACK_FOUND, find_slack
from cspr_kinematics.motion._linear import assign_matrix, assign_vector, fill_matrix, fill_vector
from cspr_kinematics.motion._rotation import orthonormalise

# A guess vouches for poses that are turned from it by less than this: cosine of 0.8 rad. Others that fit about as well
# are turned by 1.3 rad and more, on the robots of the tests.
_VOUCHED_FOR = 0.7

# How a problem ended, in addition to the outcomes of an iteration and a search.
NO_POSE_FITS = 2
SLACK_CABLE = 3
SLACK_UNCERTAIN = 6


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
    limits: FloatArray,
    rivalry: float,
    max_iterations: int,
    positions: FloatArray,
    rotations: FloatArray,
    errors: FloatArray,
    jacobians: FloatArray,
    statuses: IntArray,
    converged: BoolArray,
    slacks: FloatArray,
    others: FloatArray,
) -> tuple[int, int]:
    """Solve n problems; `guided` tells whether to start from guesses (n or 1 of them) or to search.

    The cost of a pose is half the square sum of the length errors times `weights`; k cables fit a pose if it is at
    most `limits[k]`, of (m + 1,), and two poses fit about as well if their costs differ by less than `rivalry`. Of an
    ambiguous pose `others` (n, 12) has the other, position and rotation. Returns the number of failures and the
    largest number of iterations; the former is negative if a length is not positive.
    """
    failures, most_iterations = 0, 0
    m = geometry.shape[0]
    Q, limit = np.empty((3, 3)), float(limits[m])
    for n in range(targets.shape[0]):
        for i in range(m):
            if not targets[n, i] > 0.0:
                return -targets.shape[0], 0
    for n in range(targets.shape[0]):
        p = positions[n]
        fill_vector(others[n], math.nan)
        fill_vector(slacks[n], 0.0)
        if guided:
            g = n if guess_positions.shape[0] > 1 else 0
            guess_position, guess_rotation = guess_positions[g], guess_rotations[g]
            assign_vector(p, guess_position)
            assign_matrix(Q, guess_rotation)
            started_above = above_frame(geometry, frame, p, Q)
            status, count, cost = improve_pose(
                geometry, targets[n], weights, 6, max_iterations, p, Q, errors[n], jacobians[n]
            )
            if cost > limit and status != BEYOND_PULLEY:
                assign_vector(p, guess_position)
                assign_matrix(Q, guess_rotation)
                status, more, cost = improve_from(
                    geometry, frame, not started_above, targets[n], weights, max_iterations, p, Q, errors[n],
                    jacobians[n],
                )  # fmt: skip
                count += more
            if status == CONVERGED and not started_above and above_frame(geometry, frame, p, Q):
                status = ABOVE_FRAME
            fits = status == CONVERGED and cost <= limit
            if fits and cosine_between(Q, guess_rotation) < _VOUCHED_FOR:
                rival, rival_Q = np.empty(3), np.empty((3, 3))
                found, more, rival_cost = search_pose(
                    geometry, frame, starts, center, targets[n], weights, limit, rivalry, max_iterations,
                    rival, rival_Q, np.empty(m), np.empty((m, 6)), others[n],
                )  # fmt: skip
                count += more
                if rival_cost <= min(limit, cost + rivalry):
                    if cosine_between(Q, rival_Q) < SAME:
                        found = AMBIGUOUS
                        assign_vector(others[n, :3], rival)
                        assign_vector(others[n, 3:], rival_Q.ravel())
                    status = found
        else:
            status, count, cost = search_pose(
                geometry, frame, starts, center, targets[n], weights, limit, rivalry, max_iterations,
                p, Q, errors[n], jacobians[n], others[n],
            )  # fmt: skip
        if status == BEYOND_PULLEY:
            fill_vector(errors[n], math.nan)
            fill_matrix(jacobians[n], math.nan)
        elif cost > limit:
            if status == CONVERGED:
                status = NO_POSE_FITS
            found = find_slack(
                geometry, targets[n], weights, limits, rivalry, max_iterations, p, Q, home, slacks[n]
            )
            if found != NO_SLACK_FOUND:
                status = SLACK_CABLE if found == SLACK_FOUND else SLACK_UNCERTAIN
        orthonormalise(Q, rotations[n])
        statuses[n] = status
        converged[n] = status == CONVERGED
        if status != CONVERGED:
            failures += 1
        most_iterations = max(most_iterations, count)
    return failures, most_iterations
