"""What a trajectory is, and the simplest one."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cspr_control.errors import TrajectoryError
from cspr_kinematics import Motion, Pose, Robot, way_outside
from cspr_msgs_py.vocabulary import TrajectoryName

_ROUNDING = 1e-9  # m

WORKSPACE_CHECK_POINTS = 41
"""Number of points, equally spaced in time, at which a trajectory is compared with the workspace."""


class Trajectory(Protocol):
    """A motion of the platform over a finite time."""

    @property
    def name(self) -> str:
        """Name under which the trajectory is reported."""

    @property
    def duration(self) -> float:
        """Length in time, s."""

    def sample(self, time: float) -> Motion:
        """Return the reference at ``time`` since the start, s; outside [0, duration] at the nearer end."""


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

    def sample(self, time: float) -> Motion:
        """Return the pose, at rest, at any time."""
        return self._point


def require_inside_workspace(trajectory: Trajectory, robot: Robot, *, inward: bool = False) -> None:
    """Refuse a trajectory that leaves the robot's workspace.

    Parameters
    ----------
    trajectory, robot
        The two.
    inward
        Whether it may begin outside, as long as it goes no further out along any axis.

    Raises
    ------
    TrajectoryError
        If one of `WORKSPACE_CHECK_POINTS` points of the trajectory lies outside.
    """
    box = robot.workspace_min, robot.workspace_max
    allowed = way_outside(trajectory.sample(0.0).pose.position, *box) if inward else np.zeros(3)
    for time in np.linspace(0.0, trajectory.duration, WORKSPACE_CHECK_POINTS):
        position = trajectory.sample(float(time)).pose.position
        if not (way_outside(position, *box) <= allowed + _ROUNDING).all():
            raise TrajectoryError(
                f"{trajectory.name}: at {time:.2f} s the platform would be at {_metres(position)}, outside "
                f"{robot.name}'s workspace {_metres(robot.workspace_min)} to {_metres(robot.workspace_max)}"
            )


def _metres(position: np.typing.NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{coordinate:z.3f}" for coordinate in position) + ") m"
