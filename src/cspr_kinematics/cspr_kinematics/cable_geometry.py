"""Cable vectors between fixed exit points and the anchor points of a platform (MODEL section 1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .arrays import FloatArray
from .so3 import cross

# A cable shorter than this has no direction worth the name: its anchor point lies on its exit point, m.
SHORTEST_CABLE = 1e-6


class CableGeometry(NamedTuple):
    """Cables at one pose or a batch of poses.

    Attributes
    ----------
    lengths : numpy.ndarray, shape (..., m)
        l_i = |a_i - p - r_i|, m (eqs. 2-3).
    directions : numpy.ndarray, shape (..., m, 3)
        u_i, from the platform to the exit point, in base; NaN for a cable of no length.
    arms : numpy.ndarray, shape (..., m, 3)
        r_i = Q b_i, from the platform's origin to the anchor point, in base axes, m.
    """

    lengths: FloatArray
    directions: FloatArray
    arms: FloatArray

    def wrench_columns(self) -> FloatArray:
        """Rows [u_i, r_i x u_i], shape (..., m, 6): the transpose of A, and -J (MODEL section 2)."""
        return np.concatenate((self.directions, cross(self.arms, self.directions)), axis=-1)


def cable_geometry(
    exit_points: FloatArray, anchor_points: FloatArray, position: FloatArray, rotation: FloatArray
) -> CableGeometry:
    """Return the cables of a platform at p `position` (..., 3) with Q `rotation` (..., 3, 3).

    Parameters
    ----------
    exit_points : numpy.ndarray, shape (m, 3)
        a_i in base, m.
    anchor_points : numpy.ndarray, shape (m, 3)
        b_i in platform, m.
    position, rotation : numpy.ndarray
        The pose, with equal batch axes.
    """
    arms = anchor_points @ rotation.swapaxes(-1, -2)
    vectors = exit_points - position[..., None, :] - arms
    lengths = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    with np.errstate(invalid="ignore"):
        directions = vectors / lengths[..., None]
    return CableGeometry(lengths, directions, arms)
