"""Forward kinematics from a guess or by search without one, for batches (docs/model.md, section 5)."""

from __future__ import annotations

import math

import numpy as np

from cspr_kinematics.arrays import BoolArray, FloatArray, IntArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.kinematics._iteration import BEYOND_PULLEY, CONVERGED, improve_pose
from cspr_kinematics.kinematics._search import ABOVE_FRAME, above_frame, search_pose
from cspr_kinematics.kinematics._slack import NO_SLACK_FOUND, SLACK_FOUND, find_slack, fits
from cspr_kinematics.motion._linear import assign_matrix, assign_vector, fill_matrix, fill_vector
from cspr_kinematics.motion._rotation import orthonormalise

# Errors of at most this share of what is accepted are taken for noise.
_NOISE_SHARE = 0.2

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
    """Solve n problems; `guided` tells whether to start from guesses (n or 1 of them) or to search.

    Returns the number of failures and the largest number of iterations; the former is negative if a length is
    not positive.
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
            started_above = above_frame(geometry, frame, p, Q)
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
            if status == CONVERGED and not started_above and above_frame(geometry, frame, p, Q):
                status = ABOVE_FRAME
        else:
            status, count, _ = search_pose(
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
        elif not fits(errors[n], weights, deviation, max_residual, float(max_misfit[m])):
            if status == CONVERGED:
                status = NO_POSE_FITS
            found = find_slack(
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
