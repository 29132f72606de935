"""Which winch has to be wound in so that the robot can be enabled, while a cable hangs slack."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics import GRAVITY, KinematicsError, Robot, solve_forward_kinematics

FloatArray = NDArray[np.float64]

_OF_NO_ACCOUNT = 1.0  # m, standard deviation of a length that tells nothing
_TAUT = 4.0  # times the lowest tension allowed; beyond it a cable is wound in no further
_LARGEST_SAG = 0.005  # m by which other cables than the one looked at may be too long


def excess_lengths(robot: Robot, motor_angles: FloatArray, tensions: FloatArray) -> FloatArray:
    """Return by how much each slack cable is longer than its path, if it alone is (m,), m.

    The others tell where the platform is, the less the more they sag. Not-a-number where they fit no pose either; zero
    for cables that are taut, and where none is slack.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    motor_angles, tensions
        (m,) each, rad and N. A cable counts as slack below `robot.tension_min`; and, while one does, also where it
        carries less than most: a platform that swings on its cables pulls now at one and now at the other.
    """
    excess = np.zeros(robot.number_of_cables)
    if not (np.isfinite(motor_angles).all() and np.isfinite(tensions).all()):
        return excess
    slack = tensions < robot.tension_min
    if not slack.any():
        return excess
    lengths = robot.cable_lengths(motor_angles, np.maximum(tensions, 0.0))
    across = robot.cables.for_each(robot.number_of_cables).mass_per_metre * GRAVITY[2]
    # a flat parabola is longer than its chord by as much, if the cable is level
    sag = np.minimum(across**2 * lengths**3 / (24.0 * np.maximum(tensions, 1.0) ** 2), _LARGEST_SAG)
    for cable in np.flatnonzero(slack | (tensions < np.median(tensions))):
        deviations = np.hypot(robot.length_deviation, sag)
        deviations[cable] = _OF_NO_ACCOUNT
        try:
            solution = solve_forward_kinematics(robot, lengths, robot.home, length_deviation=deviations)
        except KinematicsError:
            excess[cable] = math.nan
        else:
            excess[cable] = -solution.residual[cable] if solution.converged else math.nan
    return excess


def slack_problem(
    robot: Robot, motor_angles: FloatArray, tensions: FloatArray, behind: FloatArray, allowed: float
) -> str:
    """Return which cable has to be wound in, by how much and how, before the robot can be enabled; else nothing.

    Parameters
    ----------
    robot, motor_angles, tensions
        As for `excess_lengths`.
    behind
        How far each motor was from its set-point when that was known (m,), rad: of several slack cables, any of which
        would explain the lengths, it is the one whose motor was furthest behind.
    allowed
        Angle, rad, by which a motor may be from where it should be.
    """
    excess = excess_lengths(robot, motor_angles, tensions)
    slack = tensions < robot.tension_min
    long = (excess > allowed * robot.winch.transmission_ratio) | (slack & np.isnan(excess))
    if not long.any():
        return ""
    taut = tensions > _TAUT * robot.tension_min  # winding it in would not end what another one shows
    first = min(np.flatnonzero(long).tolist(), key=lambda k: (taut[k], behind[k], tensions[k]))
    others = [k for k in np.flatnonzero(long & slack) if k != first]
    too_long = f" and is {1e3 * excess[first]:.0f} mm too long" if math.isfinite(excess[first]) else ""
    also = "".join(f", cable_{k + 1} {tensions[k]:z.0f} N" for k in others)
    return (
        f"cable_{first + 1} carries {tensions[first]:z.0f} N{too_long}{also}: call "
        f"/can_drives/motor_{first + 1}/wind_in, which winds for a moment, until it is taut"
    )
