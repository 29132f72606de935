"""Levenberg-Marquardt iteration from a guess of the pose to one that fits the lengths (docs/model.md, section 5)."""

from __future__ import annotations

import math

import numpy as np

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.motion._linear import assign_matrix, assign_vector, solve_positive
from cspr_kinematics.motion._rotation import turn
from cspr_kinematics.robot._cable_paths import ON_SWIVEL_AXIS, PATH_EXISTS, path_at

# The gradient J^T e of half the squared length errors, below which a pose is a minimum, m. For a
# well-conditioned Jacobian the pose is then within about the same distance of it.
GRADIENT_TOLERANCE = 1e-9
_INITIAL_DAMPING = 1e-6
_LEAST_DAMPING = 1e-12
_LARGEST_DAMPING = 1e12
# Lengths are rounded to this part of themselves, and costs with them: close to the minimum all steps change the cost
# by less, and whether a step led nearer is seen in the gradient alone.
_LENGTH_ROUNDING = 1e-15

# How the iteration ended.
CONVERGED = 0
ITERATION_LIMIT = 1
BEYOND_PULLEY = 5


@kernel
def length_errors(
    geometry: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    position: FloatArray,
    rotation: FloatArray,
    error: FloatArray,
    jacobian: FloatArray,
) -> float:
    """Fill in length errors and Jacobian; return half the weighted sum of squares, infinite if a cable has no path."""
    cost = 0.0
    for i in range(geometry.shape[0]):
        fault, length, _, ux, uy, uz, rx, ry, rz = path_at(geometry, i, position, rotation)
        if fault not in (PATH_EXISTS, ON_SWIVEL_AXIS):
            return math.inf
        error[i] = length - target[i]
        cost += 0.5 * weights[i] * error[i] * error[i]
        jacobian[i, 0], jacobian[i, 1], jacobian[i, 2] = -ux, -uy, -uz
        jacobian[i, 3] = rz * uy - ry * uz
        jacobian[i, 4] = rx * uz - rz * ux
        jacobian[i, 5] = ry * ux - rx * uy
    return cost


@kernel
def cosine_between(one: FloatArray, other: FloatArray) -> float:
    """Return the cosine of the angle between two rotations (3, 3)."""
    trace = 0.0
    for i in range(3):
        for j in range(3):
            trace += one[i, j] * other[i, j]
    return 0.5 * (trace - 1.0)


@kernel
def _cost_gradient(
    weights: FloatArray, error: FloatArray, jacobian: FloatArray, gradient: FloatArray
) -> float:
    """Fill in the derivatives of the cost by the first unknowns; return the largest absolute one."""
    largest = 0.0
    for j in range(gradient.size):
        value = 0.0
        for i in range(error.size):
            value += jacobian[i, j] * weights[i] * error[i]
        gradient[j] = value
        largest = max(largest, abs(value))
    return largest


@kernel
def improve_pose(
    geometry: FloatArray,
    target: FloatArray,
    weights: FloatArray,
    unknowns: int,
    max_iterations: int,
    position: FloatArray,
    rotation: FloatArray,
    error: FloatArray,
    jacobian: FloatArray,
) -> tuple[int, int, float]:
    """Improve a pose in place; with 3 unknowns the position alone. Return status, iterations and cost."""
    m = geometry.shape[0]
    trial_position, trial_rotation = np.empty(3), np.empty((3, 3))
    trial_error, trial_jacobian = np.empty(m), np.empty((m, 6))
    normal, damped = np.empty((unknowns, unknowns)), np.empty((unknowns, unknowns))
    gradient, step, trial_gradient = np.empty(unknowns), np.empty(unknowns), np.empty(unknowns)
    damping = _INITIAL_DAMPING
    cost = length_errors(geometry, target, weights, position, rotation, error, jacobian)
    if cost == math.inf:
        return BEYOND_PULLEY, 0, cost
    iterations = 0
    improved = True
    rounding = trial_largest = 0.0
    largest = _cost_gradient(weights, error, jacobian, gradient)
    while True:
        if improved:
            rounding = 0.0
            for i in range(m):
                rounding += _LENGTH_ROUNDING * target[i] * weights[i] * abs(error[i])
            for j in range(unknowns):
                for k in range(j + 1):
                    value = 0.0
                    for i in range(m):
                        value += jacobian[i, j] * weights[i] * jacobian[i, k]
                    normal[j, k] = value
            if largest <= GRADIENT_TOLERANCE:
                return CONVERGED, iterations, cost
        if iterations >= max_iterations or damping > _LARGEST_DAMPING:
            return ITERATION_LIMIT, iterations, cost
        iterations += 1
        for j in range(unknowns):
            for k in range(j + 1):
                damped[j, k] = normal[j, k]
            damped[j, j] += damping
            step[j] = -gradient[j]
        improved = False
        if solve_positive(damped, step):
            for j in range(3):
                trial_position[j] = position[j] + step[j]
            if unknowns == 6:
                turn(step[3], step[4], step[5], rotation, trial_rotation)
            else:
                assign_matrix(trial_rotation, rotation)
            trial_cost = length_errors(
                geometry, target, weights, trial_position, trial_rotation, trial_error, trial_jacobian
            )
            if trial_cost <= cost + rounding:
                trial_largest = _cost_gradient(weights, trial_error, trial_jacobian, trial_gradient)
                improved = trial_cost < cost - rounding or trial_largest < largest
        if improved:
            assign_vector(gradient, trial_gradient)
            largest = trial_largest
            assign_vector(position, trial_position)
            assign_matrix(rotation, trial_rotation)
            assign_vector(error, trial_error)
            assign_matrix(jacobian, trial_jacobian)
            cost = trial_cost
            damping = max(0.1 * damping, _LEAST_DAMPING)
        else:
            damping *= 10.0
