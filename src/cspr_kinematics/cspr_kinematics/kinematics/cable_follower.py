"""Pose and pull of the cables from one cycle to the next, at the cost of one compiled call."""

from __future__ import annotations

import math

import numpy as np

from cspr_kinematics.arrays import FloatArray, frozen
from cspr_kinematics.dynamics._dynamics import GRAVITY_Z
from cspr_kinematics.kinematics._cable_follower import follow_cables
from cspr_kinematics.kinematics.pose_search import pose_search
from cspr_kinematics.motion.pose import Pose
from cspr_kinematics.robot.robot import Robot

_ITERATIONS = 20  # a step or two suffice between two cycles


class CableFollower:
    """Follows the platform by motor angles and cable tensions of the same instants.

    The pose is that of `forward_kinematics` of stretched cables, found from the pose before. All results are this
    object's own, and change with the next call. Cables that damp stretch later than they pull: a tension is
    t = e + T de/dt, with T their `damping_time`, and the stretch that of e.

    Parameters
    ----------
    robot
        With pulleys, stretch and weight of the cables.

    Attributes
    ----------
    position, rotation
        Where the platform is (3,), (3, 3).
    misfit
        Largest difference between the length of a cable and its path at the pose, m; infinite where none was found.
    lengths, errors
        Of the cables (m,), stretch included, and their paths less these, m; errors of no account where the misfit is
        infinite.
    wrench
        What the cables pull on the platform (6,), their own weight taken off, about its origin in base, N and N m.
    jacobian
        J (m, 6), so that A = -J^T.
    """

    def __init__(self, robot: Robot) -> None:
        m = robot.number_of_cables
        self._robot = robot
        self.misfit = math.inf
        self.position, self.rotation = np.empty(3), np.empty((3, 3))
        self.wrench, self.jacobian = np.zeros(6), np.zeros((m, 6))
        self.lengths, self.errors = np.zeros((2, m))
        self.begin_at(robot.home)
        self._accepted = pose_search(robot).tolerance
        cables = robot.cables
        self._constants = (
            robot.path_geometry,
            cables.axial_stiffness,
            cables.dead_length,
            cables.damping_time,
            frozen(-0.5 * GRAVITY_Z * cables.mass_per_metre),
            self._accepted.weights,
        )
        self._free, self._tensions = np.zeros(m), np.zeros(m)
        self._before, self._elastic = np.zeros(m), np.zeros(m)
        self._scratch = np.zeros((3, 3))
        self._rope = np.zeros((1, m)), np.zeros((1, m, 3)), np.zeros((1, m, 3)), np.zeros((1, 6))

    def begin_at(self, pose: Pose) -> None:
        """Look for the next pose from another one."""
        self.position[:], self.rotation[:] = pose.position, pose.rotation

    def follow(self, motor_angles: FloatArray, tensions: FloatArray, step: float = math.inf) -> bool:
        """Find pose and pull; return whether a pose fits as well as `Robot.length_uncertainty` explains, else stay.

        Parameters
        ----------
        motor_angles, tensions
            (m,) each, finite, rad and N.
        step
            Since the last call, s; infinite if nothing is known of it: cables then stretch as at rest.
        """
        robot = self._robot
        np.multiply(motor_angles, robot.winch.transmission_ratio, out=self._free)
        self._free += robot.home_free_lengths
        self._tensions[:] = tensions
        before = self.position.copy(), self.rotation.copy()
        self.misfit, cost = follow_cables(
            step, self._free, self._tensions, *self._constants, self._before, self._elastic, _ITERATIONS,
            self.lengths, self.position, self.rotation, self._scratch, self.errors, self.jacobian, *self._rope,
            self.wrench,
        )  # fmt: skip
        if not cost <= self._accepted.limits[-1]:
            self.position[:], self.rotation[:] = before
            return False
        return True
