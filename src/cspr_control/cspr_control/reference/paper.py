"""The test trajectories of the paper, eqs. 18 and 19, as printed.

Both start at full speed and change velocity at the switch between their two parts, where the acceleration is
not defined: the value of the first part holds at the switch itself. Eq. 19 is eq. 18 in half the time, term by
term. The orientation is level; the tilted variant of eq. 19 turns by 5 degrees about x and y.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cspr_control.reference.quintic import Reals, quintic, within
from cspr_kinematics import Motion, motion_from_euler
from cspr_msgs_py.vocabulary import TrajectoryName

TILT = math.radians(5.0)
"""Rotation about x and about y of the tilted variant, rad."""
SWITCH, DURATION = 10.0, 20.0  # s, of eq. 18

_MILLIMETRE = 1e-3
_Point = tuple[float, float, float]


def equation_18(t: float) -> tuple[_Point, _Point, _Point]:
    """Position (mm), velocity (mm/s) and acceleration (mm/s^2) of eq. 18 at time t (s), about the centre."""
    if t <= SWITCH:
        return (
            (20.0 * (5.0 - t) ** 2, 60.0 * (5.0 - t), 20.0 * t),
            (-40.0 * (5.0 - t), -60.0, 20.0),
            (40.0, 0.0, 0.0),
        )
    return (
        (500.0 - 10.0 * (t - SWITCH), -300.0 + 20.0 * (t - SWITCH), 200.0 - 10.0 * (t - SWITCH)),
        (-10.0, 20.0, -10.0),
        (0.0, 0.0, 0.0),
    )


class PaperTrajectory:
    """Eq. 18 or eq. 19 about a centre, level or tilted.

    How the tilt runs in time is not in the paper. Here beta (about y) and gamma (about x) of eq. 4 rise
    together from zero to ``tilt`` along a quintic over the first part and fall back along the same quintic
    over the second. The tilt is therefore full at the switch, where the angular velocity and acceleration are
    zero, and both are continuous everywhere.

    Parameters
    ----------
    name
        Name under which the trajectory is reported.
    pace
        How many times as fast as eq. 18: 1, or 2 for eq. 19.
    center
        Point (3,) in base that the equations' coordinates refer to, m.
    tilt
        Largest rotation about x and about y, rad.
    """

    def __init__(self, name: str, pace: float, center: NDArray[np.float64], tilt: float = 0.0) -> None:
        self.name = name
        self.switch_time = SWITCH / pace
        self.duration = DURATION / pace
        self._pace = pace
        self._center = np.array(center, dtype=float)
        self._tilt = tilt

    def sample(self, time: Reals) -> Motion:
        """Return the reference at ``time``, s; times outside [0, duration] count as the nearer end."""
        time = within(time, 0.0, self.duration)
        pace = self._pace
        if isinstance(time, np.ndarray):
            values = np.array([equation_18(t) for t in (pace * time).tolist()]).swapaxes(0, 1)
        else:
            values = np.array(equation_18(pace * time))
        position, velocity, acceleration = values * _MILLIMETRE
        part = time / self.switch_time
        tilt = self._tilt * np.subtract(quintic(part), quintic(part - 1.0))
        tilt = (tilt.T / self.switch_time ** np.arange(3)).T
        turning = tilt[..., None] * (0.0, 1.0, 1.0)  # and its two derivatives
        return motion_from_euler(self._center + position, pace * velocity, pace**2 * acceleration, *turning)


def paper_18(center: NDArray[np.float64]) -> PaperTrajectory:
    """Eq. 18: 20 s, level."""
    return PaperTrajectory(TrajectoryName.PAPER_18, 1.0, center)


def paper_19(center: NDArray[np.float64]) -> PaperTrajectory:
    """Eq. 19: the distance of eq. 18 in half the time, level."""
    return PaperTrajectory(TrajectoryName.PAPER_19, 2.0, center)


def paper_19_tilt(center: NDArray[np.float64]) -> PaperTrajectory:
    """Eq. 19 with 5 degrees about x and y."""
    return PaperTrajectory(TrajectoryName.PAPER_19_TILT, 2.0, center, TILT)
