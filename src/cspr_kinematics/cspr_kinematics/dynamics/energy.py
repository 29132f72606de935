"""Energy of the moving platform, and the power of wrenches and cables (docs/model.md, section 4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import FloatArray, broadcast_batch, checked
from cspr_kinematics.dynamics.dynamics import GRAVITY, total_parameters
from cspr_kinematics.kinematics.inverse import Cables
from cspr_kinematics.motion.pose import Pose, Twist
from cspr_kinematics.motion.so3 import rotate, skew
from cspr_kinematics.robot.rigid_body import TENSOR_PLACES, Payload
from cspr_kinematics.robot.robot import Robot


def inertia_matrix(robot: Robot, pose: Pose, payload: Payload | None = None) -> FloatArray:
    """Return H = [[m 1, -[mc]x], [[mc]x, I_P]], (..., 6, 6), about the platform's origin in base axes."""
    parameters = total_parameters(robot, payload)
    Q = pose.rotation
    coupling = skew(rotate(Q, parameters[1:4]))
    H = np.empty((*pose.batch_shape, 6, 6))
    H[..., :3, :3] = parameters[0] * np.eye(3)
    H[..., :3, 3:] = -coupling
    H[..., 3:, :3] = coupling
    H[..., 3:, 3:] = Q @ parameters[TENSOR_PLACES] @ Q.swapaxes(-1, -2)
    return H


def kinetic_energy(robot: Robot, pose: Pose, twist: Twist, payload: Payload | None = None) -> FloatArray:
    """Return 1/2 [v; omega]^T H [v; omega], shape (...), J.

    Raises
    ------
    InvalidInputError
        If the batch axes do not broadcast.
    """
    broadcast_batch(pose=pose.batch_shape, twist=twist.batch_shape)
    x = _stacked(twist)
    return np.asarray(0.5 * np.einsum("...i,...ij,...j->...", x, inertia_matrix(robot, pose, payload), x))


def potential_energy(robot: Robot, pose: Pose, payload: Payload | None = None) -> FloatArray:
    """Return the energy of the weight, zero with the centre of mass at the origin of base, shape (...), J."""
    parameters = total_parameters(robot, payload)
    first_moment = parameters[0] * pose.position + rotate(pose.rotation, parameters[1:4])
    return np.asarray(-(first_moment @ GRAVITY))


def wrench_power(wrench: ArrayLike, twist: Twist) -> FloatArray:
    """Return the power w . [v; omega] of a wrench about the platform's origin, shape (...), W.

    Raises
    ------
    InvalidInputError
        If the wrench is not finite or not (..., 6), or the batch axes do not broadcast.
    """
    w = checked("wrench", wrench, 6)
    broadcast_batch(wrench=w.shape[:-1], twist=twist.batch_shape)
    return np.asarray(np.einsum("...i,...i->...", w, _stacked(twist)))


def cable_power(cables: Cables, tensions: ArrayLike, twist: Twist) -> FloatArray:
    """Return the power -t_i ldot_i that each cable gives to the platform, shape (..., m), W.

    A motor takes from or gives to its cable the same, but for friction and the inertia of the winch.

    Raises
    ------
    InvalidInputError
        If the tensions are not finite or not (..., m), or the batch axes do not broadcast.
    """
    t = checked("tensions", tensions, cables.lengths.shape[-1])
    broadcast_batch(cables=cables.lengths.shape[:-1], tensions=t.shape[:-1], twist=twist.batch_shape)
    return np.asarray(-t * (cables.jacobian @ _stacked(twist)[..., None])[..., 0])


def _stacked(twist: Twist) -> FloatArray:
    return np.concatenate((twist.linear, twist.angular), axis=-1)
