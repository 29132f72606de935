"""Pose and pull of the cables at one cycle, from the pose at the cycle before."""

from __future__ import annotations

import math

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.dynamics._rope_weight import rope_wrenches
from cspr_kinematics.kinematics._iteration import CONVERGED, improve_pose
from cspr_kinematics.motion._linear import assign_matrix
from cspr_kinematics.motion._rotation import orthonormalise
from cspr_kinematics.robot._cable_paths import PATH_EXISTS, path_at


@kernel
def elastic_tensions(
    step: float, damping_times: FloatArray, tensions: FloatArray, before: FloatArray, elastic: FloatArray
) -> None:
    """Bring up to date which tensions the stretch of damped cables stands for: e + T de/dt = t.

    Exact for a tension that changes evenly from one cycle to the next.

    Parameters
    ----------
    step
        Time since the cycle before, s; infinite where nothing is known of it.
    damping_times
        T (m,), s.
    tensions
        t (m,) at the frame, N; below zero they count as zero.
    before, elastic
        (m,): t and e of the cycle before, which become those of this one.
    """
    for i in range(len(tensions)):
        tension = max(tensions[i], 0.0)
        if step < math.inf and damping_times[i] > 0.0:
            share = step / damping_times[i]
            left = math.exp(-share)
            mean = (1.0 - left) / share
            elastic[i] = left * elastic[i] + (mean - left) * before[i] + (1.0 - mean) * tension
        else:
            elastic[i] = tension
        before[i] = tension


@kernel
def follow_cables(
    step: float,
    free_lengths: FloatArray,
    tensions: FloatArray,
    geometry: FloatArray,
    stiffness: FloatArray,
    dead_lengths: FloatArray,
    damping_times: FloatArray,
    half_weights: FloatArray,
    weights: FloatArray,
    before: FloatArray,
    elastic: FloatArray,
    max_iterations: int,
    lengths: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    scratch: FloatArray,
    error: FloatArray,
    jacobian: FloatArray,
    halves: FloatArray,
    directions: FloatArray,
    arms: FloatArray,
    rope: FloatArray,
    wrench: FloatArray,
) -> tuple[float, float]:
    """Improve a pose in place; return misfit and cost, both infinite if no pose is found from there.

    The misfit is the largest of the length errors, m; the cost, m^2, that of `improve_pose`.

    Parameters
    ----------
    step, damping_times, tensions, before, elastic
        As for `elastic_tensions`.
    geometry, weights, max_iterations
        As for `improve_pose`.
    free_lengths, stiffness, dead_lengths
        (m,), of the cables without tension: m, N, m.
    half_weights
        (m,): half the weight of a metre of each rope, N/m.
    lengths, position, rotation, error, jacobian
        Lengths (m,), stretch included; pose (3,), (3, 3), length errors (m,) and Jacobian (m, 6).
    scratch, halves, directions, arms, rope
        For use inside: (3, 3), (1, m), (1, m, 3), (1, m, 3) and (1, 6).
    wrench
        What the cables pull on the platform (6,), the weight of the ropes taken off.
    """
    m = geometry.shape[0]
    elastic_tensions(step, damping_times, tensions, before, elastic)
    for i in range(m):
        stretched = 1.0 + elastic[i] / stiffness[i]
        lengths[i] = (free_lengths[i] + dead_lengths[i]) * stretched - dead_lengths[i]
    status, _, cost = improve_pose(
        geometry, lengths, weights, 6, max_iterations, position, rotation, error, jacobian
    )
    if status != CONVERGED:
        return math.inf, math.inf
    assign_matrix(scratch, rotation)
    orthonormalise(scratch, rotation)
    misfit = 0.0
    for i in range(m):
        misfit = max(misfit, abs(error[i]))
        fault, _, free, ux, uy, uz, rx, ry, rz = path_at(geometry, i, position, rotation)
        if fault != PATH_EXISTS:
            return math.inf, math.inf
        halves[0, i] = half_weights[i] * free
        directions[0, i, 0], directions[0, i, 1], directions[0, i, 2] = ux, uy, uz
        arms[0, i, 0], arms[0, i, 1], arms[0, i, 2] = rx, ry, rz
    rope_wrenches(halves, directions, arms, rope)
    for k in range(6):
        pull = 0.0
        for i in range(m):
            pull -= jacobian[i, k] * tensions[i]
        wrench[k] = pull - rope[0, k]
    return misfit, cost
