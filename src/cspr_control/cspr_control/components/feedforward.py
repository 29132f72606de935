"""The feed-forward as a component of the graph."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np

from cspr_control.components.component import NOTHING, Component, Outputs, Publication, Timer
from cspr_control.errors import PayloadError
from cspr_control.motors.feedforward import Feedforward, FeedforwardSettings, Margins, Setpoint
from cspr_control.motors.swing_damping import SwingDamping, SwingOffset
from cspr_kinematics import Acceleration, KinematicsError, Motion, Pose, Robot, Twist
from cspr_msgs_py.topics import (
    CABLE_TENSIONS,
    EXTERNAL_WRENCH,
    PAYLOAD,
    PAYLOAD_IN_USE,
    REFERENCE,
    ROBOT_STATE,
    SETPOINT,
    Topic,
)
from cspr_msgs_py.vocabulary import (
    FOLLOWING,
    UNDER_TORQUE,
    FeedforwardModel,
    Level,
    PayloadStatus,
    RobotState,
)
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.reference import ReferenceSample
from cspr_msgs_py.wire.samples import InertiaSample, Status, WrenchSample

_PAYLOAD_PERIOD = 0.02  # s between two looks at whether another payload is in use


class FeedforwardComponent(Component):
    """Answers each reference with a set-point of the same stamp, and says which payload set-points count on.

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

    inputs: ClassVar[tuple[Topic, ...]] = (
        REFERENCE,
        PAYLOAD,
        CABLE_TENSIONS,
        ROBOT_STATE,
        EXTERNAL_WRENCH,
    )

    def __init__(self, robot: Robot, settings: FeedforwardSettings) -> None:
        super().__init__("feedforward", SETPOINT, PAYLOAD_IN_USE)
        self.feedforward = Feedforward(robot, settings)
        self.swing = SwingDamping(settings.swing)
        self.newest: Setpoint | None = None
        self._robot = robot
        self._robot_state: RobotState | None = None
        self.feedforward.following = False
        self._setpoints = 0
        self._setpoints_reported = 0
        self._infeasible = 0
        self._infeasible_reported = 0
        self._refused_payloads = 0
        self._payload_stamp = 0  # of the newest estimate, ns
        self._told: tuple[float, ...] = ()  # mass and centre of mass
        # The first computations are slower than the others; they must not fall into a control cycle.
        spare = Feedforward(robot, settings)
        for time in (0.0, 0.004):
            spare.compute(time, Motion.at_rest(robot.home))

    def refuse(self, topic: Topic, problem: str) -> None:
        """Count references and payloads apart."""
        super().refuse(topic, problem)
        self._refused_payloads += topic.type == PAYLOAD.type

    def configure(self, settings: FeedforwardSettings) -> None:
        """Use other settings from the next set-point on; see `Feedforward.configure`."""
        self.feedforward.configure(settings)
        self.swing.settings = settings.swing

    def on_payload(self, now: float, sample: InertiaSample) -> Outputs:
        """Store the estimate of the payload."""
        try:
            self.feedforward.set_estimate(now, sample.mass, sample.center_of_mass)
            self._payload_stamp = sample.stamp_ns
        except PayloadError as error:
            self.refuse(PAYLOAD, str(error))
        return NOTHING

    def on_cable_tensions(self, now: float, sample: JointStateSample) -> Outputs:
        """Let set-points begin where the motors are, while these do not follow them."""
        if self._robot_state not in FOLLOWING and self._robot.cables.stretch:
            tensions = sample.effort
            if tensions.shape == (self._robot.number_of_cables,) and np.isfinite(tensions).all():
                self.feedforward.rest_at(np.maximum(tensions, 0.0))
        return NOTHING

    def on_robot_state(self, now: float, sample: Status) -> Outputs:
        """Note whether the motors follow the set-points."""
        self._robot_state = self.read_word(ROBOT_STATE, RobotState, sample.message)
        self.feedforward.following = self._robot_state in UNDER_TORQUE
        if not self.feedforward.following:
            self.swing.reset()
        return NOTHING

    def on_external_wrench(self, now: float, sample: WrenchSample) -> Outputs:
        """Observe whether the payload swings."""
        if not self.swing.idle:
            payload, _ = self.feedforward.payload_in_use(now)
            self.swing.observe(sample.stamp_ns, complex(sample.force[0], sample.force[1]), payload.mass)
        return NOTHING

    def begin(self) -> Outputs:
        """Return the payload to begin with."""
        return self.tell_payload(0.0)

    def timers(self) -> tuple[Timer, ...]:
        """Return the word about the payload and the report."""
        return (*super().timers(), Timer(_PAYLOAD_PERIOD, self.tell_payload))

    def tell_payload(self, now: float) -> Outputs:
        """Return the payload in use, if it is another one than was told last."""
        payload, _ = self.feedforward.payload_in_use(now)
        numbers = (payload.mass, *payload.center_of_mass.tolist())
        if numbers == self._told:
            return NOTHING
        self._told = numbers
        sample = InertiaSample(self._payload_stamp, payload.mass, payload.center_of_mass)
        return (Publication(PAYLOAD_IN_USE, sample),)

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
            if self.feedforward.following and not self.swing.idle:
                reference = _displaced(reference, self._swing_offset(now, sample))
            setpoint = self.feedforward.compute(now, reference, sample.stamp_ns)
        except KinematicsError as error:
            self.refuse(REFERENCE, str(error))
            return NOTHING
        self.newest = setpoint
        self._setpoints += 1
        self._infeasible += not setpoint.feasible
        joints = JointStateSample(sample.stamp_ns, setpoint.angle, setpoint.speed, setpoint.torque)
        return (Publication(SETPOINT, joints),)

    def _swing_offset(self, now: float, sample: ReferenceSample) -> SwingOffset:
        """Return by how much the platform departs from a reference so that the payload stops swinging."""
        _, status = self.feedforward.payload_in_use(now)
        enabled, estimated = self._robot_state is RobotState.ENABLED, status is PayloadStatus.ESTIMATED
        acceleration = complex(sample.linear_acceleration[0], sample.linear_acceleration[1])
        return self.swing.advance(sample.stamp_ns, acceleration, enabled and estimated, halts=not enabled)

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
            "winch_inertia": settings.winch_inertia,
            "rope_weight": settings.rope_weight,
            "stretch_compensation": settings.stretch_compensation,
            "payload_source": settings.payload_source.value,
            "tension_method": settings.tension_method,
            "swing_damping": settings.swing.damping,
            "setpoints": self._setpoints,
            "infeasible_setpoints": self._infeasible,
            "refused_references": self.unusable - self._refused_payloads,
            "refused_payloads": self._refused_payloads,
            "last_problem": self.problem,
        }
        if not self.swing.idle:
            omega = self.swing.omega
            values |= {
                "swing_frequency": "" if omega is None else f"{omega / math.tau:.3f}",
                "swing_offset": f"{abs(self.swing.offset.position):.4f}",
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


def _displaced(reference: Motion, offset: SwingOffset) -> Motion:
    """Return a reference with an offset along x and y."""
    pose, twist, acceleration = reference
    by, velocity, more = (np.array([each.real, each.imag, 0.0]) for each in offset)
    return Motion(
        Pose(pose.position + by, pose.rotation),
        Twist(twist.linear + velocity, twist.angular),
        Acceleration(acceleration.linear + more, acceleration.angular),
    )
