"""Distribution of a wrench over the cables (eq. 15; MODEL section 4)."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .arrays import FloatArray, broadcast_batch, checked
from .compiled import in_chunks, kernel_input
from .errors import InvalidInputError, SingularWrenchMatrixError
from .kernels.tension_batch import (
    analytic_center_batch,
    assess_kernel,
    bounded_batch,
    centroid_batch,
    minimum_norm_batch,
)
from .kernels.tension_kernels import EXACT, INFEASIBLE, SINGULAR, WRENCH_TOLERANCE
from .tension_result import TensionResult

Method = Literal["minimum_norm", "closest", "centroid", "analytic_center"]

METHODS: tuple[Method, ...] = get_args(Method)
_EQUAL_WEIGHTS = kernel_input(np.ones(6), 6)
_PSEUDOINVERSE_CUTOFF = 1e-10
_MOST_CABLES_WITH_CENTROID = 8


def distribute_tensions(
    wrench_matrix: ArrayLike,
    wrench: ArrayLike,
    t_min: ArrayLike,
    t_max: ArrayLike,
    method: Method = "minimum_norm",
    *,
    reference: ArrayLike = 0.0,
    weights: ArrayLike | None = None,
    threads: int = 1,
) -> TensionResult:
    """Return tensions t with A t = w, or as near to it as the method can get.

    `minimum_norm`: t = A^+ w (eq. 15), whatever sign and size it has; `feasible` tells. The other methods
    keep t inside the limits:

    - `closest`: of all feasible tensions the nearest to the reference; with the default reference of zero
      those of least norm, A^+ w itself where that is inside the limits.
    - `centroid`: the centre of area of all feasible tensions, far from the limits; for 6 to 8 cables.
    - `analytic_center`: the feasible tensions with the largest product of distances to the limits; for any
      number of cables, and smooth along a trajectory where the others have kinks.

    Where no tensions inside the limits give the wrench, these three return the ones of least weighted wrench
    error, with a direction that proves it (`TensionResult.separating_direction`). At the border of what is
    feasible the two answers meet, so that tensions are continuous along a trajectory that crosses it. Each
    takes at most 20 m + 100 steps of its solvers.

    Parameters
    ----------
    wrench_matrix : array_like, shape (..., 6, m)
        A.
    wrench : array_like, shape (..., 6)
        w, the wrench the cables shall supply.
    t_min, t_max : float or array_like, shape (..., m)
        Limits of the tensions, N.
    method : {"minimum_norm", "closest", "centroid", "analytic_center"}
    reference : float or array_like, shape (..., m), optional
        Tensions that `closest` shall come near to, N. The other bounded methods use it where the wrench is
        out of reach and the cables still leave a choice.
    weights : array_like, shape (6,), optional
        Positive weights of the squared components of the wrench error where the wrench is out of reach;
        by default newton and newton metre count alike.
    threads : int
        Number of threads among which a batch is shared.

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape, batch axes do not broadcast, a lower limit is not
        below its upper one, a weight is not positive, the method is unknown, or `centroid` is asked for more
        than 8 cables.
    SingularWrenchMatrixError
        If a wrench matrix has lost a rank and the method is not `minimum_norm`: the cables cannot hold the
        platform there, whatever their tensions.
    """
    if method not in METHODS:
        raise InvalidInputError("method", method, f"known are {', '.join(METHODS)}")
    w = checked("wrench", wrench, 6)
    A = checked("wrench_matrix", wrench_matrix)
    if A.ndim < 2 or A.shape[-2] != 6 or A.shape[-1] < 6:
        raise InvalidInputError(
            "wrench_matrix", wrench_matrix, f"shape {A.shape} where (..., 6, m) with m >= 6 is needed"
        )
    m = A.shape[-1]
    if method == "centroid" and m > _MOST_CABLES_WITH_CENTROID:
        raise InvalidInputError(
            "method", method, f"for at most {_MOST_CABLES_WITH_CENTROID} cables, not {m}; use analytic_center"
        )
    batch = broadcast_batch(wrench_matrix=A.shape[:-2], wrench=w.shape[:-1])
    shape = (*batch, m)
    low, high = checked("t_min", t_min), checked("t_max", t_max)
    if np.any(low >= high):
        raise InvalidInputError("t_min", t_min, f"must be below t_max = {high}")
    w_kernel, A_kernel = _stacked(w, batch, 6), _stacked(A, batch, 6, m)
    limits = _per_cable("t_min", low, shape), _per_cable("t_max", high, shape)
    near = _per_cable("reference", checked("reference", reference), shape)
    count = 1
    for size in batch:
        count *= size
    tensions, direction = np.empty((count, m)), np.full((count, 6), np.nan)
    status, steps = np.zeros(count, np.int64), np.zeros(count, np.int64)
    separation = np.full(count, np.nan)
    problem = A_kernel, w_kernel, *limits
    checked_weights = _checked_weights(weights)

    def work(first: int, after_last: int) -> None:
        part = first, after_last, tensions, status
        if method == "minimum_norm":
            minimum_norm_batch(A_kernel, w_kernel, *part)
            return
        bounded_batch(*problem, near, checked_weights, *part, steps, direction, separation)
        if method == "centroid":
            centroid_batch(*problem, *part, steps)
        elif method == "analytic_center":
            analytic_center_batch(*problem, *part, steps)

    in_chunks(work, count, threads)
    if SINGULAR in status:
        if method != "minimum_norm":
            _raise_singular(A_kernel, status, batch)
        _pseudoinverse(A_kernel, w_kernel, tensions, status)
    residual_wrench, residual = np.empty((count, 6)), np.empty(count)
    margin, feasible = np.empty(count), np.empty(count, np.bool_)
    active = np.empty((count, m), np.int8)
    assess_kernel(*problem, tensions, status, residual_wrench, residual, margin, active, feasible)
    return TensionResult(
        tensions.reshape(shape),
        feasible.reshape(batch),
        residual.reshape(batch),
        residual_wrench.reshape(*batch, 6),
        margin.reshape(batch),
        active.reshape(shape),
        status.reshape(batch),
        steps.reshape(batch),
        direction.reshape(*batch, 6),
        separation.reshape(batch),
    )


def _stacked(array: FloatArray, batch: tuple[int, ...], *own: int) -> FloatArray:
    """Return `array` with the batch as one axis; of size 1 if all of the batch share it."""
    if array.ndim == len(own):
        return kernel_input(array, 1, *own)
    if array.shape[: -len(own)] != batch:
        array = np.broadcast_to(array, (*batch, *own))
    return kernel_input(array, -1, *own)


def _per_cable(name: str, value: FloatArray, shape: tuple[int, ...]) -> FloatArray:
    """Return a value for each cable, as `_stacked`; it may have any shape that broadcasts to `shape`."""
    m = shape[-1]
    if value.ndim == 0:
        return kernel_input(np.full(m, value), 1, m)
    if broadcast_batch(tensions=shape, **{name: value.shape}) != shape:
        raise InvalidInputError(name, value, f"shape {value.shape} does not fit tensions {shape}")
    if value.shape == (m,):
        return kernel_input(value, 1, m)
    return kernel_input(np.broadcast_to(value, shape), -1, m)


def _checked_weights(weights: ArrayLike | None) -> FloatArray:
    if weights is None:
        return _EQUAL_WEIGHTS
    array = checked("weights", weights, 6)
    if array.ndim != 1 or array.min() <= 0.0:
        raise InvalidInputError("weights", weights, "6 positive numbers are needed")
    return kernel_input(array, 6)


def _raise_singular(A: FloatArray, status: NDArray[np.int64], batch: tuple[int, ...]) -> None:
    first = int((status == SINGULAR).argmax())
    matrix = A[first if len(A) > 1 else 0]
    raise SingularWrenchMatrixError(
        "the cables cannot hold the platform against every wrench",
        matrix,
        np.linalg.svd(matrix, compute_uv=False),
        tuple(map(int, np.unravel_index(first, batch))) if batch else (),
    )


def _pseudoinverse(A: FloatArray, w: FloatArray, tensions: FloatArray, status: NDArray[np.int64]) -> None:
    """Complete the minimum-norm solutions where a wrench matrix has lost a rank."""
    for k in np.flatnonzero(status == SINGULAR):
        matrix, goal = A[k if len(A) > 1 else 0], w[k if len(w) > 1 else 0]
        tensions[k] = np.linalg.pinv(matrix, rcond=_PSEUDOINVERSE_CUTOFF) @ goal
        error = np.linalg.norm(matrix @ tensions[k] - goal)
        reached = error <= WRENCH_TOLERANCE * max(float(np.linalg.norm(goal)), 1.0)
        status[k] = EXACT if reached else INFEASIBLE
