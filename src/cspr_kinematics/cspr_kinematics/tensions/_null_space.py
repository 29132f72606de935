"""Null space of a wrench matrix, by Householder reflections of its transpose."""

from __future__ import annotations

import numpy as np

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel

# Below this ratio of the triangular factor's smallest to its largest diagonal element, A is rank-deficient.
RANK_TOLERANCE = 1e-9


@kernel
def null_space_kernel(A: FloatArray, w: FloatArray, particular: FloatArray, N: FloatArray) -> bool:
    """Write the minimum-norm solution of A t = w and an orthonormal basis of the null space of A.

    Parameters
    ----------
    A : numpy.ndarray, shape (6, m)
    w : numpy.ndarray, shape (6,)
    particular : numpy.ndarray, shape (m,)
        Receives A^+ w.
    N : numpy.ndarray, shape (m, m - 6)
        Receives the basis, in its columns.

    Returns
    -------
    bool
        Whether A has full rank; if not, nothing was written.
    """
    m = A.shape[1]
    V = np.empty((6, m))  # row k: reflector k from element k on, before it the triangular factor
    diagonal = np.empty(6)
    beta = np.empty(6)
    largest = 0.0
    smallest = np.inf
    for k in range(6):
        for i in range(m):
            V[k, i] = A[k, i]
        for j in range(k):
            projection = 0.0
            for i in range(j, m):
                projection += V[j, i] * V[k, i]
            projection *= beta[j]
            for i in range(j, m):
                # The reflector's leading element is kept; that of this row becomes the factor's R[j, k].
                V[k, i] -= projection * V[j, i]
        squared = 0.0
        for i in range(k, m):
            squared += V[k, i] * V[k, i]
        norm = np.sqrt(squared)
        largest = max(largest, norm)
        smallest = min(smallest, norm)
        if norm <= RANK_TOLERANCE * largest:
            return False
        diagonal[k] = -norm if V[k, k] >= 0.0 else norm
        lead = V[k, k] - diagonal[k]
        beta[k] = 2.0 / (squared - V[k, k] * V[k, k] + lead * lead)
        V[k, k] = lead
    if smallest <= RANK_TOLERANCE * largest:
        return False
    for k in range(6):  # R^T y = w
        value = w[k]
        for j in range(k):
            value -= V[k, j] * particular[j]
        particular[k] = value / diagonal[k]
    particular[6:] = 0.0
    for column in range(m - 6):
        for i in range(m):
            N[i, column] = 0.0
        N[6 + column, column] = 1.0
    for k in range(5, -1, -1):
        projection = 0.0
        for i in range(k, m):
            projection += V[k, i] * particular[i]
        projection *= beta[k]
        for i in range(k, m):
            particular[i] -= projection * V[k, i]
        for column in range(m - 6):
            projection = 0.0
            for i in range(k, m):
                projection += V[k, i] * N[i, column]
            projection *= beta[k]
            for i in range(k, m):
                N[i, column] -= projection * V[k, i]
    return True
