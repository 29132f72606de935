"""trajectory_publisher: the reference of the platform, one point a control cycle."""

from __future__ import annotations

import sys
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from std_srvs.srv import Trigger

from cspr_control.components.trajectory import TrajectorySettings
from cspr_control.errors import ControlError, TrajectoryError
from cspr_control.nodes.parameters import ChangeableParameters, declare_robot
from cspr_control.parameters.settings import trajectory_settings
from cspr_control.reference.catalogue import make_trajectory
from cspr_control.reference.player import SECOND, TrajectoryPlayer
from cspr_control.reference.reference_point import ReferencePoint
from cspr_kinematics import KinematicsError, Pose
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import Diagnostics, advertise, run_nodes, subscribe, subscribe_raw
from cspr_msgs_py.topics import (
    MOTOR_STATES,
    PLATFORM_POSE,
    REFERENCE,
    ROBOT_STATE,
    TRAJECTORY_STATE,
    motor_names,
)
from cspr_msgs_py.vocabulary import Level, RobotState, TrajectoryPhase
from cspr_msgs_py.wire.conversions import diagnostic_status, from_diagnostic_status, from_pose_stamped
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.joint_state_conversion import decode_joint_state
from cspr_msgs_py.wire.reference import ReferenceCodec, ReferenceSample

_FOLLOWING_STATES = (RobotState.ENABLING, RobotState.ENABLED, RobotState.STOPPING)
"""States in which the motors follow, or are about to follow, the reference."""


class TrajectoryPublisher(Node):
    """Plays the trajectory that the parameter ``trajectory`` names, from service ``start`` on.

    Each motor state is answered with the reference for one control period later. While the robot is not
    enabled the reference stays at the newest measured pose, so that enabling begins without a jump.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("trajectory_publisher", **options)
        self._robot = declare_robot(self)
        home = self._robot.home
        values = declare_all(self, move_position=home.position.tolist(), move_orientation=home.euler.tolist())
        self._period = round(SECOND / values["control_rate"])
        self._options = ChangeableParameters(self, partial(trajectory_settings, self._robot), self._apply)
        settings = self._options.settings
        self._player = TrajectoryPlayer(
            settings.options.limits, settings.dwell, settings.stop_time, settings.max_gap
        )
        self._robot_state: RobotState | None = None
        self._unusable = 0
        self._problem = ""
        self._references = 0
        self._published_state: tuple[object, ...] = ()
        self._states_codec = JointStateCodec(motor_names(self._robot.number_of_cables))
        self._codec = ReferenceCodec()
        self._publisher = advertise(self, REFERENCE)
        self._state_publisher = advertise(self, TRAJECTORY_STATE)
        subscribe_raw(self, MOTOR_STATES, self._on_states)
        subscribe(self, PLATFORM_POSE, self._on_pose)
        subscribe(self, ROBOT_STATE, self._on_robot_state)
        self.create_service(Trigger, "/trajectory_publisher/start", self._on_start)
        self.create_service(Trigger, "/trajectory_publisher/stop", self._on_stop)
        self._diagnostics = Diagnostics(self, self._status)
        self._publish_state()

    def _apply(self, settings: TrajectorySettings) -> None:
        self._player.limits = settings.options.limits

    def _on_start(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            if self._robot_state is not RobotState.ENABLED:
                state = self._robot_state.value if self._robot_state else "unknown"
                raise TrajectoryError(f"the robot is in state {state}; enable it first")
            present = self._player.held_pose  # where it rests; if it does not, start refuses
            if present is None:
                raise TrajectoryError("no pose of the platform is known yet")
            settings = self._options.settings
            self._player.start(make_trajectory(settings.name, self._robot, present, settings.options))
        except (ControlError, KinematicsError) as error:
            response.message = f"refused: {error}"
            return response
        response.success = True
        response.message = f"{self._player.trajectory_name} begins at {self._player.start_time} ns"
        self._publish_state()
        return response

    def _on_stop(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._player.stop()
        self._publish_state()
        response.success = True
        response.message = f"the trajectory is in phase {self._player.phase.value}"
        return response

    def _on_robot_state(self, message: DiagnosticStatus) -> None:
        _, _, state, _ = from_diagnostic_status(message)
        try:
            self._robot_state = RobotState(state)
        except ValueError:
            self._robot_state = None
            self._refuse(f"{ROBOT_STATE.name} carries an unknown state, {state!r}")
        if self._robot_state not in _FOLLOWING_STATES:
            self._player.stop()

    def _on_pose(self, message: PoseStamped) -> None:
        if self._robot_state in _FOLLOWING_STATES:
            return
        _, position, quaternion = from_pose_stamped(message)
        try:
            self._player.hold(Pose.from_quaternion(position, quaternion))
        except KinematicsError as error:
            self._refuse(str(error))

    def _on_states(self, message: bytes) -> None:
        try:
            stamp = decode_joint_state(self._states_codec, message).stamp_ns + self._period
        except MessageError as error:
            self._refuse(str(error))
            return
        reference = self._player.sample(stamp)
        if reference is not None:
            self._references += 1
            self._publisher.publish(self._codec.encode(self._sample(stamp, reference)))
        if self._publish_state() and self._player.interruption:
            self.get_logger().warning(
                f"{self._player.trajectory_name} was given up, the platform holds its pose: "
                f"{self._player.interruption}"
            )

    def _sample(self, stamp: int, reference: ReferencePoint) -> ReferenceSample:
        running = self._player.phase is TrajectoryPhase.RUNNING
        return ReferenceSample(
            stamp_ns=stamp,
            time_from_start=(stamp - self._player.start_time) / SECOND if running else 0.0,
            position=reference.pose.position,
            quaternion_xyzw=reference.pose.quaternion,
            linear_velocity=reference.twist.linear,
            angular_velocity=reference.twist.angular,
            linear_acceleration=reference.acceleration.linear,
            angular_acceleration=reference.acceleration.angular,
        )

    def _refuse(self, problem: str) -> None:
        self._unusable += 1
        self._problem = problem

    def _publish_state(self) -> bool:
        """Publish the state if it has changed; return whether it had."""
        player = self._player
        state = (
            player.phase,
            player.trajectory_name,
            player.start_time,
            player.end_time,
            player.interruption,
        )
        if state == self._published_state:
            return False
        self._published_state = state
        values = {
            "trajectory": player.trajectory_name,
            "start_time": player.start_time,
            "end_time": player.end_time,
            "interruption": player.interruption,
        }
        self._state_publisher.publish(
            diagnostic_status(self.get_name(), Level.OK, player.phase.value, values)
        )
        return True

    def _status(self) -> list[DiagnosticStatus]:
        idle = self._player.phase is TrajectoryPhase.IDLE
        values = {
            "selected": self._options.settings.name.value,
            "trajectory": self._player.trajectory_name,
            "references": self._references,
            "unusable_messages": self._unusable,
            "last_problem": self._problem,
        }
        level = Level.STALE if idle else Level.OK
        text = "no platform pose has arrived" if idle else self._player.phase.value
        return [diagnostic_status(self.get_name(), level, text, values)]


def main() -> int:
    """Run the trajectory publisher."""
    return run_nodes(lambda: [TrajectoryPublisher()])


if __name__ == "__main__":
    sys.exit(main())
