"""The wrenches that the cables can supply within their limits: a convex polytope, described by its faces.

The set {A t : t_min <= t <= t_max} is a zonotope. Each of its faces is spanned by five of the cables, so that
the normals of all faces are among the directions orthogonal to five independent columns of A (Bouchard,
Gosselin, Moore, "On the ability of a cable-driven robot to generate a prescribed set of wrenches", ASME J.
Mechanisms and Robotics 2, 2010; Gouttefarde, Krut, "Characterization of parallel manipulator available wrench
set facets", ARK 2010).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import comb

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import (
    FloatArray,
    ReadOnlyArrays,
    checked,
    for_each_cable,
    frozen,
)
from cspr_kinematics.compiled import kernel_input
from cspr_kinematics.errors import InvalidInputError, SingularWrenchMatrixError
from cspr_kinematics.tensions._null_space import RANK_TOLERANCE
from cspr_kinematics.workspace._wrench_set import faces_kernel


@dataclass(frozen=True, eq=False)
class WrenchSet(ReadOnlyArrays):
    """Wrenches within reach at one pose: those with normals @ wrench <= offsets; arrays are read-only.

    Attributes
    ----------
    normals : numpy.ndarray, shape (f, 6)
        Outward directions, of unit length when moments are divided by a lever of 1 m: the first three elements multiply
        a force, the last three a moment.
    offsets : numpy.ndarray, shape (f,)
        Largest value of normals @ wrench within reach, N.
    """

    normals: FloatArray
    offsets: FloatArray

    def margin(self, wrench: ArrayLike) -> FloatArray:
        """Return how far wrenches (..., 6) lie inside, shape (...), N.

        Inside, the length of the shortest additional wrench, moments divided by a lever of 1 m, that takes the
        wrench to the border (the capacity margin of Ruiz, Caro, Cardou, Guay, CableCon 2014). Outside it is
        negative, and the distance to the set is at least its absolute value.

        Raises
        ------
        InvalidInputError
            If a value is not finite or has another shape.
        """
        w = checked("wrench", wrench, 6)
        return np.asarray((self.offsets - w @ self.normals.T).min(axis=-1))


def available_wrenches(wrench_matrix: ArrayLike, t_min: ArrayLike, t_max: ArrayLike) -> WrenchSet:
    """Return the wrenches that the cables can supply at one pose.

    Parameters
    ----------
    wrench_matrix : array_like, shape (6, m)
        A.
    t_min, t_max : float or array_like, shape (m,)
        Limits of the tensions, N.

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape, or a lower limit is not below its upper one.
    SingularWrenchMatrixError
        If the wrench matrix is rank-deficient: the wrenches within reach do not span all six dimensions.
    """
    A = checked("wrench_matrix", wrench_matrix)
    if A.ndim != 2 or A.shape[0] != 6 or A.shape[1] < 6:
        raise InvalidInputError(
            "wrench_matrix", wrench_matrix, f"shape {A.shape} where (6, m) with m >= 6 is needed"
        )
    m = A.shape[1]
    low, high = tension_limits(t_min, t_max, m)
    faces = np.empty((2 * comb(m, 5), 7))
    singular_values: FloatArray = np.asarray(np.linalg.svd(A, compute_uv=False), dtype=np.float64)
    if singular_values[-1] <= RANK_TOLERANCE * singular_values[0]:
        raise SingularWrenchMatrixError(
            "the wrenches within reach do not span all six dimensions", A, singular_values
        )
    count = faces_kernel(kernel_input(A, 6, m), low, high, faces)
    return WrenchSet(frozen(faces[:count, :6]), frozen(faces[:count, 6]))


def tension_limits(t_min: ArrayLike, t_max: ArrayLike, m: int) -> tuple[FloatArray, FloatArray]:
    """Return the limits of m cables as kernel inputs (m,).

    Raises
    ------
    InvalidInputError
        If a value is not finite, has another shape, or a lower limit is not below its upper one.
    """
    low, high = for_each_cable("t_min", t_min, m), for_each_cable("t_max", t_max, m)
    if np.any(low >= high):
        raise InvalidInputError("t_min", t_min, f"must be below t_max = {high}")
    return low, high
