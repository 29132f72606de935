"""The platform's pose from the motor angles."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics import ForwardKinematicsError, Pose, Robot, forward_kinematics


class PoseEstimator:
    """Forward kinematics that starts from the pose found before.

    The platform moves little between two estimates, so that a step or two of the iteration suffice. When no
    pose is found from there, the home pose is tried once.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.

    Attributes
    ----------
    failures
        Number of estimates for which no pose was found.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._newest = robot.home
        self.failures = 0

    def estimate(self, motor_angles: ArrayLike) -> Pose:
        """Pose at which the cables have the lengths that the motor angles tell.

        Parameters
        ----------
        motor_angles
            (m,) rad, zero at the home pose.

        Raises
        ------
        cspr_kinematics.KinematicsError
            If the angles are not m finite numbers (`InvalidInputError`), or no pose fits them
            (`ForwardKinematicsError`). The next estimate starts from the last pose found.
        """
        lengths = self._robot.winch.cable_lengths(np.asarray(motor_angles, dtype=float))
        try:
            self._newest = forward_kinematics(self._robot, lengths, self._newest)
        except ForwardKinematicsError:
            try:
                self._newest = forward_kinematics(self._robot, lengths, self._robot.home)
            except ForwardKinematicsError:
                self.failures += 1
                raise
        return self._newest
