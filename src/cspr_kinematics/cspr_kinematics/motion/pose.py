"""Pose, twist and acceleration of the platform frame in the base frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import (
    FloatArray,
    ReadOnlyArrays,
    as_floats,
    broadcast_batch,
    checked,
    frozen,
    is_finite,
)
from cspr_kinematics.compiled import kernel_input
from cspr_kinematics.errors import InvalidInputError
from cspr_kinematics.motion._rotation import pose_defects, quaternions, rotations
from cspr_kinematics.motion.so3 import euler_from_rotation, rotation_from_euler

ORTHONORMALITY_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Pose(ReadOnlyArrays):
    """Position and rotation of the platform in the base frame (p and Q of docs/model.md, section 1).

    Attributes
    ----------
    position : numpy.ndarray, shape (..., 3)
        Origin of the platform frame in base, m.
    rotation : numpy.ndarray, shape (..., 3, 3)
        Q, which maps platform coordinates to base coordinates.

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape, if a matrix is not a rotation (orthonormal within
        1e-6, right-handed), or if the batch axes do not broadcast.
    """

    position: FloatArray
    rotation: FloatArray

    def __init__(self, position: ArrayLike, rotation: ArrayLike) -> None:
        p = as_floats("position", position, 3)
        Q = as_floats("rotation", rotation, 3, 3)
        if p.shape[:-1] != Q.shape[:-2]:
            batch = broadcast_batch(position=p.shape[:-1], rotation=Q.shape[:-2])
            p = np.broadcast_to(p, (*batch, 3))
            Q = np.broadcast_to(Q, (*batch, 3, 3))
        p, Q = frozen(p), frozen(Q)
        n = math.prod(p.shape[:-1])
        defect, determinant = pose_defects(p.reshape(n, 3), Q.reshape(n, 3, 3))
        if not defect <= ORTHONORMALITY_TOLERANCE:
            checked("position", p)
            checked("rotation", Q)
            raise InvalidInputError("rotation", Q, f"not orthonormal (Q Q^T - 1 reaches {defect:.3g})")
        if determinant < 0.0:
            raise InvalidInputError("rotation", Q, "left-handed (determinant -1), a reflection")
        self._set(position=p, rotation=Q)

    @classmethod
    def trusted(cls, position: FloatArray, rotation: FloatArray) -> Pose:
        """Build a pose from arrays that are valid by construction, without copy or check; they become read-only.

        Parameters
        ----------
        position : numpy.ndarray, shape (..., 3)
        rotation : numpy.ndarray, shape (..., 3, 3)
            C-contiguous both, with equal batch axes.
        """
        pose = object.__new__(cls)
        position.setflags(write=False)
        rotation.setflags(write=False)
        pose._set(position=position, rotation=rotation)
        return pose

    @classmethod
    def from_euler(cls, position: ArrayLike, alpha: ArrayLike, beta: ArrayLike, gamma: ArrayLike) -> Pose:
        """Build a pose with Q = Rz(alpha) Ry(beta) Rx(gamma) (eq. 4).

        Parameters
        ----------
        position : array_like, shape (..., 3)
            Origin of the platform frame in base, m.
        alpha, beta, gamma : array_like, shape (...)
            Angles about z, y and x, rad.

        Raises
        ------
        InvalidInputError
            If a value is not finite or the batch axes do not broadcast.
        """
        a, b, g = checked("alpha", alpha), checked("beta", beta), checked("gamma", gamma)
        broadcast_batch(alpha=a.shape, beta=b.shape, gamma=g.shape)
        return cls(position, rotation_from_euler(a, b, g))

    @classmethod
    def from_quaternion(cls, position: ArrayLike, quaternion_xyzw: ArrayLike) -> Pose:
        """Build a pose from a quaternion in the order of ROS messages, x, y, z, w.

        Parameters
        ----------
        position : array_like, shape (..., 3)
            Origin of the platform frame in base, m.
        quaternion_xyzw : array_like, shape (..., 4)
            Normalised here; a quaternion whose norm is not 1 within 1e-3 is refused, because it is more
            likely a message that was never filled in than a rotation.

        Raises
        ------
        InvalidInputError
            If a value is not finite, has another shape, or a quaternion is not of unit norm.
        """
        p = checked("position", position, 3)
        quaternion = as_floats("quaternion_xyzw", quaternion_xyzw, 4)
        batch = p.shape[:-1]
        if batch != quaternion.shape[:-1]:
            batch = broadcast_batch(position=batch, quaternion_xyzw=quaternion.shape[:-1])
            p, quaternion = np.broadcast_to(p, (*batch, 3)), np.broadcast_to(quaternion, (*batch, 4))
        n = math.prod(batch)
        matrices = np.empty((n, 3, 3))
        if not rotations(kernel_input(quaternion, n, 4), matrices) <= 1e-3:
            checked("quaternion_xyzw", quaternion)
            raise InvalidInputError("quaternion_xyzw", quaternion, "not a unit quaternion")
        return cls.trusted(p.copy(), matrices.reshape(*batch, 3, 3))

    @property
    def quaternion(self) -> FloatArray:
        """Rotation as unit quaternion (..., 4) in the order x, y, z, w, with w >= 0."""
        n = math.prod(self.batch_shape)
        result = np.empty((n, 4))
        quaternions(kernel_input(self.rotation, n, 3, 3), result)
        return result.reshape(*self.batch_shape, 4)

    @property
    def euler(self) -> FloatArray:
        """Angles alpha, beta, gamma of eq. 4, shape (..., 3), rad; beta in [-pi/2, pi/2]."""
        return euler_from_rotation(self.rotation)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """Leading axes; () for a single pose."""
        return self.position.shape[:-1]


@dataclass(frozen=True, eq=False)
class _LinearAngular(ReadOnlyArrays):
    """A linear and an angular vector of the platform, both in base axes, as one."""

    vector: FloatArray

    def __init__(self, linear: ArrayLike, angular: ArrayLike) -> None:
        v, omega = as_floats("linear", linear, 3), as_floats("angular", angular, 3)
        batch = v.shape[:-1]
        if omega.shape[:-1] != batch:
            batch = broadcast_batch(linear=batch, angular=omega.shape[:-1])
        vector = np.empty((*batch, 6))
        vector[..., :3], vector[..., 3:] = v, omega
        if not is_finite(vector):
            checked("linear", v)
            checked("angular", omega)
        vector.setflags(write=False)
        self._set(vector=vector)

    @property
    def linear(self) -> FloatArray:
        """The linear vector, shape (..., 3)."""
        return self.vector[..., :3]

    @property
    def angular(self) -> FloatArray:
        """The angular vector, shape (..., 3)."""
        return self.vector[..., 3:]

    @classmethod
    @cache
    def zero(cls) -> Self:
        """Return that of a platform at rest or, of an acceleration, in uniform translation too."""
        return cls(np.zeros(3), np.zeros(3))

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """Leading axes; () for a single one."""
        return self.vector.shape[:-1]


class Twist(_LinearAngular):
    """Velocity of the platform in base axes.

    Attributes
    ----------
    linear : numpy.ndarray, shape (..., 3)
        v, velocity of the platform's origin, m/s.
    angular : numpy.ndarray, shape (..., 3)
        omega, angular velocity, rad/s.
    vector : numpy.ndarray, shape (..., 6)
        xdot = [v; omega].

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape.
    """


class Acceleration(_LinearAngular):
    """Acceleration of the platform in base axes.

    Attributes
    ----------
    linear : numpy.ndarray, shape (..., 3)
        a, acceleration of the platform's origin, m/s^2.
    angular : numpy.ndarray, shape (..., 3)
        alpha, angular acceleration, rad/s^2.
    vector : numpy.ndarray, shape (..., 6)
        [a; alpha].

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape.
    """
