"""feedforward: from the reference to the set-points of all motors."""

from __future__ import annotations

import sys
import time
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import InertiaStamped
from rclpy.node import Node

from cspr_control.errors import PayloadError
from cspr_control.motors.feedforward import Feedforward, FeedforwardSettings, Margins, Setpoint
from cspr_control.nodes.parameters import ChangeableParameters, declare_robot
from cspr_control.parameters.settings import feedforward_settings
from cspr_control.reference.reference_point import ReferencePoint
from cspr_kinematics import KinematicsError
from cspr_kinematics.warm_up import warm_up
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import Diagnostics, advertise, run_nodes, subscribe, subscribe_raw
from cspr_msgs_py.topics import PAYLOAD, REFERENCE, SETPOINT, motor_names
from cspr_msgs_py.vocabulary import FeedforwardModel, Level, PayloadStatus
from cspr_msgs_py.wire.conversions import diagnostic_status, from_inertia_stamped
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.reference import ReferenceCodec
from cspr_msgs_py.wire.reference_conversion import decode_reference


class FeedforwardNode(Node):
    """Answers each reference with a set-point of the same stamp."""

    def __init__(self, **options: Any) -> None:
        super().__init__("feedforward", **options)
        robot = declare_robot(self)
        warm_up(robot)  # compiling takes long, and must not fall into a control cycle
        declare_all(self)
        build = partial(feedforward_settings, robot.number_of_cables)
        parameters = ChangeableParameters(self, build, self._apply)
        self._robot = robot
        self._feedforward = Feedforward(robot, parameters.settings)
        self._reference_codec = ReferenceCodec()
        self._codec = JointStateCodec(motor_names(robot.number_of_cables))
        self._newest: Setpoint | None = None
        self._setpoints = 0
        self._setpoints_reported = 0
        self._infeasible = 0
        self._infeasible_reported = 0
        self._refused_references = 0
        self._refused_payloads = 0
        self._problem = ""
        self._publisher = advertise(self, SETPOINT)
        subscribe_raw(self, REFERENCE, self._on_reference)
        subscribe(self, PAYLOAD, self._on_payload)
        self._diagnostics = Diagnostics(self, self._status)
        # The first computation is slower than the others; it must not fall into a control cycle.
        Feedforward(robot, parameters.settings).compute(0.0, ReferencePoint.at_rest(robot.home))

    def _apply(self, settings: FeedforwardSettings) -> None:
        self._feedforward.configure(settings)

    def _on_payload(self, message: InertiaStamped) -> None:
        _, mass, center_of_mass = from_inertia_stamped(message)
        try:
            self._feedforward.set_estimate(time.monotonic(), mass, center_of_mass)
        except PayloadError as error:
            self._refused_payloads += 1
            self._problem = str(error)

    def _on_reference(self, message: bytes) -> None:
        try:
            sample = decode_reference(self._reference_codec, message)
            setpoint = self._feedforward.compute(time.monotonic(), ReferencePoint.of_sample(sample))
        except (MessageError, KinematicsError) as error:
            # A reference that is not finite ends here; without a set-point the motor controllers fall silent.
            self._refused_references += 1
            self._problem = str(error)
            return
        self._publisher.publish(
            self._codec.encode(sample.stamp_ns, setpoint.position, setpoint.velocity, setpoint.effort)
        )
        self._newest = setpoint
        self._setpoints += 1
        self._infeasible += not setpoint.feasible

    def _status(self) -> list[DiagnosticStatus]:
        newest = self._newest
        settings = self._feedforward.settings
        level, text = Level.OK, "answering references"
        if newest is None or self._setpoints == self._setpoints_reported:
            level, text = Level.STALE, "no references"
        elif self._infeasible > self._infeasible_reported:
            level, text = Level.WARN, "the wrench is out of reach of the cables; they give the closest one"
        elif newest.payload_status is PayloadStatus.HELD:
            level, text = Level.WARN, "the payload estimate is stale and held"
        elif newest.payload_status is PayloadStatus.AWAITED:
            level, text = Level.WARN, "no payload estimate has arrived; the nominal payload is used"
        self._setpoints_reported, self._infeasible_reported = self._setpoints, self._infeasible
        values: dict[str, Any] = {
            "model": settings.model.value,
            "payload_source": settings.payload_source.value,
            "tension_method": settings.tension_method,
            "setpoints": self._setpoints,
            "infeasible_setpoints": self._infeasible,
            "refused_references": self._refused_references,
            "refused_payloads": self._refused_payloads,
            "last_problem": self._problem,
        }
        if newest is not None:
            values |= {
                "payload_status": newest.payload_status.value,
                "payload_mass": f"{newest.payload.mass:.3f}",
                "lowest_tension": f"{newest.tensions.min():.1f}",
                "highest_tension": f"{newest.tensions.max():.1f}",
                "wrench_residual": f"{newest.wrench_residual:.3g}",
            }
            if settings.model is not FeedforwardModel.NONE:
                margins = Margins.of(newest, self._robot)
                values |= {
                    "tension_margin": f"{margins.tension:.1f}",
                    "wrench_margin": f"{margins.wrench:.1f}",
                }
        return [diagnostic_status(self.get_name(), level, text, values)]


def main() -> int:
    """Run the feed-forward."""
    return run_nodes(lambda: [FeedforwardNode()])


if __name__ == "__main__":
    sys.exit(main())
