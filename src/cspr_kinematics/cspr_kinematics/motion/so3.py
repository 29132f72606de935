"""Rotations of three-dimensional space as matrices, in batches."""

from __future__ import annotations

import numpy as np

from cspr_kinematics.arrays import FloatArray

_NEXT = np.array([1, 2, 0])
_AFTER_NEXT = np.array([2, 0, 1])
# Below this cosine of beta, alpha and gamma cannot be told apart for rounding: they turn about the same axis.
_GIMBAL_LOCK = 1e-7


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross product of vectors (..., 3); a tenth of the overhead of `numpy.cross` for one pair."""
    return np.asarray(
        a.take(_NEXT, -1) * b.take(_AFTER_NEXT, -1) - a.take(_AFTER_NEXT, -1) * b.take(_NEXT, -1)
    )


def rotation_from_euler(alpha: FloatArray, beta: FloatArray, gamma: FloatArray) -> FloatArray:
    """Return Q = Rz(alpha) Ry(beta) Rx(gamma) of eq. 4, shape (..., 3, 3), from angles (...) in rad."""
    ca, sa = np.cos(alpha), np.sin(alpha)
    cb, sb = np.cos(beta), np.sin(beta)
    cg, sg = np.cos(gamma), np.sin(gamma)
    Q = np.empty((*np.broadcast(alpha, beta, gamma).shape, 3, 3))
    Q[..., 0, 0], Q[..., 0, 1], Q[..., 0, 2] = ca * cb, ca * sb * sg - sa * cg, ca * sb * cg + sa * sg
    Q[..., 1, 0], Q[..., 1, 1], Q[..., 1, 2] = sa * cb, sa * sb * sg + ca * cg, sa * sb * cg - ca * sg
    Q[..., 2, 0], Q[..., 2, 1], Q[..., 2, 2] = -sb, cb * sg, cb * cg
    return Q


def euler_from_rotation(rotation: FloatArray) -> FloatArray:
    """Return alpha, beta, gamma (..., 3) of eq. 4 from Q (..., 3, 3), rad; beta in [-pi/2, pi/2].

    Where beta is +-pi/2 to rounding, only alpha -+ gamma is known; gamma is then set to zero.
    """
    Q = rotation
    cos_beta = np.hypot(Q[..., 0, 0], Q[..., 1, 0])
    known = cos_beta > _GIMBAL_LOCK
    alpha = np.where(known, np.arctan2(Q[..., 1, 0], Q[..., 0, 0]), np.arctan2(-Q[..., 0, 1], Q[..., 1, 1]))
    gamma = np.where(known, np.arctan2(Q[..., 2, 1], Q[..., 2, 2]), 0.0)
    return np.stack((alpha, np.arctan2(-Q[..., 2, 0], cos_beta), gamma), axis=-1)
