"""Tension distribution for batches, and the parts of a result other than the tensions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics.arrays import BoolArray, FloatArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.tensions._bounded import (
    EXACT,
    SINGULAR,
    analytic_center_kernel,
    bounded_tensions_kernel,
    centroid_kernel,
    reached_kernel,
    residual_kernel,
)
from cspr_kinematics.tensions._null_space import null_space_kernel

# Codes of the methods, in the order of `Method`.
MINIMUM_NORM = 0
CLOSEST = 1
CENTROID = 2
ANALYTIC_CENTER = 3


@kernel
def in_order(t_min: FloatArray, t_max: FloatArray) -> bool:
    """Return whether each lower limit, (n or 1, m), is below its upper one, (n or 1, m)."""
    lows, highs = t_min.shape[0], t_max.shape[0]
    for k in range(max(lows, highs) if min(lows, highs) > 0 else 0):
        for i in range(t_min.shape[1]):
            if not t_min[k % lows, i] < t_max[k % highs, i]:
                return False
    return True


@kernel
def distribute_batch(
    method: int,
    A: FloatArray,
    w: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    first: int,
    after_last: int,
    tensions: FloatArray,
    feasible: BoolArray,
    residual: FloatArray,
    margin: FloatArray,
    status: NDArray[np.int64],
    steps: NDArray[np.int64],
) -> tuple[int, bool]:
    """Find tensions for wrenches `first` to `after_last` of a batch of n; write the fields of a `TensionResult`.

    Parameters
    ----------
    method : int
        MINIMUM_NORM, CLOSEST, CENTROID or ANALYTIC_CENTER.
    A : numpy.ndarray, shape (n or 1, 6, m)
    w : numpy.ndarray, shape (n or 1, 6)
    t_min, t_max : numpy.ndarray, shape (n or 1, m)
    tensions : numpy.ndarray, shape (n, m)
        Nothing is written for a singular wrench matrix, but its status.
    feasible : numpy.ndarray of bool, shape (n,)
    residual, margin : numpy.ndarray, shape (n,)
    status, steps : numpy.ndarray of int, shape (n,)
        A `TensionStatus`, or SINGULAR.

    Returns
    -------
    singular : int
        How many wrench matrices are singular.
    finite : bool
        Whether all wrench errors are finite; they are not if a wrench or a matrix is not.
    """
    singular, finite = 0, True
    basis = np.empty((A.shape[2], A.shape[2] - 6))
    for k in range(first, after_last):
        a = A[k if A.shape[0] > 1 else 0]
        b = w[k if w.shape[0] > 1 else 0]
        low = t_min[k if t_min.shape[0] > 1 else 0]
        high = t_max[k if t_max.shape[0] > 1 else 0]
        t = tensions[k]
        if method == MINIMUM_NORM:
            status[k] = EXACT if null_space_kernel(a, b, t, basis) else SINGULAR
            steps[k] = 0
        else:
            status[k], steps[k] = bounded_tensions_kernel(a, b, low, high, t)
            if status[k] == EXACT and method == CENTROID:
                steps[k] += centroid_kernel(a, b, low, high, t)
            elif status[k] == EXACT and method == ANALYTIC_CENTER:
                steps[k] += analytic_center_kernel(a, b, low, high, t)
        if status[k] == SINGULAR:
            singular += 1
            continue
        residual[k] = residual_kernel(a, b, t)
        margin[k] = np.inf
        for i in range(t.shape[0]):
            margin[k] = min(margin[k], t[i] - low[i], high[i] - t[i])
        feasible[k] = margin[k] >= 0.0 and status[k] == EXACT and residual[k] <= reached_kernel(b)
        finite &= np.isfinite(residual[k])
    return singular, finite
