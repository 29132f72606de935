"""The mathematics of one control cycle in one kernel: cables, required wrench, bounded tensions."""

from __future__ import annotations

import math

import numpy as np

from cspr_kinematics.arrays import BoolArray, FloatArray, IntArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.dynamics._dynamics import required_wrench_at
from cspr_kinematics.robot._cable_paths import PATH_EXISTS, cables_at_pose
from cspr_kinematics.tensions._bounded import EXACT, SINGULAR, bounded_tensions_kernel

# Besides the faults of a cable's path.
SINGULAR_MATRIX = -1
BEYOND_RANGE = -2  # of floating-point numbers


@kernel
def feedforward_at_poses(
    geometry: FloatArray,
    parameters: FloatArray,
    positions: FloatArray,
    rotations: FloatArray,
    velocities: FloatArray,
    angular_velocities: FloatArray,
    accelerations: FloatArray,
    angular_accelerations: FloatArray,
    external_wrenches: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    reference: FloatArray,
    weights: FloatArray,
    lengths: FloatArray,
    length_rates: FloatArray,
    wrench_matrices: FloatArray,
    wrenches: FloatArray,
    tensions: FloatArray,
    feasible: BoolArray,
    residuals: FloatArray,
    statuses: IntArray,
) -> tuple[int, int, int]:
    """Fill in the feed-forward at n states; return the first fault, the index of its cable and of its pose.

    One external wrench, (1, 6), serves all states. The tensions are those of `bounded_tensions_kernel`.
    """
    m = geometry.shape[0]
    free_lengths, directions, arms = np.empty(m), np.empty((m, 3)), np.empty((m, 3))
    J = np.empty((m, 6))
    one = external_wrenches.shape[0] == 1
    for n in range(positions.shape[0]):
        A, w = wrench_matrices[n], wrenches[n]
        fault, cable = cables_at_pose(
            geometry, positions[n], rotations[n], lengths[n], free_lengths, directions, arms, A, J
        )
        if fault != PATH_EXISTS:
            return fault, cable, n
        for i in range(m):
            rate = 0.0
            for j in range(3):
                rate += J[i, j] * velocities[n, j] + J[i, 3 + j] * angular_velocities[n, j]
            length_rates[n, i] = rate
        required_wrench_at(
            parameters, rotations[n], angular_velocities[n], accelerations[n], angular_accelerations[n], w
        )
        external = external_wrenches[0] if one else external_wrenches[n]
        for j in range(6):
            w[j] -= external[j]
        status, residuals[n], _ = bounded_tensions_kernel(A, w, t_min, t_max, reference, weights, tensions[n])
        if status == SINGULAR:
            return SINGULAR_MATRIX, 0, n
        if not residuals[n] < math.inf:
            return BEYOND_RANGE, 0, n
        feasible[n], statuses[n] = status == EXACT, status
    return PATH_EXISTS, 0, 0
