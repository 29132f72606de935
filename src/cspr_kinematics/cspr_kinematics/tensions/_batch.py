"""Tension distribution for batches, and the parts of a result other than the tensions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics.arrays import BoolArray, FloatArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.tensions._bounded import (
    EXACT,
    INFEASIBLE,
    SINGULAR,
    analytic_center_kernel,
    bounded_tensions_kernel,
    centroid_kernel,
    reached_kernel,
)
from cspr_kinematics.tensions._null_space import null_space_kernel
from cspr_kinematics.tensions._separating_direction import separating_direction_kernel

# A tension counts as at its limit within this share of the larger limit.
ACTIVE_TOLERANCE = 1e-9

# Codes of the methods, in the order of `Method`.
MINIMUM_NORM = 0
CLOSEST = 1
CENTROID = 2
ANALYTIC_CENTER = 3


@kernel
def distribute_batch(
    method: int,
    A: FloatArray,
    w: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    t_reference: FloatArray,
    weights: FloatArray,
    first: int,
    after_last: int,
    tensions: FloatArray,
    feasible: BoolArray,
    residual: FloatArray,
    margin: FloatArray,
    active: NDArray[np.int8],
    status: NDArray[np.int64],
    steps: NDArray[np.int64],
    direction: FloatArray,
    separation: FloatArray,
) -> tuple[int, bool]:
    """Find tensions for wrenches `first` to `after_last` of a batch of n; write the fields of a `TensionResult`.

    Parameters
    ----------
    method : int
        MINIMUM_NORM, CLOSEST, CENTROID or ANALYTIC_CENTER.
    A : numpy.ndarray, shape (n or 1, 6, m)
    w : numpy.ndarray, shape (n or 1, 6)
    t_min, t_max, t_reference : numpy.ndarray, shape (n or 1, m)
    weights : numpy.ndarray, shape (6,)
    tensions : numpy.ndarray, shape (n, m)
        Nothing is written for a singular wrench matrix, but its status.
    feasible : numpy.ndarray of bool, shape (n,)
    residual, margin, separation : numpy.ndarray, shape (n,)
    direction : numpy.ndarray, shape (n, 6)
    active : numpy.ndarray of int8, shape (n, m)
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
        reference = t_reference[k if t_reference.shape[0] > 1 else 0]
        t = tensions[k]
        if method == MINIMUM_NORM:
            status[k] = EXACT if null_space_kernel(a, b, t, basis) else SINGULAR
            steps[k] = 0
        else:
            status[k], steps[k] = bounded_tensions_kernel(a, b, low, high, reference, weights, t)
            if status[k] == EXACT and method == CENTROID:
                steps[k] += centroid_kernel(a, b, low, high, t)
            elif status[k] == EXACT and method == ANALYTIC_CENTER:
                steps[k] += analytic_center_kernel(a, b, low, high, t)
        if status[k] == SINGULAR:
            singular += 1
            continue
        direction[k] = np.nan
        separation[k] = np.nan
        if status[k] == INFEASIBLE:
            gap = separating_direction_kernel(a, b, low, high, t, weights, direction[k])
            separation[k] = gap if gap > 0.0 else np.nan
        residual[k], margin[k] = _assess(a, b, low, high, t, active[k])
        feasible[k] = margin[k] >= 0.0 and status[k] == EXACT and residual[k] <= reached_kernel(b)
        finite &= np.isfinite(residual[k])
    return singular, finite


@kernel
def _assess(
    A: FloatArray,
    w: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    tensions: FloatArray,
    active: NDArray[np.int8],
) -> tuple[float, float]:
    """Write the active limits (m,) of tensions; return the norm of their wrench error and their margin."""
    m = tensions.shape[0]
    squared = 0.0
    for row in range(6):
        error = -w[row]
        for i in range(m):
            error += A[row, i] * tensions[i]
        squared += error * error
    margin = np.inf
    for i in range(m):
        near = ACTIVE_TOLERANCE * max(abs(t_min[i]), abs(t_max[i]))
        below, above = tensions[i] - t_min[i], t_max[i] - tensions[i]
        margin = min(margin, below, above)
        active[i] = -1 if below <= near else (1 if above <= near else 0)
    return np.sqrt(squared), margin
