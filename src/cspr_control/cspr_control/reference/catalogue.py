"""The trajectories by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_control.errors import TrajectoryError
from cspr_control.reference.motion_check import require_possible
from cspr_control.reference.paper import PaperTrajectory, paper_18, paper_19, paper_19_tilt
from cspr_control.reference.point_to_point import APPROACH, MotionLimits, PointToPoint
from cspr_control.reference.smooth import SmoothTrajectory
from cspr_control.reference.strokes import VerticalStrokes
from cspr_control.reference.trajectory import Hold, Trajectory
from cspr_kinematics import Pose, Robot, turned_outside, way_outside
from cspr_msgs_py.parameters.table import defaults
from cspr_msgs_py.vocabulary import TrajectoryName

_DEFAULT = defaults("trajectory_publisher")

INWARD_SPEED = 0.05
"""Largest speed of a ``move`` that begins outside of the workspace, m/s."""


@dataclass(frozen=True)
class TrajectorySettings:
    """Settings of the player, and of the trajectories that it plays.

    Attributes
    ----------
    name
        What the next start plays.
    limits
        Limits of `PointToPoint` motions.
    goal
        Where ``move`` leads.
    blend_time, hold_duration, dwell, stop_time, max_gap, supervision_timeout
        In s, see `cspr_msgs_py.parameters.table`.
    """

    name: TrajectoryName
    limits: MotionLimits
    goal: Pose
    blend_time: float = _DEFAULT["blend_time"]
    hold_duration: float = _DEFAULT["hold_duration"]
    dwell: float = _DEFAULT["dwell"]
    stop_time: float = _DEFAULT["stop_time"]
    max_gap: float = _DEFAULT["max_gap"]
    supervision_timeout: float = _DEFAULT["supervision_timeout"]


_PRINTED: dict[TrajectoryName, Callable[[NDArray[np.float64]], PaperTrajectory]] = {
    TrajectoryName.PAPER_18: paper_18,
    TrajectoryName.PAPER_19: paper_19,
    TrajectoryName.PAPER_19_TILT: paper_19_tilt,
}
_SMOOTH = {
    TrajectoryName.SMOOTH_18: TrajectoryName.PAPER_18,
    TrajectoryName.SMOOTH_19: TrajectoryName.PAPER_19,
    TrajectoryName.SMOOTH_19_TILT: TrajectoryName.PAPER_19_TILT,
}


def make_trajectory(
    name: TrajectoryName, robot: Robot, present: Pose, settings: TrajectorySettings
) -> Trajectory:
    """Build a trajectory, and check that the robot can follow it and the approach to it.

    Parameters
    ----------
    name
        Which one, whatever the next start plays by the settings.
    robot
        Gives the centre of the paper's trajectories, and what is possible.
    present
        Pose at which ``hold`` stays, from which ``move`` starts, and the approach to all others.
    settings
        The rest.

    Raises
    ------
    TrajectoryError, cspr_kinematics.CableReachError
        If the settings do not fit, or the robot cannot do it: see `require_possible`. From outside of workspace or
        orientation bounds, or from where cables are too close, ``move`` leads back, slowly: it may go no further out.
    """
    trajectory: Trajectory
    if name is TrajectoryName.HOLD:
        return Hold(present, settings.hold_duration)
    if name is TrajectoryName.MOVE:
        outside = way_outside(present.position, robot.workspace_min, robot.workspace_max).any()
        turned = turned_outside(present.euler, *robot.orientation_bounds).any()
        limits = settings.limits.slowed(INWARD_SPEED) if outside or turned else settings.limits
        trajectory = PointToPoint(present, settings.goal, limits)
        require_possible(trajectory, robot, inward=True)
        return trajectory
    if name is TrajectoryName.STROKES_Z:
        trajectory = VerticalStrokes(robot.trajectory_center)
    elif name in _SMOOTH:
        trajectory = SmoothTrajectory(_PRINTED[_SMOOTH[name]](robot.trajectory_center), settings.blend_time)
    elif name in _PRINTED:
        trajectory = _PRINTED[name](robot.trajectory_center)
    else:
        raise TrajectoryError(f"{name.value} is not in {__name__}, which makes the trajectories")
    approach = PointToPoint(present, trajectory.sample(0.0).pose, settings.limits, APPROACH)
    for each in (approach, trajectory):
        require_possible(each, robot)
    return trajectory
