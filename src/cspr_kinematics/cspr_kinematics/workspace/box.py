"""The box in which the platform's origin may be."""

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
