"""mass_estimator: the payload from the cable tensions."""

from __future__ import annotations

import sys
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from rclpy.node import Node

from cspr_control.errors import MeasurementError
from cspr_control.estimation.payload import UPDATE_PERIOD, EstimatorSettings, PayloadEstimator
from cspr_control.nodes.parameters import ChangeableParameters, declare_robot
from cspr_control.parameters.settings import estimator_settings
from cspr_kinematics import KinematicsError, Pose
from cspr_kinematics.warm_up import warm_up
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import (
    Diagnostics,
    advertise,
    run_nodes,
    steady_timer,
    subscribe,
    subscribe_raw,
)
from cspr_msgs_py.topics import CABLE_TENSIONS, PAYLOAD, PLATFORM_POSE, cable_names
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.conversions import diagnostic_status, from_pose_stamped, inertia_stamped
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.joint_state_conversion import decode_joint_state


class MassEstimatorNode(Node):
    """Publishes the filtered, bounded and rate-limited payload from the first valid estimate on."""

    def __init__(self, **options: Any) -> None:
        super().__init__("mass_estimator", **options)
        robot = declare_robot(self)
        warm_up(robot)  # compiling takes long, and must not fall into a control cycle
        declare_all(self)
        parameters = ChangeableParameters(self, estimator_settings, self._apply)
        self._estimator = PayloadEstimator(robot, parameters.settings)
        self._codec = JointStateCodec(cable_names(robot.number_of_cables), position=False, velocity=False)
        self._unusable = 0
        self._problem = ""
        self._publisher = advertise(self, PAYLOAD)
        subscribe_raw(self, CABLE_TENSIONS, self._on_tensions)
        subscribe(self, PLATFORM_POSE, self._on_pose)
        self._diagnostics = Diagnostics(self, self._status)
        self._timer = steady_timer(self, UPDATE_PERIOD, self._update)

    def _apply(self, settings: EstimatorSettings) -> None:
        self._estimator.settings = settings

    def _on_tensions(self, message: bytes) -> None:
        try:
            tensions = decode_joint_state(self._codec, message)
            self._estimator.observe_tensions(time.monotonic(), tensions.stamp_ns, tensions.effort)
        except (MessageError, MeasurementError) as error:
            self._refuse(error)

    def _on_pose(self, message: PoseStamped) -> None:
        stamp, position, quaternion = from_pose_stamped(message)
        try:
            self._estimator.observe_pose(time.monotonic(), stamp, Pose.from_quaternion(position, quaternion))
        except KinematicsError as error:
            self._refuse(error)

    def _refuse(self, error: Exception) -> None:
        self._unusable += 1
        self._problem = str(error)

    def _update(self) -> None:
        before = self._estimator.newest.invalidities
        estimate = self._estimator.update(time.monotonic())
        if estimate.samples > 0:
            payload = estimate.published
            self._publisher.publish(inertia_stamped(estimate.stamp, payload.mass, payload.center_of_mass))
        if estimate.invalidities != before:
            self._diagnostics.publish()

    def _status(self) -> list[DiagnosticStatus]:
        estimate = self._estimator.newest
        if estimate.valid:
            level, text = Level.OK, "estimating"
        else:
            causes = ", ".join(cause.value for cause in estimate.invalidities)
            level, text = Level.WARN, f"the estimate is held: {causes}"
        values = {
            "valid": str(estimate.valid).lower(),
            "invalidities": " ".join(cause.name.lower() for cause in estimate.invalidities),
            "samples": estimate.samples,
            "published_mass": f"{estimate.published.mass:.3f}",
            "filtered_mass": f"{estimate.filtered_mass:.3f}",
            "filtered_center_x": f"{estimate.filtered_center[0]:.4f}",
            "filtered_center_y": f"{estimate.filtered_center[1]:.4f}",
            "unusable_messages": self._unusable,
            "last_problem": self._problem,
        }
        if estimate.raw is not None:
            values |= {
                "raw_mass": f"{estimate.raw.mass:.3f}",
                "raw_total_mass": f"{estimate.raw.total_mass:.3f}",
            }
        return [diagnostic_status(self.get_name(), level, text, values)]


def main() -> int:
    """Run the mass estimator."""
    return run_nodes(lambda: [MassEstimatorNode()])


if __name__ == "__main__":
    sys.exit(main())
