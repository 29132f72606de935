"""The proof that a wrench is out of reach of bounded tensions: a direction that separates it from all within reach."""

from __future__ import annotations

import numpy as np

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.motion._linear import make_orthogonal


@kernel
def separating_direction_kernel(
    A: FloatArray,
    w: FloatArray,
    t_min: FloatArray,
    t_max: FloatArray,
    tensions: FloatArray,
    weights: FloatArray,
    direction: FloatArray,
) -> float:
    """Write a direction in which w lies beyond every wrench of feasible tensions, and return by how much.

    Parameters
    ----------
    A, w, t_min, t_max, weights
        As in `bounded_tensions_kernel`.
    tensions : numpy.ndarray, shape (m,)
        Its solution, of least weighted wrench error.
    direction : numpy.ndarray, shape (6,)
        Receives the unit vector d, NaN if there is none.

    Returns
    -------
    float
        d . w less the largest d . (A t) for any t within the limits: positive, a proof that w is out of
        reach. Not positive: no proof was found.
    """
    m = A.shape[1]
    basis = np.empty((6, 6))
    error = np.empty(6)
    column, projections = np.empty(6), np.empty(6)
    count = 0
    for k in range(6):
        value = w[k]
        for i in range(m):
            value -= A[k, i] * tensions[i]
        error[k] = np.sqrt(weights[k]) * value
    # The exact error is orthogonal to the columns of the free cables.
    for i in range(m):
        if count < 6 and t_min[i] < tensions[i] < t_max[i]:
            length = 0.0
            for k in range(6):
                column[k] = np.sqrt(weights[k]) * A[k, i]
                length += column[k] * column[k]
            squared = make_orthogonal(basis, count, column, projections)
            if squared > 1e-18 * length:
                for k in range(6):
                    basis[count, k] = column[k] / np.sqrt(squared)
                count += 1
    make_orthogonal(basis, count, error, projections)
    squared = 0.0
    for k in range(6):
        error[k] *= np.sqrt(weights[k])
        squared += error[k] * error[k]
    gap = 0.0
    for k in range(6):
        direction[k] = error[k] / np.sqrt(squared)
        gap += direction[k] * w[k]
    for i in range(m):
        slope = 0.0
        for k in range(6):
            slope += direction[k] * A[k, i]
        gap -= max(slope * t_min[i], slope * t_max[i])
    if not gap > 0.0:
        direction[:] = np.nan
    return gap
