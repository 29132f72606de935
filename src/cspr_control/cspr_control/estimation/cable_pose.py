"""The platform's pose from motor angles and cable tensions (docs/model.md, sections 4b and 5)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_kinematics import InvalidInputError, Pose, Robot, forward_kinematics, solve_forward_kinematics


class CablePose:
    """Forward kinematics of cables that stretch, from one instant to the next.

    It starts from the pose found before: the platform moves little between two instants, so that a step or two of the
    iteration suffice. When no pose is found from there, the home pose is tried once.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.

    Attributes
    ----------
    pose
        The newest pose that was found; the home pose before the first.
    misfit
        Largest difference between the length of a cable and its length at `pose`, m; not-a-number where none was
        found. Grows with what the robot's description does not know: pulleys, points, stretch, slack.
    lengths, errors
        The newest lengths that were told (m,), stretch included, m; and their errors at `pose`, of no account where
        none was found.
    tensions
        The newest ones that were given (m,), N, under which cables stretch where none are; those of the home pose
        before the first.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self.pose = robot.home
        self.misfit = math.nan
        self.lengths = robot.winch.home_lengths
        self.errors: NDArray[np.float64] = np.zeros(robot.number_of_cables)
        self.tensions: NDArray[np.float64] | None = robot.home_tensions if robot.cables.stretch else None

    def estimate(self, motor_angles: ArrayLike, tensions: ArrayLike | None = None) -> Pose:
        """Return the pose at which the cables have the lengths that angles and tensions tell.

        Parameters
        ----------
        motor_angles
            (m,) rad, zero at the home pose.
        tensions
            Measured at the same instant, (m,), N; None for the last ones. What is below zero, as a slack cable may
            show, stretches nothing.

        Raises
        ------
        cspr_kinematics.KinematicsError
            If there are not m finite numbers (`InvalidInputError`), or no pose fits them (`ForwardKinematicsError`).
            The next estimate starts from the last pose found.
        """
        robot = self._robot
        if tensions is not None and robot.cables.stretch:
            measured = np.asarray(tensions, dtype=float)
            if measured.shape != (robot.number_of_cables,) or not np.isfinite(measured).all():
                raise InvalidInputError("tensions", tensions, f"not {robot.number_of_cables} finite numbers")
            self.tensions = np.maximum(measured, 0.0)
        self.lengths = lengths = robot.cable_lengths(motor_angles, self.tensions)
        self.misfit = math.nan
        for guess in (self.pose, robot.home):
            solution = solve_forward_kinematics(robot, lengths, guess)
            if solution.converged:
                self.pose, self.errors = solution.pose, solution.residual
                self.misfit = float(np.abs(self.errors).max())
                return self.pose
        return forward_kinematics(robot, lengths, robot.home)  # says why there is none
