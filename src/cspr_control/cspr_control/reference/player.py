"""Playing trajectories one after the other without a jump of the reference."""

from __future__ import annotations

import math

from cspr_control.errors import TrajectoryError
from cspr_control.reference.path_time import slowing_to_rest
from cspr_control.reference.point_to_point import APPROACH, MotionLimits, PointToPoint
from cspr_control.reference.trajectory import Trajectory
from cspr_kinematics import Motion, Pose
from cspr_msgs_py.vocabulary import UNDER_WAY, TrajectoryPhase

SECOND = 1_000_000_000
"""Nanoseconds."""


class TrajectoryPlayer:
    """Reference over time: hold, approach, trajectory, hold.

    Time is ROS time in ns; `start` and `stop` take effect at the time of the newest sample, so that the
    reference goes on from exactly where it was.

    Parameters
    ----------
    limits
        Limits of the approach.
    dwell, stop_time, max_gap
        In s, see `cspr_msgs_py.parameters.table`. After a gap longer than that the reference stays where it was and the
        trajectory is over: the motors heard nothing for that time and could only jump after it.

    Attributes
    ----------
    phase
        What the player is doing.
    trajectory_name
        The trajectory last started, empty before the first.
    start_time, end_time
        When it begins, and when it ends unless it is stopped, ROS time, ns; 0 before the first.
    interruption
        Why the player gave up the trajectory last started; empty if it did not.
    held_pose
        Where the reference rests; while it moves, where it last rested or will come to rest.
    """

    def __init__(self, limits: MotionLimits, dwell: float, stop_time: float, max_gap: float) -> None:
        self.limits = limits
        self.dwell = dwell
        self.stop_time = stop_time
        self.max_gap = max_gap
        self.phase = TrajectoryPhase.IDLE
        self.trajectory_name = ""
        self.start_time = 0
        self.end_time = 0
        self.interruption = ""
        self._time = 0  # of the newest sample
        self._pose: Pose | None = None  # of the newest sample
        self.held_pose: Pose | None = None
        self._followed: Trajectory | None = None  # the approach or the trajectory, while it moves
        self._followed_since = 0
        self._next: Trajectory | None = None  # the trajectory, while it is approached
        self._stop_since = 0
        self._stop_from = 0.0  # path time, s

    @property
    def destination(self) -> Pose | None:
        """Where the motion that is under way ends, as planned; where the reference rests, while it rests."""
        followed = self._next or self._followed
        return self.held_pose if followed is None else followed.sample(followed.duration).pose

    def hold(self, pose: Pose) -> None:
        """Hold a pose from now on, whatever was going on: for a robot that is not enabled."""
        self.held_pose = pose
        self._followed = None
        self._next = None
        self.phase = TrajectoryPhase.HOLD

    def start(self, trajectory: Trajectory) -> None:
        """Approach the start of a trajectory, rest there for the dwell, then run it.

        Raises
        ------
        TrajectoryError
            If no pose is held yet, another trajectory is under way, or the way there has no end.
        """
        if self.held_pose is None or self._pose is None:
            raise TrajectoryError("no pose of the platform is known yet")
        if not self.phase.at_rest:
            raise TrajectoryError(f"{self.trajectory_name} is under way ({self.phase.value}); stop it first")
        begin = trajectory.sample(0.0).pose
        approach = PointToPoint(self.held_pose, begin, self.limits, APPROACH)
        if not math.isfinite(approach.duration + trajectory.duration):
            raise TrajectoryError(f"{trajectory.name} is out of reach of {self.held_pose.position} m")
        self._followed, self._followed_since, self._next = approach, self._time, trajectory
        self.held_pose = begin
        self.trajectory_name = trajectory.name
        self.interruption = ""
        self.start_time = self._time + round((approach.duration + self.dwell) * SECOND)
        self.end_time = self.start_time + round(trajectory.duration * SECOND)
        self.phase = TrajectoryPhase.APPROACH

    def stop(self, interruption: str = "") -> None:
        """Slow down along the path to rest; without effect on a reference at rest. Given why, it is given up."""
        if self.phase not in UNDER_WAY:
            return
        self.interruption = interruption
        self._stop_since = self._time
        self._stop_from = self._elapsed(self._time)
        self._next = None
        self.phase = TrajectoryPhase.STOPPING

    def sample(self, time: int) -> Motion | None:
        """Return the reference at ``time`` (ROS time, ns); None while no pose is known.

        A time a little before the last one counts as that; a longer step back is a clock that was set, and
        ends a motion like a gap.
        """
        if abs(time - self._time) > self.max_gap * SECOND:
            if self._followed is not None and self._pose is not None:
                self.interruption = _gap_text((time - self._time) / SECOND, self.max_gap)
                self.hold(self._pose)
        else:
            time = max(time, self._time)
        self._time = time
        if self.held_pose is None:
            return None
        reference = self._advance(self.held_pose, time)
        self._pose = reference.pose
        return reference

    def _advance(self, held: Pose, time: int) -> Motion:
        if self.phase is TrajectoryPhase.APPROACH and time >= self.start_time:
            self._followed, self._followed_since, self._next = self._next, self.start_time, None
            self.phase = TrajectoryPhase.RUNNING
        if self._followed is None:
            return Motion.at_rest(held)
        if self.phase is TrajectoryPhase.STOPPING:
            return self._sample_stopping(self._followed, time)
        elapsed = self._elapsed(time)
        if elapsed < self._followed.duration:
            return self._followed.sample(elapsed)
        if self.phase is TrajectoryPhase.RUNNING:
            return self._rest(self._followed, self._followed.duration, TrajectoryPhase.FINISHED)
        return Motion.at_rest(held)

    def _elapsed(self, time: int) -> float:
        return (time - self._followed_since) / SECOND

    def _sample_stopping(self, followed: Trajectory, time: int) -> Motion:
        elapsed = (time - self._stop_since) / SECOND
        path_time = slowing_to_rest(elapsed, self._stop_from, self.stop_time)
        if elapsed >= self.stop_time or path_time.value >= followed.duration:
            return self._rest(followed, path_time.value, TrajectoryPhase.HOLD)
        return followed.sample(path_time.value).scaled_in_time(path_time.rate, path_time.acceleration)

    def _rest(self, followed: Trajectory, path_time: float, phase: TrajectoryPhase) -> Motion:
        self.held_pose = followed.sample(path_time).pose
        self._followed = None
        self.phase = phase
        return Motion.at_rest(self.held_pose)


def _gap_text(gap: float, limit: float) -> str:
    if gap < 0.0:
        return f"the clock went back by {-gap:.3f} s"
    return f"no motor states came for {gap:.3f} s, longer than {limit:g} s"
