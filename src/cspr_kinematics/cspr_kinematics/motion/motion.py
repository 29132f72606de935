"""Pose, twist and acceleration that belong together, from Euler angles, quaternions or samples."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import FloatArray, broadcast_batch, checked
from cspr_kinematics.compiled import kernel_input
from cspr_kinematics.errors import InvalidInputError
from cspr_kinematics.motion._rotation import euler_motions
from cspr_kinematics.motion.pose import Acceleration, Pose, Twist
from cspr_kinematics.motion.so3 import cross

# The direction of a quaternion shorter than this is spoilt by rounding.
_SHORTEST_QUATERNION = 1e-6
# What is given, for errors.
_ANGLES = ("angles", "angle_rates", "angle_accelerations")
_QUATERNIONS = ("quaternion_xyzw", "quaternion_rate", "quaternion_acceleration")


class Motion(NamedTuple):
    """State of motion of the platform in base axes: what `required_wrench` takes. Finite, because its parts are."""

    pose: Pose
    twist: Twist
    acceleration: Acceleration

    @classmethod
    def at_rest(cls, pose: Pose) -> Motion:
        """Return the motion of a platform that stays at `pose`."""
        return cls(pose, Twist.zero(), Acceleration.zero())

    def scaled_in_time(self, rate: ArrayLike, acceleration: ArrayLike) -> Motion:
        """Return the motion at the same point of a path when path time sigma(t) runs at another pace.

        By the chain rule the velocity is v sigma' and the acceleration a sigma'^2 + v sigma''; it holds for the angular
        parts too, because the angular velocity is linear in the rate.

        Parameters
        ----------
        rate : array_like, shape (...)
            sigma', seconds of path a second; 1 leaves the motion as it is.
        acceleration : array_like, shape (...)
            sigma'', 1/s.
        """
        rate, acceleration = np.asarray(rate)[..., None], np.asarray(acceleration)[..., None]
        v = self.twist.vector * rate
        a = self.acceleration.vector * rate**2 + self.twist.vector * acceleration
        return Motion(self.pose, Twist(v[..., :3], v[..., 3:]), Acceleration(a[..., :3], a[..., 3:]))


def motion_arrays(
    pose: Pose, twist: Twist, acceleration: Acceleration
) -> tuple[tuple[int, ...], tuple[FloatArray, FloatArray, FloatArray, FloatArray]]:
    """Return the common batch axes, and p, Q, [v; omega] and [a; alpha] in the form that kernels take.

    Raises
    ------
    InvalidInputError
        If the batch axes do not broadcast.
    """
    batch = pose.batch_shape
    p, Q, velocities, accelerations = pose.position, pose.rotation, twist.vector, acceleration.vector
    if twist.batch_shape != batch or acceleration.batch_shape != batch:
        batch = broadcast_batch(pose=batch, twist=twist.batch_shape, acceleration=acceleration.batch_shape)
        Q = np.broadcast_to(Q, (*batch, 3, 3))
        p, velocities, accelerations = (
            np.broadcast_to(x, (*batch, x.shape[-1])) for x in (p, velocities, accelerations)
        )
    n = math.prod(batch)
    return batch, (
        kernel_input(p, n, 3),
        kernel_input(Q, n, 3, 3),
        kernel_input(velocities, n, 6),
        kernel_input(accelerations, n, 6),
    )


def motion_from_euler(
    position: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    angles: ArrayLike,
    angle_rates: ArrayLike,
    angle_accelerations: ArrayLike,
) -> Motion:
    """Return the motion of a platform with Q = Rz(alpha) Ry(beta) Rx(gamma) (eq. 4).

    The angular velocity is the sum of the three rates, each about its own axis as turned by the rotations
    before it: omega = alpha' z + beta' Rz y + gamma' Rz Ry x. The angular acceleration takes into
    account that those axes turn.

    Parameters
    ----------
    position, velocity, acceleration : array_like, shape (..., 3)
        Of the platform's origin in base, m, m/s and m/s^2.
    angles, angle_rates, angle_accelerations : array_like, shape (..., 3)
        alpha, beta, gamma, and their first and second derivatives in time, rad, rad/s and rad/s^2.

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape, or the batch axes do not broadcast.
    """
    turning = _vectors(3, _ANGLES, (angles, angle_rates, angle_accelerations))
    batch = _common_batch(_ANGLES, turning)
    n = math.prod(batch)
    angles, rates, growths = (
        kernel_input(x if x.shape[:-1] == batch else np.broadcast_to(x, (*batch, 3)), n, 3) for x in turning
    )
    Q, omega, alpha = np.empty((*batch, 3, 3)), np.empty((*batch, 3)), np.empty((*batch, 3))
    euler_motions(angles, rates, growths, Q.reshape(n, 3, 3), omega.reshape(n, 3), alpha.reshape(n, 3))
    p = checked("position", position, 3)
    pose = Pose.trusted(p.copy(), Q) if p.shape[:-1] == batch else Pose(p, Q)
    return Motion(pose, Twist(velocity, omega), Acceleration(acceleration, alpha))


def motion_from_quaternion(
    position: ArrayLike,
    velocity: ArrayLike,
    acceleration: ArrayLike,
    quaternion_xyzw: ArrayLike,
    quaternion_rate: ArrayLike,
    quaternion_acceleration: ArrayLike,
) -> Motion:
    """Return the motion of a platform whose orientation is a quaternion and its derivatives in time.

    q may be any curve of quaternions, not only of unit norm; its direction is the rotation:
    omega = 2 vec(q' q*) / |q|^2, alpha = 2 vec(q'' q*) / |q|^2 - 2 (q . q') / |q|^2 omega.

    Parameters
    ----------
    position, velocity, acceleration : array_like, shape (..., 3)
        Of the platform's origin in base, m, m/s and m/s^2.
    quaternion_xyzw, quaternion_rate, quaternion_acceleration : array_like, shape (..., 4)
        In the order x, y, z, w of ROS messages.

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape, the batch axes do not broadcast, or a quaternion is
        zero.
    """
    q, qd, qdd = _vectors(4, _QUATERNIONS, (quaternion_xyzw, quaternion_rate, quaternion_acceleration))
    _common_batch(_QUATERNIONS, (q, qd, qdd))
    square = np.einsum("...i,...i->...", q, q)[..., None]
    if square.size and square.min() < _SHORTEST_QUATERNION**2:
        raise InvalidInputError("quaternion_xyzw", q, "a quaternion of length zero is no rotation")
    omega = 2.0 * _vector_of_product(qd, q) / square
    growth = 2.0 * np.einsum("...i,...i->...", q, qd)[..., None] / square
    alpha = 2.0 * _vector_of_product(qdd, q) / square - growth * omega
    rotation = Pose.from_quaternion(np.zeros(3), q / np.sqrt(square)).rotation
    return Motion(Pose(position, rotation), Twist(velocity, omega), Acceleration(acceleration, alpha))


class PoseSpline:
    """A smooth trajectory through sampled poses, with the twist and acceleration that belong to it.

    Quintic splines (cubic ones for four or five samples) through positions and quaternions; the rotation is
    the direction of the quaternion spline, so that pose, twist and acceleration agree exactly.

    Parameters
    ----------
    times : array_like, shape (n,)
        Strictly increasing, s; at least four.
    poses : Pose
        A batch of n.

    Raises
    ------
    InvalidInputError
        If times do not increase or do not match the poses. On a call, if a time lies outside the samples.
    """

    def __init__(self, times: ArrayLike, poses: Pose) -> None:
        from scipy.interpolate import make_interp_spline  # takes as long to import as everything else

        t = checked("times", times)
        if t.ndim != 1 or poses.batch_shape != t.shape or len(t) < 4:
            raise InvalidInputError(
                "times", t, f"shape {t.shape} for poses {poses.batch_shape}; at least four of each are needed"
            )
        if np.any(np.diff(t) <= 0.0):
            raise InvalidInputError("times", t, "must increase")
        q = poses.quaternion
        # of the two quaternions of each rotation, the one nearer to the previous sample
        turns = np.sign(np.einsum("ni,ni->n", q[1:], q[:-1]))
        q[1:] *= np.cumprod(np.where(turns == 0.0, 1.0, turns))[:, None]
        degree = 5 if len(t) >= 6 else 3
        self._splines = [make_interp_spline(t, np.concatenate((poses.position, q), axis=1), k=degree)]
        self._splines += [self._splines[0].derivative(order) for order in (1, 2)]
        self._range = float(t[0]), float(t[-1])

    def __call__(self, time: ArrayLike) -> Motion:
        """Return the motion at one time or an array of them, s."""
        t = checked("time", time)
        first, last = self._range
        if t.size and (t.min() < first or t.max() > last):
            raise InvalidInputError("time", t, f"outside the samples, {first:g} to {last:g} s")
        x, v, a = (np.asarray(spline(t), dtype=np.float64) for spline in self._splines)
        return motion_from_quaternion(x[..., :3], v[..., :3], a[..., :3], x[..., 3:], v[..., 3:], a[..., 3:])


def _vectors(size: int, names: tuple[str, ...], vectors: tuple[ArrayLike, ...]) -> list[FloatArray]:
    return [checked(name, vector, size) for name, vector in zip(names, vectors, strict=True)]


def _common_batch(names: tuple[str, ...], vectors: Iterable[FloatArray]) -> tuple[int, ...]:
    return broadcast_batch(**{name: x.shape[:-1] for name, x in zip(names, vectors, strict=True)})


def _vector_of_product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Vector part (..., 3) of the product of the quaternions a and conjugate b, in the order x, y, z, w."""
    product: FloatArray = b[..., 3:] * a[..., :3] - a[..., 3:] * b[..., :3] - cross(a[..., :3], b[..., :3])
    return product
