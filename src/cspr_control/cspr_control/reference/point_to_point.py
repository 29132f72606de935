"""Straight motion between two poses, from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial.transform import Rotation

from cspr_control.errors import SettingError
from cspr_control.reference.quintic import Reals, quintic, quintic_duration
from cspr_kinematics import Acceleration, Motion, Pose, Robot, Twist
from cspr_msgs_py.vocabulary import TrajectoryName

APPROACH = "approach"
"""Name of the motion that leads to the begin of a trajectory."""

_SHORTEST = 1e-9  # s, of a motion between two poses that are the same


@dataclass(frozen=True)
class MotionLimits:
    """Limits of a point-to-point motion.

    Attributes
    ----------
    speed, acceleration
        Linear, m/s and m/s^2.
    angular_speed, angular_acceleration
        rad/s and rad/s^2.
    """

    speed: float
    acceleration: float
    angular_speed: float
    angular_acceleration: float

    @classmethod
    def of_winches(cls, robot: Robot) -> MotionLimits:
        """Return those of a cable: a platform that is faster asks more of a winch than it has, but along few paths."""
        motor, ratio = robot.motor, robot.winch.transmission_ratio
        arm = float(np.linalg.norm(robot.anchor_points, axis=1).max())
        speed, acceleration = ratio * motor.speed_limit, ratio * motor.torque_limit / motor.inertia
        return cls(speed, acceleration, speed / arm, acceleration / arm)

    def require_possible(self, robot: Robot) -> None:
        """Refuse limits beyond those of the winches; raises SettingError with the bound and why."""
        largest, motor = MotionLimits.of_winches(robot), robot.motor
        for field in fields(self):
            value, bound = getattr(self, field.name), getattr(largest, field.name)
            if value <= bound:
                continue
            why = f"speed_limit = {motor.speed_limit:g} rad/s of {robot.name}'s motors lets a cable run no faster"
            if "acceleration" in field.name:
                why = (
                    f"torque_limit = {motor.torque_limit:g} N m of {robot.name}'s motors accelerates the inertia of a "
                    f"winch, {motor.inertia:g} kg m^2, no faster"
                )
            turn = " at the outermost anchor point" if field.name.startswith("angular") else ""
            raise SettingError(f"{field.name} is {value:g}; it must be at most {bound:.3g}: {why}{turn}")

    def slowed(self, speed: float) -> MotionLimits:
        """Return limits of at most a linear speed, m/s, with the angular one smaller by as much."""
        share = min(1.0, speed / self.speed)
        return replace(self, speed=share * self.speed, angular_speed=share * self.angular_speed)


class PointToPoint:
    """Quintic motion along a straight line and about a fixed axis.

    The position runs along the line between the two, the rotation about the one axis that leads from the
    first to the second; both follow the same quintic, so that angular velocity and acceleration point along
    that axis. The duration is the shortest that keeps every limit.

    Parameters
    ----------
    start, goal
        The two poses.
    limits
        Speed and acceleration limits.
    name
        Name under which the trajectory is reported.
    """

    def __init__(
        self, start: Pose, goal: Pose, limits: MotionLimits, name: str = TrajectoryName.MOVE
    ) -> None:
        self.name = name
        self._start = start
        self._goal = goal
        self._line = goal.position - start.position
        self._turn = Rotation.from_matrix(goal.rotation @ start.rotation.T).as_rotvec()  # base axes, rad
        self.duration = max(
            quintic_duration(float(np.linalg.norm(self._line)), limits.speed, limits.acceleration),
            quintic_duration(
                float(np.linalg.norm(self._turn)), limits.angular_speed, limits.angular_acceleration
            ),
        )

    def sample(self, time: Reals) -> Motion:
        """Return the reference at ``time``, s; times outside [0, duration] count as the nearer end."""
        if not isinstance(time, np.ndarray) and time >= self.duration:
            return Motion.at_rest(self._goal)
        duration = max(self.duration, _SHORTEST)
        value, first, second = quintic(time / duration)
        rate, acceleration = first / duration, second / duration**2
        times = np.multiply.outer
        rotation = Rotation.from_rotvec(times(value, self._turn)).as_matrix() @ self._start.rotation
        return Motion(
            Pose.trusted(self._start.position + times(value, self._line), rotation),
            Twist(times(rate, self._line), times(rate, self._turn)),
            Acceleration(times(acceleration, self._line), times(acceleration, self._turn)),
        )
