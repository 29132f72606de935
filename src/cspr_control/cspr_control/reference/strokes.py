"""Strokes up and down, which shake the platform as no trajectory of the paper does."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspr_control.reference.quintic import Reals, quintic, quintic_duration, within
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

    def sample(self, time: Reals) -> Motion:
        """Return the reference at ``time``, s; times outside [0, duration] count as the nearer end."""
        if isinstance(time, np.ndarray):
            height, rate, acceleration = np.array([self._stroke_at(t) for t in time.tolist()]).T
        else:
            height, rate, acceleration = self._stroke_at(time)
        times = np.multiply.outer
        return Motion(
            Pose(self._center + times(height, _UP), np.eye(3)),
            Twist(times(rate, _UP), np.zeros(3)),
            Acceleration(times(acceleration, _UP), np.zeros(3)),
        )

    def _stroke_at(self, time: float) -> tuple[float, float, float]:
        """Return height above the centre, m, speed and acceleration upwards."""
        time = within(time, 0.0, self.duration)
        number = min(int(time / self._stroke), STROKES - 1)
        value, first, second = quintic(time / self._stroke - number)
        along = LENGTH if number % 2 == 0 else -LENGTH
        return (value - 0.5) * along, first / self._stroke * along, second / self._stroke**2 * along
