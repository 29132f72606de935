"""Distribution of a wrench over the cables (eq. 15; MODEL section 4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import lsq_linear

from .arrays import BoolArray, FloatArray, broadcast_batch, checked
from .errors import InvalidInputError

Method = Literal["minimum_norm", "closest"]

# A wrench counts as reached when its error is below this share of it (of one newton for smaller ones).
WRENCH_TOLERANCE = 1e-6
# Above this relative error the normal equations have lost the wrench: A A^T is singular to rounding.
_NORMAL_EQUATION_TOLERANCE = 1e-9
_PSEUDOINVERSE_CUTOFF = 1e-10
# Weight of the distance to the minimum-norm tensions against the wrench error in `closest`, 1/m per m:
# makes the solution unique and continuous, and costs a wrench error of its square, about 1e-10.
_REGULARISATION = 1e-5


@dataclass(frozen=True, eq=False)
class TensionResult:
    """Cable tensions for a wrench, and whether they are any good; arrays are read-only.

    Attributes
    ----------
    tensions : numpy.ndarray, shape (..., m)
        t, N; positive pulls.
    feasible : numpy.ndarray of bool, shape (...)
        Whether the tensions lie in [t_min, t_max] and give the wrench (within 1e-6 of its norm).
    residual : numpy.ndarray, shape (...)
        Norm of the wrench error A t - w; newton and newton metre count alike, as at a lever of 1 m.
    """

    tensions: FloatArray
    feasible: BoolArray
    residual: FloatArray

    def __post_init__(self) -> None:
        for array in (self.tensions, self.feasible, self.residual):
            array.setflags(write=False)


def distribute_tensions(
    wrench_matrix: ArrayLike,
    wrench: ArrayLike,
    t_min: ArrayLike,
    t_max: ArrayLike,
    method: Method = "minimum_norm",
) -> TensionResult:
    """Return tensions t with A t = w, or as near to it as the method can get.

    Parameters
    ----------
    wrench_matrix : array_like, shape (..., 6, m)
        A.
    wrench : array_like, shape (..., 6)
        w, the wrench the cables shall supply.
    t_min, t_max : float or array_like, shape (..., m)
        Limits of the tensions, N.
    method : {"minimum_norm", "closest"}
        `minimum_norm`: t = A^+ w (eq. 15), whatever sign and size it has; `feasible` tells.
        `closest`: t inside the limits with the least wrench error, so that no cable pushes; among several,
        the one nearest to A^+ w, and A^+ w itself where that is inside the limits.

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape, batch axes do not broadcast, a lower limit is not
        below its upper one, or the method is unknown.
    """
    if method not in get_args(Method):
        raise InvalidInputError("method", method, f"known are {', '.join(get_args(Method))}")
    w = checked("wrench", wrench, 6)
    A = checked("wrench_matrix", wrench_matrix)
    if A.ndim < 2 or A.shape[-2] != 6:
        raise InvalidInputError(
            "wrench_matrix", wrench_matrix, f"shape {A.shape} where (..., 6, m) is needed"
        )
    if A.shape[:-2] != w.shape[:-1]:
        batch = broadcast_batch(wrench_matrix=A.shape[:-2], wrench=w.shape[:-1])
        A, w = np.broadcast_to(A, (*batch, *A.shape[-2:])), np.broadcast_to(w, (*batch, 6))
    low, high = _limits(t_min, t_max, (*w.shape[:-1], A.shape[-1]))

    scale = np.maximum(_norm(w), 1.0)
    tensions, residual = _minimum_norm(A, w, scale)
    inside = ((tensions >= low) & (tensions <= high)).all(axis=-1)
    if method == "closest" and not inside.all():
        tensions = np.array(tensions)
        low, high = np.broadcast_to(low, tensions.shape), np.broadcast_to(high, tensions.shape)
        for index in map(tuple, np.argwhere(~inside)):
            tensions[index] = _closest(A[index], w[index], low[index], high[index], tensions[index])
        residual = _residual(A, w, tensions)
        inside = np.ones_like(inside)
    feasible = inside & (residual <= WRENCH_TOLERANCE * scale)
    return TensionResult(tensions, np.asarray(feasible), np.asarray(residual))


def _limits(t_min: ArrayLike, t_max: ArrayLike, shape: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    low, high = checked("t_min", t_min), checked("t_max", t_max)
    if np.any(low >= high):
        raise InvalidInputError("t_min", t_min, f"must be below t_max = {high}")
    for name, limit in (("t_min", low), ("t_max", high)):
        if limit.ndim and broadcast_batch(tensions=shape, **{name: limit.shape}) != shape:
            raise InvalidInputError(name, limit, f"shape {limit.shape} does not fit tensions {shape}")
    return low, high


def _minimum_norm(A: FloatArray, w: FloatArray, scale: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return A^+ w and the norm of its wrench error, which `scale` (...) makes relative."""
    A_transposed = A.swapaxes(-1, -2)
    try:
        # For full row rank A^+ = A^T (A A^T)^-1, a fifth of the cost of a singular value decomposition.
        multipliers = np.linalg.solve(A @ A_transposed, w[..., None])
        tensions = (A_transposed @ multipliers)[..., 0]
        residual = _residual(A, w, tensions)
        if (residual <= _NORMAL_EQUATION_TOLERANCE * scale).all():
            return tensions, residual
    except np.linalg.LinAlgError:
        pass  # exactly singular: the decomposition below handles any rank
    tensions = (np.linalg.pinv(A, rcond=_PSEUDOINVERSE_CUTOFF) @ w[..., None])[..., 0]
    return tensions, _residual(A, w, tensions)


def _closest(
    A: FloatArray, w: FloatArray, low: FloatArray, high: FloatArray, start: FloatArray
) -> FloatArray:
    """Return the bounded least-squares solution for one pose."""
    regularised = np.concatenate((A, _REGULARISATION * np.eye(A.shape[1])))
    target = np.concatenate((w, _REGULARISATION * start))
    solution = lsq_linear(regularised, target, (low, high), method="bvls", max_iter=100)
    return np.asarray(np.clip(solution.x, low, high))


def _residual(A: FloatArray, w: FloatArray, tensions: FloatArray) -> FloatArray:
    return _norm((A @ tensions[..., None])[..., 0] - w)


def _norm(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.einsum("...i,...i->...", vectors, vectors)))
