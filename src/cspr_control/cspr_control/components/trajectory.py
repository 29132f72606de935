"""The player of trajectories as a component of the graph."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from cspr_control.components.component import NOTHING, Component, Outputs, Publication, Remark
from cspr_control.errors import ControlError, TrajectoryError
from cspr_control.reference.catalogue import TrajectorySettings, make_trajectory
from cspr_control.reference.player import SECOND, TrajectoryPlayer
from cspr_control.reference.trajectory import Trajectory
from cspr_control.reference.verification_motion import VerificationMotion
from cspr_control.supervision.supervisor import Decision
from cspr_kinematics import KinematicsError, Motion, Pose, Robot
from cspr_msgs_py import topics
from cspr_msgs_py.topics import Topic
from cspr_msgs_py.vocabulary import FOLLOWING, UNDER_WAY, Level, RobotState, TrajectoryPhase
from cspr_msgs_py.wire.cdr import LATEST_TIME
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.reference import ReferenceSample
from cspr_msgs_py.wire.samples import PoseSample, SignOfLife, Status


class TrajectoryComponent(Component):
    """Plays the trajectory of the settings, from the command ``start`` on.

    Each motor state is answered with the reference for one control period later. While the robot is not
    enabled the reference stays at the newest measured pose, so that enabling begins without a jump.

    Parameters
    ----------
    robot
        Gives the centre of the paper's trajectories and the workspace.
    settings
        See `TrajectorySettings`; of those replaced with `configure`, dwell, stop_time, max_gap and
        supervision_timeout are not used.
    period
        Of the control cycle, s.
    """

    inputs: ClassVar[tuple[Topic, ...]] = (
        topics.MOTOR_STATES,
        topics.PLATFORM_POSE,
        topics.ROBOT_STATE,
        topics.SUPERVISOR_ALIVE,
    )

    def __init__(self, robot: Robot, settings: TrajectorySettings, period: float) -> None:
        super().__init__("trajectory_publisher", topics.REFERENCE, topics.TRAJECTORY_STATE)
        self.player = TrajectoryPlayer(settings.limits, settings.dwell, settings.stop_time, settings.max_gap)
        self._robot = robot
        self._settings = settings
        self._period = round(period * SECOND)
        self._robot_state: RobotState | None = None
        self._supervised = -math.inf  # when the supervisor last showed that it lives, s
        self._supervision_timeout = settings.supervision_timeout
        self._references = 0
        self._published_state: tuple[object, ...] = ()

    def configure(self, settings: TrajectorySettings) -> None:
        """Play another trajectory from the next start on, within other limits."""
        self._settings = settings
        self.player.limits = settings.limits

    def begin(self) -> Outputs:
        """Return the state in which the player begins."""
        return self._state_if_changed()

    def services(self) -> Mapping[str, Callable[[float], tuple[Decision, Outputs]]]:
        """Return ``start``, ``verify`` and ``stop``."""
        commands = (self.start, self.verify, self.stop)
        return {f"/{self.name}/{command.__name__}": command for command in commands}

    def start(self, now: float) -> tuple[Decision, Outputs]:
        """Begin the trajectory of the settings; refused while the robot is not enabled."""
        settings = self._settings
        return self.play(now, lambda present: make_trajectory(settings.name, self._robot, present, settings))

    def verify(self, now: float) -> tuple[Decision, Outputs]:
        """Begin the motion of a verification; refused as `start` is. The supervisor asks for it."""
        return self.play(now, lambda present: VerificationMotion(self._robot, present))

    def play(self, now: float, make: Callable[[Pose], Trajectory]) -> tuple[Decision, Outputs]:
        """Begin the trajectory that is made for the pose at which the reference rests; refused as `start` is."""
        player = self.player
        try:
            if self._robot_state is not RobotState.ENABLED:
                state = self._robot_state.value if self._robot_state else "unknown"
                raise TrajectoryError(f"the robot is in state {state}; enable it first")
            if problem := self._unsupervised(now):
                raise TrajectoryError(problem)
            if player.held_pose is None:
                raise TrajectoryError("no pose of the platform is known yet")
            player.start(make(player.held_pose))
        except (ControlError, KinematicsError) as error:
            return Decision(False, f"refused: {error}"), NOTHING
        decision = Decision(True, f"{player.trajectory_name} begins at {player.start_time} ns")
        return decision, self._state_if_changed()

    def stop(self, now: float) -> tuple[Decision, Outputs]:
        """Come to rest along the path."""
        self.player.stop()
        state = self._state_if_changed()
        return Decision(True, f"the trajectory is in phase {self.player.phase.value}"), state

    def on_supervisor_alive(self, now: float, sample: SignOfLife) -> Outputs:
        """Note that the supervisor lives."""
        self._supervised = now
        return NOTHING

    def _unsupervised(self, now: float) -> str:
        """Return why nothing may move without a supervisor; empty while there is one."""
        if now - self._supervised <= self._supervision_timeout:
            return ""
        return f"no sign of life of the supervisor within {self._supervision_timeout:g} s; is it running?"

    def on_robot_state(self, now: float, sample: Status) -> Outputs:
        """Stop when the motors no longer follow."""
        self._robot_state = self.read_word(topics.ROBOT_STATE, RobotState, sample.message)
        if self._robot_state not in FOLLOWING:
            self.player.stop()
        return NOTHING

    def on_platform_pose(self, now: float, sample: PoseSample) -> Outputs:
        """Stay at the measured pose while the motors do not follow."""
        if self._robot_state not in FOLLOWING:
            try:
                self.player.hold(Pose.from_quaternion(sample.position, sample.quaternion_xyzw))
            except KinematicsError as error:
                self.refuse(topics.PLATFORM_POSE, str(error))
        return NOTHING

    def on_motor_states(self, now: float, sample: JointStateSample) -> Outputs:
        """Return the reference for one period after the state; the state of the player when it has changed."""
        stamp = sample.stamp_ns + self._period
        if stamp > LATEST_TIME:
            self.refuse(topics.MOTOR_STATES, f"{topics.MOTOR_STATES.name} is stamped at the end of all times")
            return NOTHING
        outputs: list[Any] = []
        if self.player.phase in UNDER_WAY and (problem := self._unsupervised(now)):
            self.player.stop(problem)
        reference = self.player.sample(stamp)
        if reference is not None:
            self._references += 1
            outputs.append(Publication(topics.REFERENCE, self._sample(stamp, reference)))
        if state := self._state_if_changed():
            outputs += state
            if self.player.interruption:
                given_up = f"{self.player.trajectory_name} was given up"
                outputs.append(Remark(self.name, Level.WARN, f"{given_up}: {self.player.interruption}"))
        return outputs

    def _sample(self, stamp: int, reference: Motion) -> ReferenceSample:
        running = self.player.phase is TrajectoryPhase.RUNNING
        return ReferenceSample(
            stamp_ns=stamp,
            time_from_start=(stamp - self.player.start_time) / SECOND if running else 0.0,
            position=reference.pose.position,
            quaternion_xyzw=reference.pose.quaternion,
            linear_velocity=reference.twist.linear,
            angular_velocity=reference.twist.angular,
            linear_acceleration=reference.acceleration.linear,
            angular_acceleration=reference.acceleration.angular,
        )

    def _state_if_changed(self) -> Outputs:
        player = self.player
        values = {
            "trajectory": player.trajectory_name,
            "start_time": player.start_time,
            "end_time": player.end_time,
            "interruption": player.interruption,
        }
        if (player.phase, values) == self._published_state:
            return NOTHING
        self._published_state = player.phase, values
        return (Publication(topics.TRAJECTORY_STATE, self._status(Level.OK, player.phase.value, values)),)

    def status(self, now: float) -> Status:
        """Return the phase, and what the next start plays."""
        idle = self.player.phase is TrajectoryPhase.IDLE
        values = {
            "selected": self._settings.name.value,
            "trajectory": self.player.trajectory_name,
            "references": self._references,
            "unusable_messages": self.unusable,
            "last_problem": self.problem,
        }
        level = Level.STALE if idle else Level.OK
        text = "no platform pose has arrived" if idle else self.player.phase.value
        return self._status(level, text, values)
