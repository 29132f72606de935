"""Tensions for one pose: of least norm, or in the middle; steps are bounded.

The kernels that look for a middle start from the tensions of `bounded_tensions_kernel`, and keep them where
there is none. They do not call it, because whatever a kernel calls is compiled again with it.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.motion._linear import solve_positive
from cspr_kinematics.tensions._active_set import FOUND, nearest_feasible_kernel
from cspr_kinematics.tensions._least_squares import bounded_least_squares_kernel
from cspr_kinematics.tensions._null_space import null_space_kernel
from cspr_kinematics.tensions._polygon import (
    feasible_polygon_kernel,
    nearest_in_polygon_kernel,
    polygon_centroid_kernel,
)


class TensionStatus(IntEnum):
    """How a tension distribution ended.

    - EXACT: the tensions give the wrench; those of a bounded method lie within the limits.
    - INFEASIBLE: no tensions within the limits give the wrench; these are the ones of least error.
    - ITERATION_LIMIT: the cap on steps was reached; the tensions lie within the limits, but nothing else is known.
    """

    EXACT = 0
    INFEASIBLE = 1
    ITERATION_LIMIT = 2


EXACT = int(TensionStatus.EXACT)
INFEASIBLE = int(TensionStatus.INFEASIBLE)
ITERATION_LIMIT = int(TensionStatus.ITERATION_LIMIT)
SINGULAR = 3  # the wrench matrix is rank-deficient, which callers turn into an error

# A wrench counts as reached when its error is below this share of it (of one newton for smaller ones).
WRENCH_TOLERANCE = 1e-6
# Newton steps towards the analytic centre.
CENTER_STEPS = 100

_SNAP = 1e-13  # a tension this near to a limit, relative to the larger one, is on it
# Error of the wrench at which the centre is found, relative to the weight of the limits, but well below what counts as
# reached: for a light platform between wide limits that is less.
_CENTERED = 1e-10
_SHARE_OF_REACHED = 0.1


@kernel
def bounded_tensions_kernel(
    A: FloatArray,
    w: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    tensions: FloatArray,
) -> tuple[int, int]:
    """Write the feasible tensions of least norm; without any, those of least wrench error.

    Parameters
    ----------
    A : numpy.ndarray, shape (6, m)
        Wrench matrix.
    w : numpy.ndarray, shape (6,)
        Wrench, N and N m.
    t_min, t_max : numpy.ndarray, shape (m,)
        N.
    tensions : numpy.ndarray, shape (m,)
        Receives the solution.

    Returns
    -------
    status : int
        A `TensionStatus` or SINGULAR.
    steps : int
        Steps of the solvers; at most 20 m in all.
    """
    m = A.shape[1]
    r = m - 6
    steps = 0
    particular = np.empty(m)
    N = np.empty((m, r))
    if not null_space_kernel(A, w, particular, N):
        return SINGULAR, steps
    found = True
    x = np.zeros(r)
    if not _tensions_at(particular, N, x, t_min, t_max, tensions):
        if r == 0:
            found = False
        elif r == 2:
            vertices = np.empty((2 * m + 4, 2))
            count = feasible_polygon_kernel(particular, N, t_min, t_max, vertices)
            steps = 1
            found = count > 0
            if found:
                nearest_in_polygon_kernel(vertices, count, x)
        else:
            outcome, steps = nearest_feasible_kernel(particular, N, t_min, t_max, x)
            found = outcome == FOUND
        if found:
            _tensions_at(particular, N, x, t_min, t_max, tensions)
    if found and residual_kernel(A, w, tensions) <= reached_kernel(w):
        return EXACT, steps
    converged, more = bounded_least_squares_kernel(A, w, t_min, t_max, tensions)
    steps += more
    if residual_kernel(A, w, tensions) <= reached_kernel(w):
        return EXACT, steps
    return (INFEASIBLE if converged else ITERATION_LIMIT), steps


@kernel
def centroid_kernel(
    A: FloatArray, w: FloatArray, t_min: FloatArray, t_max: FloatArray, tensions: FloatArray
) -> int:
    """Move feasible tensions (m,) of at most 8 cables to the centroid of all such; return 1 if it did."""
    m = A.shape[1]
    r = m - 6
    particular = np.empty(m)
    N = np.empty((m, r))
    if r < 1 or r > 2 or not null_space_kernel(A, w, particular, N):
        return 0
    x = np.zeros(r)
    if r == 1:
        low, high = -np.inf, np.inf
        for i in range(m):
            if abs(N[i, 0]) > 1e-12:
                a = (t_min[i] - particular[i]) / N[i, 0]
                b = (t_max[i] - particular[i]) / N[i, 0]
                low, high = max(low, min(a, b)), min(high, max(a, b))
        x[0] = 0.5 * (low + high)
    else:
        vertices = np.empty((2 * m + 4, 2))
        count = feasible_polygon_kernel(particular, N, t_min, t_max, vertices)
        if count == 0:
            return 0
        polygon_centroid_kernel(vertices, count, x)
    center = np.empty(m)
    _tensions_at(particular, N, x, t_min, t_max, center)
    if residual_kernel(A, w, center) > reached_kernel(w):
        return 0
    tensions[:] = center
    return 1


@kernel
def analytic_center_kernel(
    A: FloatArray, w: FloatArray, t_min: FloatArray, t_max: FloatArray, tensions: FloatArray
) -> int:
    """Move feasible tensions (m,) to those that maximise the product of all distances to the limits.

    By damped Newton steps on the dual, sum_i psi_i(a_i . y) - w . y over y (6,), whose tensions lie strictly
    within the limits at every y. It is self-concordant: each step gains a fixed amount until convergence is
    quadratic. Where there is next to no room, so that `CENTER_STEPS` do not suffice, the tensions stay.
    Returns the steps taken.
    """
    m = A.shape[1]
    y = np.zeros(6)
    hessian = np.empty((6, 6))
    error = np.empty(6)
    step = np.empty(6)
    center = np.empty(m)
    stiffness = np.empty(m)
    scale = 0.0
    for k in range(6):
        row = abs(w[k])
        for i in range(m):
            row += abs(A[k, i]) * max(abs(t_min[i]), abs(t_max[i]))
        scale = max(scale, row)
    close = min(_CENTERED * scale, _SHARE_OF_REACHED * reached_kernel(w))
    for steps in range(1, CENTER_STEPS + 1):
        for k in range(6):
            error[k] = w[k]
        for i in range(m):
            slope = 0.0
            for k in range(6):
                slope += A[k, i] * y[k]
            half = 0.5 * (t_max[i] - t_min[i])
            root = np.sqrt(1.0 + (slope * half) ** 2)
            offset = slope * half * half / (1.0 + root)
            stiffness[i] = (half * half - offset * offset) / (2.0 * root)
            center[i] = 0.5 * (t_min[i] + t_max[i]) + offset
            for k in range(6):
                error[k] -= A[k, i] * center[i]
        norm = 0.0
        for k in range(6):
            norm = max(norm, abs(error[k]))
        if norm <= close:
            for i in range(m):
                tensions[i] = min(max(center[i], t_min[i]), t_max[i])
            return steps
        # The step that makes the error vanish to first order.
        for k in range(6):
            step[k] = error[k]
            for j in range(k + 1):
                value = 0.0
                for i in range(m):
                    value += A[k, i] * stiffness[i] * A[j, i]
                hessian[k, j] = value
        if not solve_positive(hessian, step):
            return steps
        decrement = 0.0
        for k in range(6):
            decrement += error[k] * step[k]
        decrement = np.sqrt(max(decrement, 0.0))
        damping = 1.0 if decrement < 0.25 else 1.0 / (1.0 + decrement)
        for k in range(6):
            y[k] += damping * step[k]
    return CENTER_STEPS


@kernel
def residual_kernel(A: FloatArray, w: FloatArray, tensions: FloatArray) -> float:
    """Return |A t - w|."""
    total = 0.0
    for k in range(6):
        value = -w[k]
        for i in range(A.shape[1]):
            value += A[k, i] * tensions[i]
        total += value * value
    return float(np.sqrt(total))


@kernel
def reached_kernel(w: FloatArray) -> float:
    """Return the wrench error below which w counts as reached."""
    total = 0.0
    for k in range(6):
        total += w[k] * w[k]
    return WRENCH_TOLERANCE * max(float(np.sqrt(total)), 1.0)


@kernel
def _tensions_at(
    particular: FloatArray,
    N: FloatArray,
    x: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    tensions: FloatArray,
) -> bool:
    """Write p + N x, brought within the limits; return whether it was there already, to within rounding."""
    inside = True
    for i in range(particular.shape[0]):
        value = particular[i]
        for k in range(N.shape[1]):
            value += N[i, k] * x[k]
        near = _SNAP * max(abs(t_min[i]), abs(t_max[i]))
        if value <= t_min[i] + near:
            inside &= value >= t_min[i] - near
            value = t_min[i]
        elif value >= t_max[i] - near:
            inside &= value <= t_max[i] + near
            value = t_max[i]
        tensions[i] = value
    return inside
