"""The estimation of the platform's pose from motor angles and cable tensions, as a component of the graph."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cspr_control.components.component import NOTHING, Component, Outputs, Publication
from cspr_control.estimation.cable_pose import CablePose
from cspr_control.estimation.length_misfit import LengthMisfit
from cspr_control.estimation.sync_pairs import SyncPair, SyncPairs
from cspr_kinematics import KinematicsError, Robot
from cspr_msgs_py.topics import CABLE_TENSIONS, MOTOR_STATES, PLATFORM_POSE, Topic
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.cdr import NANOSECONDS
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import PoseSample, Status

_TENSIONS_TIMEOUT = 0.1
"""Age of the newest tensions from which a pose does not wait for those of its own instant, s."""


class PoseComponent(Component):
    """Publishes the pose for every n-th motor state, so that poses come at ``rate``.

    Cables stretch under the tensions of the same SYNC. A pose waits for them, but not beyond the next motor state, and
    not at all when none have come for a while: then the last ones count, or before the first those of the home pose.
    That costs 3 mm under 200 kg, and is a warning.

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

    inputs: ClassVar[tuple[Topic, ...]] = (MOTOR_STATES, CABLE_TENSIONS)

    def __init__(self, robot: Robot, rate: float, period: float) -> None:
        super().__init__("pose_estimator", PLATFORM_POSE)
        # Half a cycle less than the interval: jitter of the stamps must not push a pose to the next state.
        self._interval = round((1.0 / rate - 0.5 * period) * NANOSECONDS)
        self.failures = 0
        self._robot = robot
        self._estimation = CablePose(robot)
        self._misfit = LengthMisfit(robot)
        self._pairs = SyncPairs()
        self._waiting: JointStateSample | None = (
            None  # the state whose pose is due, and whose tensions are not there
        )
        self._stamp = 0  # of the newest state for which a pose was due
        self._tensions_stamp: int | None = None
        self._without_tensions = 0
        self._without_tensions_reported = 0
        self._published = 0
        self._published_reported = 0
        # The first computation is slower than the others; it must not fall into a control cycle.
        self._estimation.estimate(np.zeros(robot.number_of_cables))

    def on_motor_states(self, now: float, sample: JointStateSample) -> Outputs:
        """Return the pose at the time of the state, when one is due and its tensions are known or do not count."""
        late: Outputs = NOTHING
        if self._waiting is not None:
            late = self._pose(self._waiting.stamp_ns, self._waiting.position, None)
        pair = self._pairs.motors(sample)
        if 0 <= sample.stamp_ns - self._stamp < self._interval:
            return late
        self._stamp = sample.stamp_ns
        if pair is not None:
            return (*late, *self._pose(pair.stamp, pair.motor_angles, pair.tensions))
        if self._tensions_expected(sample.stamp_ns):
            self._waiting = sample
            return late
        return (*late, *self._pose(sample.stamp_ns, sample.position, None))

    def on_cable_tensions(self, now: float, sample: JointStateSample) -> Outputs:
        """Return the pose that waited for these tensions."""
        if not self._robot.cables.stretch:
            return NOTHING
        self._tensions_stamp = sample.stamp_ns
        pair: SyncPair | None = self._pairs.tensions(sample.stamp_ns, sample.effort)
        if pair is None or self._waiting is None or self._waiting.stamp_ns != pair.stamp:
            return NOTHING
        return self._pose(pair.stamp, pair.motor_angles, pair.tensions)

    def _tensions_expected(self, stamp: int) -> bool:
        newest = self._tensions_stamp
        return newest is not None and abs(stamp - newest) <= _TENSIONS_TIMEOUT * NANOSECONDS

    def _pose(self, stamp: int, angles: NDArray[np.float64], tensions: NDArray[np.float64] | None) -> Outputs:
        self._waiting = None
        self._without_tensions += tensions is None and self._robot.cables.stretch
        try:
            pose = self._estimation.estimate(angles, tensions)
        except KinematicsError as error:
            self.failures += 1
            self.problem = str(error)
            return NOTHING
        self._misfit.observe(self._estimation.lengths, self._estimation.errors)
        self.problem = ""
        self._published += 1
        return (Publication(PLATFORM_POSE, PoseSample(stamp, pose.position, pose.quaternion)),)

    def status(self, now: float) -> Status:
        """Return whether poses are found, and if not, why; and what they rest on."""
        level, text = Level.OK, "estimating"
        slack = self._slack_cables()
        if self.problem:
            level, text = Level.ERROR, self.problem
        elif self._published == self._published_reported:
            level, text = Level.STALE, "no motor states"
        elif self._misfit.problem:
            level, text = Level.WARN, self._misfit.problem
        elif self._without_tensions > self._without_tensions_reported:
            level = Level.WARN
            last = "of the home pose" if self._tensions_stamp is None else "measured last"
            text = f"no cable tensions for some motor states: cables count as stretched by those {last}"
        elif slack:
            level, text = Level.WARN, f"below tension_min, so that it may be slack: {', '.join(slack)}"
        self._published_reported = self._published
        self._without_tensions_reported = self._without_tensions
        misfit = self._estimation.misfit
        values = {
            "poses": self._published,
            "failures": self.failures,
            "poses_without_tensions": self._without_tensions,
            "length_misfit": "" if math.isnan(misfit) else f"{misfit:.6f}",
            "length_misfit_rms": f"{self._misfit.rms:.6f}" if self._misfit.places else "",
            "unreadable_messages": self.unusable,
        }
        return self._status(level, text, values)

    def _slack_cables(self) -> list[str]:
        tensions = self._estimation.tensions
        if tensions is None or self._tensions_stamp is None:
            return []
        return [f"cable_{i + 1}" for i in np.flatnonzero(tensions < self._robot.tension_min)]
