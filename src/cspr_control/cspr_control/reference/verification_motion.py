"""The motion of a verification: a little to and fro along each axis, slowly."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from cspr_control.errors import TrajectoryError
from cspr_control.reference.motion_check import require_possible
from cspr_control.reference.point_to_point import MotionLimits, PointToPoint
from cspr_control.reference.quintic import Reals, within
from cspr_kinematics import Acceleration, Motion, Pose, Robot, Twist, way_outside

REACH = 0.05
"""How far it goes each way, m."""
LIMITS = MotionLimits(speed=0.05, acceleration=0.1, angular_speed=0.1, angular_acceleration=0.2)


class VerificationMotion:
    """From the present pose by `REACH` each way along z, x and y, level or tilted as it is, and back.

    Each place is passed in both directions, so that friction averages out. At a bound of the workspace all of it is
    moved inside.

    Parameters
    ----------
    robot
        Gives the workspace.
    present
        Where it begins and ends.

    Raises
    ------
    TrajectoryError
        If the platform is outside of the workspace, or cannot move there: `require_possible`.
    """

    name = "verification"

    def __init__(self, robot: Robot, present: Pose) -> None:
        low, high = robot.workspace_min, robot.workspace_max
        if way_outside(present.position, low, high).any():
            raise TrajectoryError(
                f"the platform is at {np.round(present.position, 3).tolist()} m, outside of the workspace"
            )
        here = present.position
        middle = np.clip(here, low + REACH, high - REACH)
        stops = [here]
        for axis in (2, 0, 1):
            stops += [np.clip(middle + way * REACH * np.eye(3)[axis], low, high) for way in (1.0, -1.0, 0.0)]
        stops.append(here)
        self._rotation = present.rotation
        poses = [Pose(stop, present.rotation) for stop in stops]
        self._parts = [PointToPoint(a, b, LIMITS) for a, b in pairwise(poses)]
        self._ends = np.cumsum([part.duration for part in self._parts])
        self.duration = float(self._ends[-1])
        require_possible(self, robot)

    def sample(self, time: Reals) -> Motion:
        """Return the reference at ``time``, s; times outside [0, duration] count as the nearer end."""
        if isinstance(time, np.ndarray):
            each = [self.sample(moment) for moment in time.tolist()]
            return Motion(
                Pose(np.array([motion.pose.position for motion in each]), self._rotation),
                Twist(np.array([motion.twist.linear for motion in each]), np.zeros(3)),
                Acceleration(np.array([motion.acceleration.linear for motion in each]), np.zeros(3)),
            )
        place = min(int(np.searchsorted(self._ends, time, side="right")), len(self._parts) - 1)
        begin = float(self._ends[place - 1]) if place else 0.0
        return self._parts[place].sample(within(time - begin, 0.0, self._parts[place].duration))
