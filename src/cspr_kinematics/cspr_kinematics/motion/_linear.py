"""Small dense linear algebra without calls into LAPACK, whose overhead exceeds the work at these sizes."""

from __future__ import annotations

import math

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel


@kernel
def solve_positive(matrix: FloatArray, vector: FloatArray) -> bool:
    """Solve M x = b in place by Cholesky's factorisation; False, and no x, unless M is positive definite.

    Parameters
    ----------
    matrix : numpy.ndarray, shape (n, n)
        M, of which the lower triangle is read; overwritten.
    vector : numpy.ndarray, shape (n,)
        b; overwritten with x.
    """
    n = vector.shape[0]
    for j in range(n):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        if not pivot > 0.0:
            return False
        pivot = math.sqrt(pivot)
        matrix[j, j] = pivot
        for i in range(j + 1, n):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = value / pivot
        value = vector[j]
        for k in range(j):
            value -= matrix[j, k] * vector[k]
        vector[j] = value / pivot
    for j in range(n - 1, -1, -1):
        value = vector[j]
        for k in range(j + 1, n):
            value -= matrix[k, j] * vector[k]
        vector[j] = value / matrix[j, j]
    return True


@kernel
def make_orthogonal(basis: FloatArray, count: int, vector: FloatArray, projections: FloatArray) -> float:
    """Remove from a vector (n,) its components along the first rows of an orthonormal basis; return |vector|^2 then.

    Parameters
    ----------
    basis : numpy.ndarray, shape (k, n)
        Of which the first `count` rows count.
    vector : numpy.ndarray, shape (n,)
        Changed in place; may be a later row of the basis.
    projections : numpy.ndarray, shape (k,)
        Receives the components.
    """
    for j in range(count):
        projections[j] = 0.0
    for _ in range(2):  # twice is enough for orthogonality to rounding
        for j in range(count):
            projection = 0.0
            for k in range(vector.shape[0]):
                projection += basis[j, k] * vector[k]
            projections[j] += projection
            for k in range(vector.shape[0]):
                vector[k] -= projection * basis[j, k]
    squared = 0.0
    for k in range(vector.shape[0]):
        squared += vector[k] * vector[k]
    return squared


@kernel
def assign_vector(target: FloatArray, source: FloatArray) -> None:
    """Copy a vector element by element, which compiles a hundred times as fast as a slice assignment."""
    for i in range(target.shape[0]):
        target[i] = source[i]


@kernel
def assign_matrix(target: FloatArray, source: FloatArray) -> None:
    """Copy a matrix; see `assign_vector`."""
    for i in range(target.shape[0]):
        for j in range(target.shape[1]):
            target[i, j] = source[i, j]


@kernel
def fill_vector(target: FloatArray, value: float) -> None:
    """Set all elements of a vector."""
    for i in range(target.shape[0]):
        target[i] = value


@kernel
def fill_matrix(target: FloatArray, value: float) -> None:
    """Set all elements of a matrix."""
    for i in range(target.shape[0]):
        for j in range(target.shape[1]):
            target[i, j] = value
