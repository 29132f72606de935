"""What a trajectory is, and the simplest one."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cspr_control.reference.quintic import Reals
from cspr_kinematics import Acceleration, Motion, Pose, Twist
from cspr_msgs_py.vocabulary import TrajectoryName


class Trajectory(Protocol):
    """A motion of the platform over a finite time."""

    @property
    def name(self) -> str:
        """Name under which the trajectory is reported."""

    @property
    def duration(self) -> float:
        """Length in time, s."""

    def sample(self, time: Reals) -> Motion:
        """Return the reference at ``time`` since the start, s; outside [0, duration] at the nearer end.

        At an array of times (n,), a batch of n.
        """


class Hold:
    """Staying at one pose.

    Parameters
    ----------
    pose
        The pose to keep.
    duration
        Length in time, s.
    """

    name = TrajectoryName.HOLD

    def __init__(self, pose: Pose, duration: float) -> None:
        self.duration = duration
        self._point = Motion.at_rest(pose)

    def sample(self, time: Reals) -> Motion:
        """Return the pose, at rest, at any time."""
        if not isinstance(time, np.ndarray):
            return self._point
        pose, still = self._point.pose, np.zeros((len(time), 3))
        position = np.tile(pose.position, (len(time), 1))
        return Motion(Pose(position, pose.rotation), Twist(still, still), Acceleration(still, still))
