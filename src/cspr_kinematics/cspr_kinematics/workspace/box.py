"""The bounds of the platform: a box for its origin, and one for its angles."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import FloatArray


def way_outside(position: ArrayLike, low: ArrayLike, high: ArrayLike) -> FloatArray:
    """Return how far positions (..., 3) are out of a box along each axis (..., 3), m; not-a-number stays that.

    Parameters
    ----------
    position, low, high
        Positions, and the box's lowest and highest corner (3,), m in base.
    """
    where = np.asarray(position, dtype=float)
    return np.asarray(np.maximum(0.0, np.maximum(np.asarray(low) - where, where - np.asarray(high))))


def turned_outside(angles: ArrayLike, low: ArrayLike, high: ArrayLike) -> FloatArray:
    """Return how far angles (..., 3) are out of their bounds (..., 3), rad, the shorter way round.

    Parameters
    ----------
    angles, low, high
        alpha, beta, gamma (eq. 4), and their least and largest values (3,), rad.
    """
    middle, half = 0.5 * (np.asarray(low) + np.asarray(high)), 0.5 * (np.asarray(high) - np.asarray(low))
    turned = np.asarray(angles, dtype=float) - middle
    turned -= 2.0 * np.pi * np.round(turned / (2.0 * np.pi))
    return np.asarray(np.maximum(0.0, np.abs(turned) - half))
