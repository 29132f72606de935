"""Bounded tensions of least wrench error, for wrenches out of reach and singular wrench matrices.

min |A t - w|^2 + eps^2 |t|^2 inside the limits, by a primal active set (Stark and Parker, "Bounded-variable
least-squares", Computational Statistics 10, 1995). The second term is small enough to cost a relative wrench
error of about 1e-10, and makes the solution unique and continuous where the cables leave a choice.
"""

from __future__ import annotations

import numpy as np

from cspr_kinematics.arrays import BoolArray, FloatArray
from cspr_kinematics.compiled import kernel

# Least-squares problems solved, per cable, before giving up.
LEAST_SQUARES_STEPS_PER_CABLE = 10

_REGULARISATION = 1e-5  # eps, relative to the longest column of A
_GRADIENT_TOLERANCE = 1e-13  # relative to what rounding makes of it


@kernel
def bounded_least_squares_kernel(
    A: FloatArray,
    w: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    tensions: FloatArray,
) -> tuple[bool, int]:
    """Write the bounded tensions of least wrench error.

    Parameters
    ----------
    A : numpy.ndarray, shape (6, m)
    w : numpy.ndarray, shape (6,)
    t_min, t_max : numpy.ndarray, shape (m,)
    tensions : numpy.ndarray, shape (m,)
        Receives the solution.

    Returns
    -------
    converged : bool
        Whether the conditions of optimality hold; if not, the best tensions found.
    steps : int
        Least-squares problems solved, at most `LEAST_SQUARES_STEPS_PER_CABLE` m.
    """
    m = A.shape[1]
    longest, scale = 0.0, 0.0
    for k in range(6):
        scale = max(scale, abs(w[k]))
    for i in range(m):
        squared = 0.0
        for k in range(6):
            squared += A[k, i] * A[k, i]
        longest = max(longest, np.sqrt(squared))
    if longest == 0.0:
        longest = 1.0  # nothing pulls at anything: the tensions nearest to zero it will be
    for i in range(m):
        scale = max(scale, longest * abs(t_min[i]), longest * abs(t_max[i]))
    eps = _REGULARISATION * longest
    tolerance = _GRADIENT_TOLERANCE * longest * scale
    work = np.empty((m + 1, m + 6))
    trial = np.empty(m)
    free = np.ones(m, dtype=np.bool_)
    rejected = np.zeros(m, dtype=np.bool_)
    error = np.empty(6)
    cap = LEAST_SQUARES_STEPS_PER_CABLE * m
    steps = 0
    # A start: fix whatever violates a limit, until nothing does.
    fixed_one = True
    while fixed_one:
        fixed_one = False
        _free_solution(A, w, eps, tensions, free, work, trial)
        steps += 1
        for i in range(m):
            if free[i]:
                tensions[i] = min(max(trial[i], t_min[i]), t_max[i])
                if tensions[i] != trial[i]:
                    free[i] = False
                    fixed_one = True
    while steps < cap:
        # The limit whose release lessens the error fastest.
        for k in range(6):
            error[k] = -w[k]
            for i in range(m):
                error[k] += A[k, i] * tensions[i]
        entering, steepest = -1, tolerance
        for i in range(m):
            if free[i] or rejected[i]:
                continue
            gradient = eps * eps * tensions[i]
            for k in range(6):
                gradient += A[k, i] * error[k]
            descent = -gradient if tensions[i] <= t_min[i] else gradient
            if descent > steepest:
                entering, steepest = i, descent
        if entering < 0:
            return True, steps
        free[entering] = True
        at_lower = tensions[entering] <= t_min[entering]
        first = True
        while steps < cap:
            _free_solution(A, w, eps, tensions, free, work, trial)
            steps += 1
            if first and (
                trial[entering] <= t_min[entering] if at_lower else trial[entering] >= t_max[entering]
            ):
                free[entering] = False  # rounding only: its release gains nothing
                rejected[entering] = True
                break
            first = False
            share, blocking = 1.0, -1
            for i in range(m):
                if free[i]:
                    limit = t_min[i] if trial[i] < t_min[i] else t_max[i]
                    if trial[i] < t_min[i] or trial[i] > t_max[i]:
                        ratio = (limit - tensions[i]) / (trial[i] - tensions[i])
                        if ratio < share or blocking < 0:
                            share, blocking = ratio, i
            share = min(max(share, 0.0), 1.0)
            for i in range(m):
                if free[i]:
                    tensions[i] += share * (trial[i] - tensions[i])
                    tensions[i] = min(max(tensions[i], t_min[i]), t_max[i])
            if share > 0.0:
                rejected[:] = False
            if blocking < 0:
                break
            tensions[blocking] = t_min[blocking] if trial[blocking] < t_min[blocking] else t_max[blocking]
            free[blocking] = False
    return False, steps


@kernel
def _free_solution(
    A: FloatArray,
    w: FloatArray,
    eps: float,
    tensions: FloatArray,
    free: BoolArray,
    work: FloatArray,
    trial: FloatArray,
) -> None:
    """Write to `trial` the tensions of the free cables that solve the problem with the others as they are.

    By Householder reflections of the stacked matrix [A_free; eps 1]; row q of `work` is its column q.
    """
    m = A.shape[1]
    n = 0
    for i in range(m):
        if free[i]:
            n += 1
    rows = n + 6
    q = 0
    for k in range(6):
        work[n, k] = w[k]
    for i in range(m):
        if free[i]:
            for k in range(rows):
                work[q, k] = 0.0
            for k in range(6):
                work[q, k] = A[k, i]
            work[q, 6 + q] = eps
            work[n, 6 + q] = 0.0
            q += 1
        else:
            for k in range(6):
                work[n, k] -= A[k, i] * tensions[i]
    for q in range(n):
        squared = 0.0
        for k in range(q, rows):
            squared += work[q, k] * work[q, k]
        norm = np.sqrt(squared)
        diagonal = -norm if work[q, q] >= 0.0 else norm
        lead = work[q, q] - diagonal
        beta = 2.0 / (squared - work[q, q] * work[q, q] + lead * lead)
        work[q, q] = lead
        for j in range(q + 1, n + 1):
            projection = 0.0
            for k in range(q, rows):
                projection += work[q, k] * work[j, k]
            projection *= beta
            for k in range(q, rows):
                work[j, k] -= projection * work[q, k]
        work[q, q] = diagonal
    for q in range(n - 1, -1, -1):
        value = work[n, q]
        for j in range(q + 1, n):
            value -= work[j, q] * work[n, j]
        work[n, q] = value / work[q, q]
    q = 0
    for i in range(m):
        if free[i]:
            trial[i] = work[n, q]
            q += 1
