"""Strokes up and down, which shake the platform as no trajectory of the paper does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspr_control.reference.quintic import quintic, quintic_duration
from cspr_kinematics import Acceleration, Motion, Pose, Twist
from cspr_msgs_py.vocabulary import TrajectoryName

LENGTH = 0.3
"""Of a stroke, m."""
ACCELERATION = 3.0
"""Largest of a stroke, m/s^2."""
STROKES = 12

_UP = np.array([0.0, 0.0, 1.0])


class VerticalStrokes:
    """`STROKES` strokes of `LENGTH` up and down about a centre, level, each along a quintic from rest to rest.

    Parameters
    ----------
    center
        Point (3,) in base at the middle of the strokes, m.
    """

    name = TrajectoryName.STROKES_Z

    def __init__(self, center: NDArray[np.float64]) -> None:
        self._center = np.array(center, dtype=float)
        self._stroke = quintic_duration(LENGTH, np.inf, ACCELERATION)
        self.duration = STROKES * self._stroke

    def sample(self, time: float) -> Motion:
        """Return the reference at ``time``, s; times outside [0, duration] count as the nearer end."""
        time = min(max(time, 0.0), self.duration)
        number = min(int(time / self._stroke), STROKES - 1)
        value, first, second = quintic(time / self._stroke - number)
        along = (LENGTH if number % 2 == 0 else -LENGTH) * _UP
        from_middle = (value - 0.5) * along
        rate, acceleration = first / self._stroke, second / self._stroke**2
        return Motion(
            Pose(self._center + from_middle, np.eye(3)),
            Twist(rate * along, np.zeros(3)),
            Acceleration(acceleration * along, np.zeros(3)),
        )
