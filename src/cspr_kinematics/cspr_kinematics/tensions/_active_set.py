"""Nearest feasible tensions for any redundancy: a dual active-set solver in the null space.

Goldfarb and Idnani, "A numerically stable dual method for solving strictly convex quadratic programs",
Mathematical Programming 27 (1983), for the unit Hessian: the point starts at the reference, outside the
limits, and the limits it violates are made active one after the other. The objective grows with each of them,
so that no active set comes twice.
"""

from __future__ import annotations

import numpy as np

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.motion._linear import make_orthogonal

# Steps that make a limit active or inactive, per cable.
DUAL_STEPS_PER_CABLE = 10
FOUND = 0
EMPTY = 1  # the limits exclude each other
CAPPED = 2  # the cap was reached first

_ON_LIMIT = 1e-13  # relative to the largest tension
_DEPENDENT = 1e-14  # squared sine of the angle below which a limit depends on the active ones
_NO_INFLUENCE = 1e-20  # squared norm of a row of the null space that does not move its cable


@kernel
def nearest_feasible_kernel(
    particular: FloatArray, N: FloatArray, t_min: FloatArray, t_max: FloatArray, x: FloatArray
) -> tuple[int, int]:
    """Move x to the nearest point at which t_min <= p + N x <= t_max.

    Parameters
    ----------
    particular : numpy.ndarray, shape (m,)
        Tensions p at the origin of the null space.
    N : numpy.ndarray, shape (m, r)
        Orthonormal basis of the null space, r >= 1.
    t_min, t_max : numpy.ndarray, shape (m,)
    x : numpy.ndarray, shape (r,)
        The reference; receives the solution.

    Returns
    -------
    outcome, steps : int
        FOUND, EMPTY or CAPPED, and how many steps it took, at most `DUAL_STEPS_PER_CABLE` m.
    """
    m, r = N.shape
    scale = 0.0
    for i in range(m):
        scale = max(scale, abs(t_min[i]), abs(t_max[i]), abs(particular[i]))
    tolerance = _ON_LIMIT * scale
    Q = np.empty((r, r))  # rows: orthonormal basis of the active limits' normals
    R = np.empty((r, r))  # normal k = sum of R[j, k] Q[j]
    active = np.empty(r, dtype=np.int64)  # cable of each active limit
    sign = np.empty(r)  # 1 lower, -1 upper
    multiplier = np.empty(r)
    step = np.empty(r)
    change = np.empty(r)
    count = 0
    steps = 0
    while True:
        entering, side, violation = -1, 0.0, tolerance
        for i in range(m):
            tension = particular[i]
            for k in range(r):
                tension += N[i, k] * x[k]
            if t_min[i] - tension > violation:
                entering, side, violation = i, 1.0, t_min[i] - tension
            if tension - t_max[i] > violation:
                entering, side, violation = i, -1.0, tension - t_max[i]
        if entering < 0:
            return FOUND, steps
        entering_multiplier = 0.0
        while True:
            if steps >= DUAL_STEPS_PER_CABLE * m:
                return CAPPED, steps
            steps += 1
            # step: the part of the entering normal that is orthogonal to the active ones.
            squared_normal = 0.0
            for k in range(r):
                step[k] = side * N[entering, k]
                squared_normal += step[k] * step[k]
            squared_step = make_orthogonal(Q, count, step, change)
            independent = count < r and squared_step > max(_DEPENDENT * squared_normal, _NO_INFLUENCE)
            added_norm = np.sqrt(squared_step)
            if independent:
                for j in range(count):
                    R[j, count] = change[j]
            for j in range(count - 1, -1, -1):
                for k in range(j + 1, count):
                    change[j] -= R[j, k] * change[k]
                change[j] /= R[j, j]
            leaving, ratio = -1, np.inf
            for j in range(count):
                if change[j] > 1e-14 and multiplier[j] < ratio * change[j]:
                    leaving, ratio = j, multiplier[j] / change[j]
            full = violation / squared_step if independent else np.inf
            if leaving < 0 and not independent:
                return EMPTY, steps
            length = min(ratio, full)
            for j in range(count):
                multiplier[j] = max(multiplier[j] - length * change[j], 0.0)
            entering_multiplier += length
            if independent:
                for k in range(r):
                    x[k] += length * step[k]
                violation -= length * squared_step
            if full <= ratio:
                for k in range(r):
                    Q[count, k] = step[k] / added_norm
                R[count, count] = added_norm
                active[count] = entering
                sign[count] = side
                multiplier[count] = entering_multiplier
                count += 1
                break
            count -= 1
            for j in range(leaving, count):
                active[j] = active[j + 1]
                sign[j] = sign[j + 1]
                multiplier[j] = multiplier[j + 1]
            for j in range(leaving, count):  # the basis of those that follow anew
                for k in range(r):
                    Q[j, k] = sign[j] * N[active[j], k]
                R[j, j] = np.sqrt(make_orthogonal(Q, j, Q[j], change))
                for i in range(j):
                    R[i, j] = change[i]
                for k in range(r):
                    Q[j, k] /= R[j, j]
