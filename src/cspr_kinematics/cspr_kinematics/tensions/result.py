"""Result of a tension distribution: the tensions, and whether they can be used."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics.arrays import BoolArray, FloatArray


class TensionResult(NamedTuple):
    """Cable tensions for a wrench, and whether they can be used; arrays are read-only.

    Attributes
    ----------
    tensions : numpy.ndarray, shape (..., m)
        t, N; positive when the cable pulls.
    feasible : numpy.ndarray of bool, shape (...)
        Whether the tensions lie in [t_min, t_max] and give the wrench (within 1e-6 of its norm).
    residual : numpy.ndarray, shape (...)
        Norm of the wrench error A t - w; N and N m count alike, as with a lever of 1 m.
    margin : numpy.ndarray, shape (...)
        Distance of the tensions from the nearest limit, N; negative if one is violated, by that much.
    active : numpy.ndarray of int8, shape (..., m)
        -1 where a tension is at or below its lower limit, 1 where at or above its upper one, 0 elsewhere.
    status : numpy.ndarray of int, shape (...)
        A `TensionStatus` for each.
    steps : numpy.ndarray of int, shape (...)
        Steps that the solvers took; 0 where the answer had a closed form.
    separating_direction : numpy.ndarray, shape (..., 6)
        For a bounded method and a wrench out of reach, a unit vector d that proves it: d . w exceeds
        d . (A t) for every t within the limits. NaN elsewhere.
    separation : numpy.ndarray, shape (...)
        The distance of w, along d, from the nearest wrench within reach. NaN elsewhere.
    """

    tensions: FloatArray
    feasible: BoolArray
    residual: FloatArray
    margin: FloatArray
    active: NDArray[np.int8]
    status: NDArray[np.int64]
    steps: NDArray[np.int64]
    separating_direction: FloatArray
    separation: FloatArray
