"""Distribution of a wrench over the cables (eq. 15; docs/model.md, section 6)."""

from __future__ import annotations

import functools
import math
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_kinematics.arrays import FloatArray, as_floats, broadcast_batch, checked, positive_integer
from cspr_kinematics.compiled import in_batch, kernel_input
from cspr_kinematics.errors import InvalidInputError, SingularWrenchMatrixError
from cspr_kinematics.tensions._batch import distribute_batch, in_order
from cspr_kinematics.tensions._bounded import SINGULAR
from cspr_kinematics.tensions.result import TensionResult

Method = Literal["minimum_norm", "closest", "centroid", "analytic_center"]

METHODS: tuple[Method, ...] = get_args(Method)
_MOST_CABLES_WITH_CENTROID = 8
# Below this many problems a thread costs more than it saves.
_LEAST_PER_THREAD = 500


def bounded_methods(number_of_cables: int) -> tuple[Method, ...]:
    """Return the methods that keep tensions within the limits, for a robot with that many cables."""
    known = [method for method in METHODS if method != "minimum_norm"]
    return tuple(m for m in known if m != "centroid" or number_of_cables <= _MOST_CABLES_WITH_CENTROID)


def distribute_tensions(
    wrench_matrix: ArrayLike,
    wrench: ArrayLike,
    t_min: ArrayLike,
    t_max: ArrayLike,
    method: Method = "minimum_norm",
    *,
    threads: int = 1,
) -> TensionResult:
    """Return tensions t with A t = w, or as close to it as the method gets.

    `minimum_norm`: t = A^+ w (eq. 15), whatever its sign and size; `feasible` tells whether the limits hold.
    The other methods keep t within the limits:

    - `closest`: of all feasible tensions those of least norm, which is A^+ w itself where that is within the limits.
    - `centroid`: the centre of area of all feasible tensions, far from the limits; for 6 to 8 cables.
    - `analytic_center`: the feasible tensions with the largest product of distances to the limits; for any
      number of cables; smooth along a trajectory, where the others have kinks.

    Where no tensions within the limits give the wrench, these three return the ones of least wrench error, N and N m
    counting alike. The two solutions agree at the border of what is feasible, so tensions are continuous along a
    trajectory that crosses it. Each method takes at most 20 m + 100 steps of its solvers.

    Parameters
    ----------
    wrench_matrix : array_like, shape (..., 6, m)
        A.
    wrench : array_like, shape (..., 6)
        w, the wrench that the cables are to supply.
    t_min, t_max : float or array_like, shape (..., m)
        Limits of the tensions, N.
    method : {"minimum_norm", "closest", "centroid", "analytic_center"}
    threads : int
        Number of threads among which a batch is divided.

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape, batch axes do not broadcast, a lower limit is not
        below its upper one, the method is unknown, or `centroid` is requested for more than 8 cables.
    SingularWrenchMatrixError
        If a wrench matrix is rank-deficient: there are wrenches that no tensions at all can balance.
    """
    if method not in METHODS:
        raise InvalidInputError("method", method, f"known are {', '.join(METHODS)}")
    w, A = as_floats("wrench", wrench, 6), as_floats("wrench_matrix", wrench_matrix)
    if A.ndim < 2 or A.shape[-2] != 6 or A.shape[-1] < 6:
        raise InvalidInputError(
            "wrench_matrix", wrench_matrix, f"shape {A.shape} where (..., 6, m) with m >= 6 is needed"
        )
    m, code = A.shape[-1], METHODS.index(method)
    if method == "centroid" and m > _MOST_CABLES_WITH_CENTROID:
        raise InvalidInputError(
            "method", method, f"for at most {_MOST_CABLES_WITH_CENTROID} cables, not {m}; use analytic_center"
        )
    batch = A.shape[:-2]
    if w.shape[:-1] != batch:
        batch = broadcast_batch(wrench_matrix=batch, wrench=w.shape[:-1])
    shape, n = (*batch, m), math.prod(batch)
    problem = _stacked(A, batch, 6, m), _stacked(w, batch, 6), *_limits(t_min, t_max, shape)
    answer: list[Any] = [np.empty((n, m)), np.empty(n, np.bool_), np.empty(n), np.empty(n)]
    answer += [status := np.empty(n, np.int64), np.empty(n, np.int64)]

    def work(first: int, after_last: int) -> tuple[int, bool]:
        return distribute_batch(code, *problem, first, after_last, *answer)

    chunks = min(positive_integer("threads", threads), n // _LEAST_PER_THREAD)
    if chunks <= 1:
        outcomes = [work(0, n)]
    else:
        # plain threads, because those of OpenMP do not survive a fork and numba's own must not be entered twice
        bounds = np.linspace(0, n, chunks + 1).astype(int).tolist()
        with ThreadPoolExecutor(chunks) as pool:
            outcomes = list(pool.map(work, bounds[:-1], bounds[1:]))
    for singular, finite in outcomes:
        if singular or not finite:
            checked("wrench", w)
            checked("wrench_matrix", A)
        if singular:
            raise _singular(problem[0], status, batch)
        if not finite:
            raise InvalidInputError("wrench", w, "with these limits the tensions overflow")
    return TensionResult(*[in_batch(array, batch) for array in answer])


def _stacked(array: FloatArray, batch: tuple[int, ...], *own: int) -> FloatArray:
    """Return `array` with the batch as one axis, of size 1 if the whole batch shares it."""
    if array.ndim == len(own):
        return kernel_input(array, 1, *own)
    if array.shape[: -len(own)] != batch:
        array = np.broadcast_to(array, (*batch, *own))
    return kernel_input(array, -1, *own)


def _limits(t_min: Any, t_max: Any, shape: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the limits of each cable, in the form of `_per_cable`."""
    low, high = _per_cable("t_min", t_min, shape), _per_cable("t_max", t_max, shape)
    if not in_order(low, high):
        raise InvalidInputError("t_min", t_min, f"must be below t_max = {t_max}")
    return low, high


def _per_cable(name: str, value: Any, shape: tuple[int, ...]) -> FloatArray:
    """Return a value for each cable in the form of `_stacked`; any shape that broadcasts to `shape` will do."""
    m = shape[-1]
    if isinstance(value, float) and math.isfinite(value):
        return _same_for_all(float(value), m)
    array = checked(name, value)
    if array.ndim == 0:
        return _same_for_all(float(array), m)
    if array.shape == (m,):
        return kernel_input(array, 1, m)
    if broadcast_batch(tensions=shape, **{name: array.shape}) != shape:
        raise InvalidInputError(name, array, f"shape {array.shape} does not fit tensions {shape}")
    return kernel_input(np.broadcast_to(array, shape), -1, m)


@functools.lru_cache(maxsize=32)
def _same_for_all(value: float, m: int) -> FloatArray:
    return kernel_input(np.full(m, value), 1, m)


def _singular(A: FloatArray, status: NDArray[np.int64], batch: tuple[int, ...]) -> SingularWrenchMatrixError:
    first = int((status == SINGULAR).argmax())
    matrix = A[first if len(A) > 1 else 0]
    return SingularWrenchMatrixError(
        "the cables cannot hold the platform against every wrench",
        matrix,
        np.linalg.svd(matrix, compute_uv=False),
        tuple(map(int, np.unravel_index(first, batch))) if batch else (),
    )
