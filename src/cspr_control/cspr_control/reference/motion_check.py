"""Whether the robot can do a motion, checked whole before it begins: where it leads, and what it asks of motors."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_control.errors import TrajectoryError
from cspr_control.reference.trajectory import Trajectory
from cspr_kinematics import (
    Interference,
    Motion,
    Pose,
    Robot,
    cable_interference,
    inverse_kinematics,
    length_accelerations,
    turned_outside,
    way_outside,
)

FloatArray = NDArray[np.float64]

CHECK_POINTS = 201
"""At so many points, equally spaced in time, a motion is checked: every 13 mm of 1.4 m at most, so that cables which
cross between two of them come closer than the usual clearance at one."""

_ROUNDING = 1e-9  # of all that is compared, in its unit


def require_possible(trajectory: Trajectory, robot: Robot, *, inward: bool = False) -> None:
    """Refuse a motion that leaves the robot's bounds, brings its cables together, or asks too much of its motors.

    The tensions are not known before: of the torque of a motor, what no tension within its limits makes possible is
    refused.

    Parameters
    ----------
    trajectory, robot
        The two.
    inward
        Whether it may begin outside of the bounds, as long as it goes no further out.

    Raises
    ------
    TrajectoryError
        If one of `CHECK_POINTS` points of the trajectory is none for the robot; says where, when, what, by how much,
        and what would do.
    cspr_kinematics.CableReachError
        If a cable has no path at one of them.
    """
    times = np.linspace(0.0, trajectory.duration, CHECK_POINTS)
    motion = trajectory.sample(times)
    check = _MotionCheck(trajectory, robot, times, motion, inward)
    check.require_inside_workspace()
    check.require_bounded_orientation()
    check.require_clearance()
    check.require_motor_speed()
    check.require_motor_torque()


class _MotionCheck:
    """The checks of one motion, sampled at n times."""

    def __init__(
        self, trajectory: Trajectory, robot: Robot, times: FloatArray, motion: Motion, inward: bool
    ) -> None:
        self._trajectory, self._robot, self._times, self._motion = trajectory, robot, times, motion
        self._inward = inward

    def require_inside_workspace(self) -> None:
        robot = self._robot
        out = way_outside(self._motion.pose.position, robot.workspace_min, robot.workspace_max)
        if (worst := self._worst(out, self._inward)) is None:
            return
        point, axis = worst
        raise self._refusal(
            point,
            f"{1e3 * out[point, axis]:.0f} mm outside {robot.name}'s workspace along {'xyz'[axis]}, which is "
            f"{_vector(robot.workspace_min)} to {_vector(robot.workspace_max)} m{self._lead_back(out)}",
        )

    def require_bounded_orientation(self) -> None:
        low, high = self._robot.orientation_bounds
        out = turned_outside(self._motion.pose.euler, low, high)
        if (worst := self._worst(out, self._inward)) is None:
            return
        point, angle = worst
        raise self._refusal(
            point,
            f"{out[point, angle]:.3f} rad beyond the bounds of {('alpha', 'beta', 'gamma')[angle]}, which are "
            f"{low[angle]:g} to {high[angle]:g} rad (orientation_min and orientation_max of {self._robot.name})"
            f"{self._lead_back(out)}",
        )

    def require_clearance(self) -> None:
        near = cable_interference(self._robot, self._motion.pose)
        clearance = self._robot.cable_clearance
        names = [
            *(f"cable_{i} and cable_{j}" for i, j in near.pairs),
            *(f"cable_{k + 1} and the platform" for k in range(near.platform_distances.shape[1])),
        ]
        needed = np.repeat((clearance, 0.5 * clearance), (len(near.pairs), near.platform_distances.shape[1]))
        out = np.maximum(0.0, needed - _distances(near))
        if (worst := self._worst(out, self._inward)) is None:
            return
        point, which = worst
        distance = needed[which] - out[point, which]
        meet = "pass through each other" if distance <= 0.0 else f"would be {1e3 * distance:.1f} mm apart"
        raise self._refusal(
            point,
            f"{names[which]} {meet}, {1e3 * needed[which]:g} mm are needed (cable_clearance of {self._robot.name})"
            f"{self._lead_back(out)}",
        )

    def require_motor_speed(self) -> None:
        motion, robot = self._motion, self._robot
        rates = np.einsum("nij,nj->ni", inverse_kinematics(robot, motion.pose).jacobian, motion.twist.vector)
        speeds = np.abs(robot.winch.motor_speed(rates))
        limit = robot.motor.speed_limit
        if (worst := self._worst(np.maximum(0.0, speeds - limit))) is None:
            return
        point, motor = worst
        raise self._refusal(
            point,
            f"motor_{motor + 1} would turn at {speeds[point, motor]:.0f} rad/s, its limit is {limit:g} rad/s: "
            f"{_slower(limit / speeds[point, motor])}",
        )

    def require_motor_torque(self) -> None:
        (pose, twist, acceleration), robot = self._motion, self._robot
        motor, winch = robot.motor, robot.winch
        turning = winch.motor_acceleration(length_accelerations(robot, pose, twist, acceleration))
        torques = motor.inertia * turning
        # The tension helps to pay out, and works against what winds in.
        high = motor.torque_limit - winch.motor_torque(robot.tension_max)
        low = -motor.torque_limit - winch.motor_torque(robot.tension_min)
        if (worst := self._worst(np.maximum(0.0, np.maximum(torques - high, low - torques)))) is None:
            return
        point, which = worst
        needed = torques[point, which]
        left = high[which] if needed > 0.0 else -low[which]
        raise self._refusal(
            point,
            f"motor_{which + 1} would need {abs(needed):.1f} N m to accelerate its winch, beside the tension it has at "
            f"most {left:.1f} N m: {_slower(np.sqrt(left / abs(needed)))}",
        )

    def _worst(self, out: FloatArray, inward: bool = False) -> tuple[int, int] | None:
        """Return at which point what is furthest beyond its limits; None where nothing is."""
        allowed = out[0] if inward else 0.0
        beyond = np.where(out <= allowed + _ROUNDING, 0.0, out)
        if not beyond.any():
            return None
        point, which = np.unravel_index(int(beyond.argmax()), beyond.shape)
        return int(point), int(which)

    def _lead_back(self, out: FloatArray) -> str:
        """Return what would do, where something is beyond its bounds."""
        first = int(np.flatnonzero((out > _ROUNDING).any(axis=1))[0])
        if first == 0:
            return "; it begins outside: move leads back, if it goes no further out on the way"
        return f"; up to {self._times[first - 1]:.2f} s, {_place(self._pose(first - 1))}, it would do"

    def _pose(self, point: int) -> Pose:
        pose = self._motion.pose
        return Pose(pose.position[point], pose.rotation[point])

    def _refusal(self, point: int, problem: str) -> TrajectoryError:
        name, duration = self._trajectory.name, self._trajectory.duration
        where = _place(self._pose(point))
        return TrajectoryError(f"{name}: at {self._times[point]:.2f} of {duration:.2f} s, {where}, {problem}")


def _distances(near: Interference) -> FloatArray:
    return np.concatenate((near.pair_distances, near.platform_distances), axis=1)


def _slower(share: np.float64) -> str:
    return f"at {100.0 * share:.0f} % of its pace it would do"


def _place(pose: Pose) -> str:
    return f"at {_vector(pose.position)} m turned by {_vector(pose.euler)} rad"


def _vector(elements: ArrayLike) -> str:
    return "(" + ", ".join(f"{element:z.3f}" for element in np.asarray(elements)) + ")"
