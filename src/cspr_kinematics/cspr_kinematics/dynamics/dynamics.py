"""Wrench that the cables must supply to hold or move the platform (eqs. 8-13; docs/model.md, section 4)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import FloatArray, broadcast_batch, checked, frozen
from cspr_kinematics.compiled import kernel_input
from cspr_kinematics.dynamics._dynamics import GRAVITY_Z, required_wrenches
from cspr_kinematics.motion.motion import motion_arrays
from cspr_kinematics.motion.pose import Acceleration, Pose, Twist
from cspr_kinematics.robot.rigid_body import Payload
from cspr_kinematics.robot.robot import Robot

GRAVITY = frozen(np.array([0.0, 0.0, GRAVITY_Z]))  # in base, m/s^2
_UNIT_PARAMETERS = [frozen(row) for row in np.eye(10)]


def required_wrench(
    robot: Robot,
    pose: Pose,
    twist: Twist,
    acceleration: Acceleration,
    payload: Payload | None = None,
    external_wrench: ArrayLike | None = None,
) -> FloatArray:
    """Return the wrench that the cables must supply for a motion: w = H [a; alpha] + C xdot - w_g - w_e.

    Parameters
    ----------
    robot : Robot
    pose : Pose
    twist : Twist
    acceleration : Acceleration
    payload : Payload, optional
        Carried in addition to the platform.
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
    batch, (_, rotations, twists, accelerations) = motion_arrays(pose, twist, acceleration)
    wrench = np.empty((math.prod(batch), 6))
    required_wrenches(_total_parameters(robot, payload), rotations, twists, accelerations, wrench)
    return _less_external(wrench.reshape((*batch, 6)), external_wrench)


def static_wrench(
    robot: Robot,
    pose: Pose,
    payload: Payload | None = None,
    external_wrench: ArrayLike | None = None,
) -> FloatArray:
    """Return the cables' wrench that holds the platform at rest: w = -w_g - w_e.

    Parameters, result (..., 6) and errors are those of `required_wrench`.
    """
    n = math.prod(pose.batch_shape)
    wrench, still = np.empty((n, 6)), kernel_input(np.zeros((n, 6)), n, 6)
    rotations = kernel_input(pose.rotation, n, 3, 3)
    required_wrenches(_total_parameters(robot, payload), rotations, still, still, wrench)
    return _less_external(wrench.reshape(*pose.batch_shape, 6), external_wrench)


def balance_regressor(pose: Pose, twist: Twist, acceleration: Acceleration) -> FloatArray:
    """Return Y such that the required wrench, without an external one, is w = Y pi.

    pi holds the ten inertial parameters of everything that moves, `RigidBody.inertial_parameters`. The six
    equations of one instant do not determine them; those along a motion that turns and accelerates do. At rest
    only the columns of the mass and the horizontal first moments are non-zero.

    Returns
    -------
    numpy.ndarray, shape (..., 6, 10)

    Raises
    ------
    InvalidInputError
        If the batch axes do not broadcast.
    """
    batch, (_, rotations, twists, accelerations) = motion_arrays(pose, twist, acceleration)
    columns = np.empty((10, math.prod(batch), 6))
    for unit, column in zip(_UNIT_PARAMETERS, columns, strict=True):
        required_wrenches(
            unit, rotations, twists, accelerations, column
        )  # linear in the parameters: of each alone, with the value 1
    return np.moveaxis(columns, 0, -1).reshape(*batch, 6, 10)


def _total_parameters(robot: Robot, payload: Payload | None) -> FloatArray:
    """Return the inertial parameters (10,) of platform and payload, which add up about the same origin."""
    parameters = robot.platform.inertial_parameters
    if payload is None or payload.mass == 0.0:
        return parameters
    total: FloatArray = parameters + payload.inertial_parameters
    total.setflags(write=False)
    return total


def _less_external(wrench: FloatArray, external_wrench: ArrayLike | None) -> FloatArray:
    if external_wrench is None:
        return wrench
    external = checked("external_wrench", external_wrench, 6)
    broadcast_batch(wrench=wrench.shape[:-1], external_wrench=external.shape[:-1])
    return np.asarray(wrench - external)
