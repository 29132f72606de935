"""The feed-forward as a component of the graph."""

from __future__ import annotations

from typing import Any, ClassVar

from cspr_control.components.component import NOTHING, Component, Outputs, Publication
from cspr_control.errors import PayloadError
from cspr_control.motors.feedforward import Feedforward, FeedforwardSettings, Margins, Setpoint
from cspr_kinematics import Acceleration, KinematicsError, Motion, Pose, Robot, Twist
from cspr_msgs_py.topics import PAYLOAD, REFERENCE, SETPOINT, Topic
from cspr_msgs_py.vocabulary import FeedforwardModel, Level, PayloadStatus
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.reference import ReferenceSample
from cspr_msgs_py.wire.samples import InertiaSample, Status


class FeedforwardComponent(Component):
    """Answers each reference with a set-point of the same stamp.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    settings
        See `FeedforwardSettings`.

    Attributes
    ----------
    newest
        The newest set-point with all that it follows from; None before the first.
    """

    inputs: ClassVar[tuple[Topic, ...]] = (REFERENCE, PAYLOAD)

    def __init__(self, robot: Robot, settings: FeedforwardSettings) -> None:
        super().__init__("feedforward", SETPOINT)
        self.feedforward = Feedforward(robot, settings)
        self.newest: Setpoint | None = None
        self._robot = robot
        self._setpoints = 0
        self._setpoints_reported = 0
        self._infeasible = 0
        self._infeasible_reported = 0
        self._refused_payloads = 0
        # The first computation is slower than the others; it must not fall into a control cycle.
        Feedforward(robot, settings).compute(0.0, Motion.at_rest(robot.home))

    def refuse(self, topic: Topic, problem: str) -> None:
        """Count references and payloads apart."""
        super().refuse(topic, problem)
        self._refused_payloads += topic.type == PAYLOAD.type

    def configure(self, settings: FeedforwardSettings) -> None:
        """Use other settings from the next set-point on; see `Feedforward.configure`."""
        self.feedforward.configure(settings)

    def on_payload(self, now: float, sample: InertiaSample) -> Outputs:
        """Store the estimate of the payload."""
        try:
            self.feedforward.set_estimate(now, sample.mass, sample.center_of_mass)
        except PayloadError as error:
            self.refuse(PAYLOAD, str(error))
        return NOTHING

    def on_reference(self, now: float, sample: ReferenceSample) -> Outputs:
        """Return the set-point that answers the reference.

        A reference that is not finite ends here; without a set-point the motor controllers fall silent.
        """
        try:
            reference = Motion(
                Pose.from_quaternion(sample.position, sample.quaternion_xyzw),
                Twist(sample.linear_velocity, sample.angular_velocity),
                Acceleration(sample.linear_acceleration, sample.angular_acceleration),
            )
            setpoint = self.feedforward.compute(now, reference)
        except KinematicsError as error:
            self.refuse(REFERENCE, str(error))
            return NOTHING
        self.newest = setpoint
        self._setpoints += 1
        self._infeasible += not setpoint.feasible
        joints = JointStateSample(sample.stamp_ns, setpoint.angle, setpoint.speed, setpoint.torque)
        return (Publication(SETPOINT, joints),)

    def status(self, now: float) -> Status:
        """Return what the set-points rest on, and how far they are from what the cables cannot do."""
        newest, settings = self.newest, self.feedforward.settings
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
            "refused_references": self.unusable - self._refused_payloads,
            "refused_payloads": self._refused_payloads,
            "last_problem": self.problem,
        }
        if newest is not None:
            values |= {
                "payload_status": newest.payload_status.value,
                "payload_mass": f"{newest.payload.mass:z.3f}",
                "lowest_tension": f"{newest.tensions.min():z.1f}",
                "highest_tension": f"{newest.tensions.max():z.1f}",
                "wrench_residual": f"{newest.wrench_residual:.3g}",
            }
            if settings.model is not FeedforwardModel.NONE:
                margins = Margins.of(newest, self._robot)
                values |= {
                    "tension_margin": f"{margins.tension:z.1f}",
                    "wrench_margin": f"{margins.wrench:z.1f}",
                }
        return self._status(level, text, values)
