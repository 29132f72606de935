"""Set-points that allow for the stretch of the cables (docs/model.md, section 4b)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspr_control.motors._stretch import follow, motors_of_stretched_cables
from cspr_kinematics import Robot

Floats = NDArray[np.float64]


class MotorMotion(NamedTuple):
    """Angles (m,), rad, speeds, rad/s, and the accelerations that the stretch alone asks for, rad/s^2."""

    angle: Floats
    speed: Floats
    stretch_acceleration: Floats


class SmoothedStretch:
    """Motor angles at which cables have their lengths under tensions that follow those of the feed-forward smoothly.

    The tensions pass two equal poles, so that a payload that comes aboard moves the set-points without a step in angle
    or speed. They are those of the feed-forward, never measured ones: a motor that gives way to a measured tension
    lowers it, and with all of them the loop diverges. Measured ones only tell the beginning, from where the motors
    are.

    Parameters
    ----------
    robot
        As the controller believes it to be.
    """

    def __init__(self, robot: Robot) -> None:
        cables, winch = robot.cables, robot.winch
        self._begun = False
        self._home_tensions = robot.home_tensions
        self._state = np.zeros((3, robot.number_of_cables))  # tensions and their derivatives, N, N/s, N/s^2
        self._constants = (
            cables.axial_stiffness,
            cables.dead_length,
            robot.home_free_lengths,
            winch.transmission_ratio,
        )

    def rest_at(self, tensions: Floats) -> None:
        """Begin anew at tensions (m,), N, that do not change."""
        self._begun = True
        self._state[0] = tensions
        self._state[1:] = 0.0

    def keep(self) -> None:
        """Stay at the tensions as they are; before any, at those of the home pose."""
        self.rest_at(self._state[0] if self._begun else self._home_tensions)

    def follow(self, tensions: Floats, since: float, time_constant: float) -> None:
        """Go on towards tensions (m,), N, for `since` s, each pole with the time constant, s; begin there if anew."""
        if self._begun:
            follow(tensions, since, time_constant, self._state)
        else:
            self.rest_at(tensions)

    def motors(self, lengths: Floats, length_rates: Floats) -> MotorMotion:
        """Return what the motors must do for lengths (m,), m, that change at rates (m,), m/s."""
        if not self._begun:
            self.keep()
        result = np.empty_like(self._state)
        motors_of_stretched_cables(lengths, length_rates, self._state, *self._constants, result)
        return MotorMotion(*result)
