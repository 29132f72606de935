"""The tension of each cable as its own motor knows it: from torque, inertia and friction, without a load cell."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspr_control.estimation._cells import tensions_of_motors
from cspr_kinematics import Robot

FloatArray = NDArray[np.float64]

_UNMODELLED = 8.0  # N; standard deviation of what neither friction nor inertia explain
_INERTIA_ERROR = 0.05  # share of the inertia that is uncertain
_FRICTION_SPEED = 1.0  # rad/s of the motor above which the direction of friction is known


class MotorView(NamedTuple):
    """Tensions (m,) as the motors know them, N, and their variances (m,), N^2."""

    tensions: FloatArray
    variance: FloatArray


class MotorTensions:
    """Balance of each motor's shaft: ``J qddot = tau + r t - friction``, solved for the tension t.

    Speed and acceleration are differences of three angles, over periods as they were, and so belong to the middle one;
    the torque is weighted as the second difference weights the motion between them. At rest the sign of dry friction is
    not known: the variance says so.

    Parameters
    ----------
    robot
        Inertia, friction and transmission ratio r.
    """

    def __init__(self, robot: Robot) -> None:
        motor = robot.motor
        self._constants = (
            robot.winch.transmission_ratio,
            motor.inertia,
            motor.coulomb_friction,
            motor.viscous_friction,
            _FRICTION_SPEED,
            _INERTIA_ERROR,
            _UNMODELLED,
        )
        self._angles, self._torques = np.zeros((2, 3, robot.number_of_cables))
        self._cycles = 0
        self._before = math.nan  # the period before, s

    def clear(self) -> None:
        """Begin anew after a gap."""
        self._cycles = 0

    def update(self, angles: FloatArray, torques: FloatArray, period: float) -> MotorView | None:
        """Return the tensions one cycle ago; None before the third cycle.

        Parameters
        ----------
        angles, torques
            Measured (m,), rad and N m.
        period
            Since the last call, s.
        """
        for memory, newest in ((self._angles, angles), (self._torques, torques)):
            memory[:-1] = memory[1:]
            memory[-1] = newest
        self._cycles += 1
        before, self._before = self._before, period
        if self._cycles < 3:
            return None
        result = np.empty((2, len(angles)))
        tensions_of_motors(before, period, *self._constants, self._angles, self._torques, result)
        return MotorView(result[0], result[1])
