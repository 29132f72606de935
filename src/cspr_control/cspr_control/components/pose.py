"""The estimation of the platform's pose from the motor angles, as a component of the graph."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from cspr_control.components.component import NOTHING, Component, Outputs, Publication
from cspr_kinematics import ForwardKinematicsError, KinematicsError, Pose, Robot, forward_kinematics
from cspr_msgs_py.topics import MOTOR_STATES, PLATFORM_POSE, Topic
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.cdr import NANOSECONDS
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import PoseSample, Status


class PoseComponent(Component):
    """Publishes the pose for every n-th motor state, so that poses come at ``rate``.

    Forward kinematics starts from the pose found before: the platform moves little between two estimates, so that a
    step or two of the iteration suffice. When no pose is found from there, the home pose is tried once.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    rate
        Hz.
    period
        Of the control cycle, s.

    Attributes
    ----------
    failures
        Number of estimates for which no pose was found.
    """

    inputs: ClassVar[tuple[Topic, ...]] = (MOTOR_STATES,)

    def __init__(self, robot: Robot, rate: float, period: float) -> None:
        super().__init__("pose_estimator", PLATFORM_POSE)
        # Half a cycle less than the interval: jitter of the stamps must not push a pose to the next state.
        self._interval = round((1.0 / rate - 0.5 * period) * NANOSECONDS)
        self.failures = 0
        self._robot = robot
        self._newest = robot.home
        self._stamp = 0
        self._published = 0
        self._published_reported = 0
        # The first computation is slower than the others; it must not fall into a control cycle.
        self.estimate(robot.winch.motor_angle(robot.winch.home_lengths))

    def estimate(self, motor_angles: ArrayLike) -> Pose:
        """Return the pose at which the cables have the lengths that the motor angles tell.

        Parameters
        ----------
        motor_angles
            (m,) rad, zero at the home pose.

        Raises
        ------
        cspr_kinematics.KinematicsError
            If the angles are not m finite numbers (`InvalidInputError`), or no pose fits them
            (`ForwardKinematicsError`). The next estimate starts from the last pose found.
        """
        lengths = self._robot.winch.cable_lengths(np.asarray(motor_angles, dtype=float))
        try:
            self._newest = forward_kinematics(self._robot, lengths, self._newest)
        except ForwardKinematicsError:
            try:
                self._newest = forward_kinematics(self._robot, lengths, self._robot.home)
            except ForwardKinematicsError:
                self.failures += 1
                raise
        return self._newest

    def on_motor_states(self, now: float, sample: JointStateSample) -> Outputs:
        """Return the pose at the time of the state, when one is due."""
        if 0 <= sample.stamp_ns - self._stamp < self._interval:
            return NOTHING
        self._stamp = sample.stamp_ns
        try:
            pose = self.estimate(sample.position)
        except KinematicsError as error:
            self.problem = str(error)
            return NOTHING
        self.problem = ""
        self._published += 1
        return (Publication(PLATFORM_POSE, PoseSample(sample.stamp_ns, pose.position, pose.quaternion)),)

    def status(self, now: float) -> Status:
        """Return whether poses are found, and if not, why."""
        level, text = Level.OK, "estimating"
        if self.problem:
            level, text = Level.ERROR, self.problem
        elif self._published == self._published_reported:
            level, text = Level.STALE, "no motor states"
        self._published_reported = self._published
        values = {
            "poses": self._published,
            "failures": self.failures,
            "unreadable_messages": self.unusable,
        }
        return self._status(level, text, values)
