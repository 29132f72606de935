"""What a trajectory is, and the simplest one."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from cspr_control.errors import TrajectoryError
from cspr_control.reference import ReferencePoint
from cspr_kinematics import Pose, Robot

WORKSPACE_CHECK_STEP = 0.05
"""Spacing in time (s) of the points at which a trajectory is compared with the workspace."""


class Trajectory(Protocol):
    """A motion of the platform over a finite time."""

    @property
    def name(self) -> str:
        """Name under which the trajectory is reported."""

    @property
    def duration(self) -> float:
        """Length in time, s."""

    def sample(self, time: float) -> ReferencePoint:
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

    name = "hold"

    def __init__(self, pose: Pose, duration: float) -> None:
        if not duration >= 0.0:
            raise TrajectoryError(f"hold: the duration is {duration} s; it must not be negative")
        self.duration = duration
        self._point = ReferencePoint.at_rest(pose)

    def sample(self, time: float) -> ReferencePoint:
        """Return the pose, at rest, at any time."""
        return self._point


def require_inside_workspace(trajectory: Trajectory, robot: Robot) -> None:
    """Refuse a trajectory that leaves the robot's workspace.

    Raises
    ------
    TrajectoryError
        If a point of the trajectory, taken every `WORKSPACE_CHECK_STEP` seconds, is not finite or lies
        outside the box ``workspace_min`` to ``workspace_max``.
    """
    steps = max(1, int(np.ceil(trajectory.duration / WORKSPACE_CHECK_STEP)))
    for time in np.linspace(0.0, trajectory.duration, steps + 1):
        position = trajectory.sample(float(time)).pose.position
        inside = (position >= robot.workspace_min) & (position <= robot.workspace_max)
        if not inside.all():
            raise TrajectoryError(
                f"{trajectory.name}: at {time:.2f} s the platform would be at {_metres(position)}, outside "
                f"{robot.name}'s workspace {_metres(robot.workspace_min)} to {_metres(robot.workspace_max)}"
            )


def _metres(position: np.typing.NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{coordinate:.3f}" for coordinate in position) + ") m"
