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
    status : numpy.ndarray of int, shape (...)
        A `TensionStatus` for each.
    steps : numpy.ndarray of int, shape (...)
        Steps that the solvers took; 0 where the answer had a closed form.
    """

    tensions: FloatArray
    feasible: BoolArray
    residual: FloatArray
    margin: FloatArray
    status: NDArray[np.int64]
    steps: NDArray[np.int64]
