"""Wrench that the cables must supply to hold or move the platform (eqs. 8-13; MODEL section 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from .arrays import FloatArray, broadcast_batch, checked, frozen
from .pose import Acceleration, Pose, Twist
from .rigid_body import Payload
from .robot import Robot
from .so3 import cross, rotate

GRAVITY = frozen(np.array([0.0, 0.0, -9.81]))  # in base, m/s^2


def required_wrench(
    robot: Robot,
    pose: Pose,
    twist: Twist,
    acceleration: Acceleration,
    payload: Payload | None = None,
    external_wrench: ArrayLike | None = None,
) -> FloatArray:
    """Return the cables' wrench for a motion: w = H [a; alpha] + C xdot - w_g - w_e.

    Parameters
    ----------
    robot : Robot
    pose : Pose
    twist : Twist
    acceleration : Acceleration
    payload : Payload, optional
        Carried besides the platform.
    external_wrench : array_like, shape (..., 6), optional
        w_e, force and moment about the platform's origin that the surroundings exert on it, in base axes,
        N and N m.

    Returns
    -------
    numpy.ndarray, shape (..., 6)
        Force and moment about the platform's origin, in base axes, N and N m.

    Raises
    ------
    InvalidInputError
        If the batch axes do not broadcast, or the external wrench is not finite or has another shape.
    """
    broadcast_batch(pose=pose.batch_shape, twist=twist.batch_shape, acceleration=acceleration.batch_shape)
    mass, mc, body_inertia = _mass_properties(robot, pose, payload)
    omega, alpha = twist.angular, acceleration.angular
    # Gravity enters as an upward acceleration of the whole platform: -w_g = [-m g; -mc x g].
    a = acceleration.linear - GRAVITY
    force = mass * a + cross(alpha, mc) + cross(omega, cross(omega, mc))

    I_P = pose.rotation @ body_inertia @ pose.rotation.swapaxes(-1, -2)
    moment = cross(mc, a) + rotate(I_P, alpha) + cross(omega, rotate(I_P, omega))
    return _less_external(np.concatenate((force, moment), axis=-1), external_wrench)


def static_wrench(
    robot: Robot,
    pose: Pose,
    payload: Payload | None = None,
    external_wrench: ArrayLike | None = None,
) -> FloatArray:
    """Return the cables' wrench that holds the platform at rest: w = -w_g - w_e.

    Parameters, result (..., 6) and errors are those of `required_wrench`.
    """
    mass, mc, _ = _mass_properties(robot, pose, payload)
    force = np.broadcast_to(-mass * GRAVITY, mc.shape)
    return _less_external(np.concatenate((force, cross(mc, -GRAVITY)), axis=-1), external_wrench)


def _mass_properties(
    robot: Robot, pose: Pose, payload: Payload | None
) -> tuple[float, FloatArray, FloatArray]:
    """Return mass, first moment mc in base axes (..., 3), and inertia about P in platform axes (3, 3).

    About a common point and in common axes these add up, platform and payload.
    """
    body = robot.platform
    mass, first_moment, inertia = body.mass, body.first_moment, body.inertia_about_origin
    if payload is not None and payload.mass > 0.0:
        mass += payload.mass
        first_moment = first_moment + payload.first_moment
        inertia = inertia + payload.inertia_about_origin
    return mass, rotate(pose.rotation, first_moment), inertia


def _less_external(wrench: FloatArray, external_wrench: ArrayLike | None) -> FloatArray:
    if external_wrench is None:
        return wrench
    external = checked("external_wrench", external_wrench, 6)
    broadcast_batch(wrench=wrench.shape[:-1], external_wrench=external.shape[:-1])
    return np.asarray(wrench - external)
