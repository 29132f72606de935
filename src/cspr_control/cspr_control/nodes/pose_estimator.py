"""pose_estimator: forward kinematics of the motor angles."""

from __future__ import annotations

import sys
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from cspr_control.estimation.pose import PoseEstimator
from cspr_control.nodes.parameters import declare_robot
from cspr_kinematics import KinematicsError
from cspr_kinematics.warm_up import warm_up
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import Diagnostics, advertise, run_nodes, subscribe_raw
from cspr_msgs_py.topics import MOTOR_STATES, PLATFORM_POSE, motor_names
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.conversions import diagnostic_status, pose_stamped
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.joint_state_conversion import decode_joint_state

_SECOND = 1_000_000_000  # ns


class PoseEstimatorNode(Node):
    """Publishes the pose for every n-th motor state, so that poses come at ``rate``."""

    def __init__(self, **options: Any) -> None:
        super().__init__("pose_estimator", **options)
        robot = declare_robot(self)
        warm_up(robot)  # compiling takes long, and must not fall into a control cycle
        values = declare_all(self)
        # Half a cycle less than the interval: jitter of the stamps must not push a pose to the next state.
        self._interval = round((1.0 / values["rate"] - 0.5 / values["control_rate"]) * _SECOND)
        self._estimator = PoseEstimator(robot)
        self._codec = JointStateCodec(motor_names(robot.number_of_cables))
        self._stamp = 0
        self._published = 0
        self._published_reported = 0
        self._unreadable = 0
        self._problem = ""
        self._publisher = advertise(self, PLATFORM_POSE)
        subscribe_raw(self, MOTOR_STATES, self._on_states)
        self._diagnostics = Diagnostics(self, self._status)
        self._estimator.estimate(robot.winch.motor_angle(robot.winch.home_lengths))

    def _on_states(self, message: bytes) -> None:
        try:
            states = decode_joint_state(self._codec, message)
        except MessageError as error:
            self._unreadable += 1
            self._problem = str(error)
            return
        if 0 <= states.stamp_ns - self._stamp < self._interval:
            return
        self._stamp = states.stamp_ns
        try:
            pose = self._estimator.estimate(states.position)
        except KinematicsError as error:
            self._problem = str(error)
            return
        self._problem = ""
        self._published += 1
        self._publisher.publish(pose_stamped(states.stamp_ns, pose.position, pose.quaternion))

    def _status(self) -> list[DiagnosticStatus]:
        level, text = Level.OK, "estimating"
        if self._problem:
            level, text = Level.ERROR, self._problem
        elif self._published == self._published_reported:
            level, text = Level.STALE, "no motor states"
        self._published_reported = self._published
        values = {
            "poses": self._published,
            "failures": self._estimator.failures,
            "unreadable_messages": self._unreadable,
        }
        return [diagnostic_status(self.get_name(), level, text, values)]


def main() -> int:
    """Run the pose estimator."""
    return run_nodes(lambda: [PoseEstimatorNode()])


if __name__ == "__main__":
    sys.exit(main())
