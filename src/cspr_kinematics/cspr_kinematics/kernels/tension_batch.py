"""Loops over batches of tension distributions, and what a result says besides the tensions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..arrays import BoolArray, FloatArray
from ..compiled import kernel
from .tension_kernels import (
    EXACT,
    INFEASIBLE,
    SINGULAR,
    analytic_center_kernel,
    bounded_tensions_kernel,
    centroid_kernel,
    minimum_norm_kernel,
    reached_kernel,
    separating_direction_kernel,
)

# A tension counts as at its limit within this share of the larger limit.
ACTIVE_TOLERANCE = 1e-9


@kernel
def minimum_norm_batch(
    A: FloatArray,
    w: FloatArray,
    first: int,
    after_last: int,
    tensions: FloatArray,
    status: NDArray[np.int64],
    steps: NDArray[np.int64],
    direction: FloatArray,
    separation: FloatArray,
) -> int:
    """Write the minimum-norm tensions (n, m) of wrenches `first` to `after_last`; the rest is as below."""
    singular = 0
    for k in range(first, after_last):
        direction[k] = np.nan
        separation[k] = np.nan
        status[k], _, steps[k] = minimum_norm_kernel(
            A[k if A.shape[0] > 1 else 0], w[k if w.shape[0] > 1 else 0], tensions[k]
        )
        singular += status[k] == SINGULAR
    return singular


@kernel
def bounded_batch(
    A: FloatArray,
    w: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    t_reference: FloatArray,
    weights: FloatArray,
    first: int,
    after_last: int,
    tensions: FloatArray,
    status: NDArray[np.int64],
    steps: NDArray[np.int64],
    direction: FloatArray,
    separation: FloatArray,
) -> int:
    """Find bounded tensions for wrenches `first` to `after_last` of a batch of n.

    Parameters
    ----------
    A : numpy.ndarray, shape (n or 1, 6, m)
    w : numpy.ndarray, shape (n or 1, 6)
    t_min, t_max, t_reference : numpy.ndarray, shape (n or 1, m)
    weights : numpy.ndarray, shape (6,)
    tensions : numpy.ndarray, shape (n, m)
        Receives the tensions.
    status, steps : numpy.ndarray of int, shape (n,)
        Receive a `TensionStatus` and the steps of the solvers.
    direction : numpy.ndarray, shape (n, 6)
        Receives the separating direction of each wrench out of reach; NaN for the others.
    separation : numpy.ndarray, shape (n,)
        Receives the distance that each of them proves; NaN for the others.

    Returns
    -------
    int
        How many wrench matrices are singular.
    """
    singular = 0
    for k in range(first, after_last):
        a = A[k if A.shape[0] > 1 else 0]
        b = w[k if w.shape[0] > 1 else 0]
        low = t_min[k if t_min.shape[0] > 1 else 0]
        high = t_max[k if t_max.shape[0] > 1 else 0]
        reference = t_reference[k if t_reference.shape[0] > 1 else 0]
        t = tensions[k]
        status[k], _, steps[k] = bounded_tensions_kernel(a, b, low, high, reference, weights, t)
        singular += status[k] == SINGULAR
        direction[k] = np.nan
        separation[k] = np.nan
        if status[k] == INFEASIBLE:
            gap = separating_direction_kernel(a, b, low, high, t, weights, direction[k])
            separation[k] = gap if gap > 0.0 else np.nan
    return singular


@kernel
def centroid_batch(
    A: FloatArray,
    w: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    first: int,
    after_last: int,
    tensions: FloatArray,
    status: NDArray[np.int64],
    steps: NDArray[np.int64],
) -> None:
    """Move the feasible ones of the tensions to the centroid; arguments as above."""
    for k in range(first, after_last):
        if status[k] == EXACT:
            steps[k] += centroid_kernel(
                A[k if A.shape[0] > 1 else 0],
                w[k if w.shape[0] > 1 else 0],
                t_min[k if t_min.shape[0] > 1 else 0],
                t_max[k if t_max.shape[0] > 1 else 0],
                tensions[k],
            )


@kernel
def analytic_center_batch(
    A: FloatArray,
    w: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    first: int,
    after_last: int,
    tensions: FloatArray,
    status: NDArray[np.int64],
    steps: NDArray[np.int64],
) -> None:
    """Move the feasible ones of the tensions to the analytic centre; arguments as above."""
    for k in range(first, after_last):
        if status[k] == EXACT:
            steps[k] += analytic_center_kernel(
                A[k if A.shape[0] > 1 else 0],
                w[k if w.shape[0] > 1 else 0],
                t_min[k if t_min.shape[0] > 1 else 0],
                t_max[k if t_max.shape[0] > 1 else 0],
                tensions[k],
            )


@kernel
def assess_kernel(
    A: FloatArray,
    w: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    tensions: FloatArray,
    status: NDArray[np.int64],
    residual_wrench: FloatArray,
    residual: FloatArray,
    margin: FloatArray,
    active: NDArray[np.int8],
    feasible: BoolArray,
) -> bool:
    """Write wrench error, margin to the limits, active limits and feasibility of a batch of tensions.

    Returns whether all errors are finite, which they are not for any wrench or matrix that is not.

    The inputs are those of `bounded_batch`; residual_wrench (n, 6), residual, margin and feasible (n,),
    active (n, m).
    """
    m = tensions.shape[1]
    finite = True
    for k in range(tensions.shape[0]):
        a = A[k if A.shape[0] > 1 else 0]
        b = w[k if w.shape[0] > 1 else 0]
        low = t_min[k if t_min.shape[0] > 1 else 0]
        high = t_max[k if t_max.shape[0] > 1 else 0]
        squared = 0.0
        for row in range(6):
            error = -b[row]
            for i in range(m):
                error += a[row, i] * tensions[k, i]
            residual_wrench[k, row] = error
            squared += error * error
        residual[k] = np.sqrt(squared)
        finite &= np.isfinite(squared)
        margin[k] = np.inf
        for i in range(m):
            near = ACTIVE_TOLERANCE * max(abs(low[i]), abs(high[i]))
            below, above = tensions[k, i] - low[i], high[i] - tensions[k, i]
            margin[k] = min(margin[k], below, above)
            active[k, i] = -1 if below <= near else (1 if above <= near else 0)
        feasible[k] = margin[k] >= 0.0 and status[k] == EXACT and residual[k] <= reached_kernel(b)
    return finite
