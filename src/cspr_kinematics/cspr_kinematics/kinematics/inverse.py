"""Inverse kinematics over fixed exit points or pulleys, and its derivatives (eqs. 1-7; docs/model.md, 1 and 2)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cspr_kinematics.arrays import FloatArray, ReadOnlyArrays
from cspr_kinematics.compiled import in_batch, kernel_input
from cspr_kinematics.kinematics._length_accelerations import length_accelerations_of_motions
from cspr_kinematics.motion.motion import motion_arrays
from cspr_kinematics.motion.pose import Acceleration, Pose, Twist
from cspr_kinematics.robot._cable_paths import PATH_EXISTS, cables_at_poses
from cspr_kinematics.robot.cable_paths import path_error, path_lengths
from cspr_kinematics.robot.robot import Robot


@dataclass(frozen=True, eq=False)
class Cables(ReadOnlyArrays):
    """The cables at one pose or a batch of poses; arrays are read-only.

    Attributes
    ----------
    lengths : numpy.ndarray, shape (..., m)
        From the exit point to the anchor point, including what is wrapped around the pulley, m.
    directions : numpy.ndarray, shape (..., m, 3)
        Unit vectors u_i from the platform towards the exit point or the pulley, in base axes.
    arms : numpy.ndarray, shape (..., m, 3)
        r_i = Q b_i, from the platform's origin to the anchor point, in base axes, m.
    wrench_matrix : numpy.ndarray, shape (..., 6, m)
        A, column i [u_i; r_i x u_i]: `A @ t` is the wrench of tensions t on the platform about its origin,
        in base axes.
    jacobian : numpy.ndarray, shape (..., m, 6)
        J = -A^T: `J @ [v; omega]` are the rates of the cable lengths, exactly so with pulleys too.
    free_lengths : numpy.ndarray, shape (..., m)
        f_i, from the anchor point to where the cable leaves its pulley, m.
    position : numpy.ndarray, shape (..., 3)
        p, the platform's origin in base, m.
    """

    lengths: FloatArray
    directions: FloatArray
    arms: FloatArray
    wrench_matrix: FloatArray
    jacobian: FloatArray
    free_lengths: FloatArray
    position: FloatArray

    @property
    def anchor_points(self) -> FloatArray:
        """Where the cables end at the platform, p + r_i in base, shape (..., m, 3), m."""
        return np.asarray(self.position[..., None, :] + self.arms)

    @property
    def tangent_points(self) -> FloatArray:
        """Where the cables leave their pulleys, p + r_i + f_i u_i in base, shape (..., m, 3), m.

        Without pulleys these are the exit points.
        """
        return np.asarray(self.anchor_points + self.free_lengths[..., None] * self.directions)


def inverse_kinematics(robot: Robot, pose: Pose) -> Cables:
    """Return cable lengths, directions and Jacobian at `pose`.

    Parameters
    ----------
    robot : Robot
    pose : Pose
        One pose or a batch.

    Raises
    ------
    CableReachError
        If a cable has no path or no direction: its anchor point lies on its exit point (within a micrometre),
        inside its pulley, or on its swivel axis. Names cable and pose.
    """
    batch, m = pose.batch_shape, robot.number_of_cables
    n = math.prod(batch)
    lengths, free_lengths = np.empty((n, m)), np.empty((n, m))
    directions, arms = np.empty((n, m, 3)), np.empty((n, m, 3))
    wrench_matrix, jacobian = np.empty((n, 6, m)), np.empty((n, m, 6))
    outputs = lengths, directions, arms, wrench_matrix, jacobian, free_lengths
    positions, rotations = kernel_input(pose.position, n, 3), kernel_input(pose.rotation, n, 3, 3)
    fault, cable, member = cables_at_poses(robot.path_geometry, positions, rotations, *outputs)
    if fault != PATH_EXISTS:
        raise path_error(fault, cable, member, pose)
    return Cables(
        in_batch(lengths, batch),
        in_batch(directions, batch),
        in_batch(arms, batch),
        in_batch(wrench_matrix, batch),
        in_batch(jacobian, batch),
        in_batch(free_lengths, batch),
        pose.position,
    )


def cable_lengths(robot: Robot, pose: Pose) -> FloatArray:
    """Return cable lengths (..., m) alone, m.

    Lengths are continuous wherever they exist. Below an exit point, on its swivel axis, they have no
    derivative, so `inverse_kinematics` raises an error there; this function does not.

    Raises
    ------
    CableReachError
        If an anchor point lies on its exit point or inside its pulley.
    """
    return path_lengths(robot.path_geometry, pose)


def length_accelerations(robot: Robot, pose: Pose, twist: Twist, acceleration: Acceleration) -> FloatArray:
    """Return the second derivatives of the cable lengths, lddot = J [a; alpha] + Jdot [v; omega], (..., m), m/s^2.

    Exact with pulleys too: their swivelling, and the unwinding of what is wrapped around them, is part of Jdot.

    Parameters
    ----------
    robot : Robot
    pose : Pose
    twist : Twist
    acceleration : Acceleration
        Single ones or batches that broadcast against each other.

    Raises
    ------
    InvalidInputError
        If the batch axes do not broadcast.
    CableReachError
        If a cable has no path or no direction, as in `inverse_kinematics`.
    """
    batch, (positions, rotations, twists, accelerations) = motion_arrays(pose, twist, acceleration)
    result = np.empty((math.prod(batch), robot.number_of_cables))
    fault, cable, member = length_accelerations_of_motions(
        robot.path_geometry, positions, rotations, twists, accelerations, result
    )
    if fault != PATH_EXISTS:
        poses = Pose.trusted(positions.reshape(*batch, 3), rotations.reshape(*batch, 3, 3))
        raise path_error(fault, cable, member, poses)
    return in_batch(result, batch)
