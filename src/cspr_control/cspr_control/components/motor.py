"""The controller of one motor as a component of the graph."""

from __future__ import annotations

import math
from typing import ClassVar

from cspr_control.components.component import NOTHING, Component, Outputs, Publication
from cspr_control.motors.motor_control import MotorController, MotorGains
from cspr_kinematics import Motor
from cspr_msgs_py.topics import MOTOR_STATES, SETPOINT, Topic, motor_command
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.joint_state import JointSample, JointStateSample
from cspr_msgs_py.wire.samples import Status


class MotorComponent(Component):
    """Answers each motor state of one motor with a torque from the newest set-point.

    Parameters
    ----------
    number
        Of the motor, from 1.
    motor
        Torque limit and friction.
    gains, setpoint_timeout
        See `MotorController`.
    """

    inputs: ClassVar[tuple[Topic, ...]] = (SETPOINT, MOTOR_STATES)

    def __init__(self, number: int, motor: Motor, gains: MotorGains, setpoint_timeout: float) -> None:
        self._command = motor_command(number)
        super().__init__(f"motor_controller_{number}", self._command)
        self.controller = MotorController(motor, gains, setpoint_timeout)
        self._index = number - 1
        self._saturations_reported = 0

    def configure(self, gains: MotorGains) -> None:
        """Use other gains from the next command on."""
        self.controller.set_gains(gains)

    def on_setpoint(self, now: float, sample: JointStateSample) -> Outputs:
        """Store the set-point of the motor."""
        item = self._index
        self.controller.set_setpoint(
            now,
            sample.stamp_ns,
            sample.position.item(item),
            sample.velocity.item(item),
            sample.effort.item(item),
        )
        return NOTHING

    def on_motor_states(self, now: float, sample: JointStateSample) -> Outputs:
        """Return the torque that answers the state, stamped with it; nothing where there must be none."""
        item = self._index
        torque = self.controller.command(
            now, sample.stamp_ns, sample.position.item(item), sample.velocity.item(item)
        )
        if torque is None:
            return NOTHING
        return (Publication(self._command, JointSample(sample.stamp_ns, math.nan, math.nan, torque)),)

    def status(self, now: float) -> Status:
        """Return whether torques are sent, and how often they were not or were limited."""
        controller = self.controller
        level, text = Level.OK, "following set-points"
        if controller.last_refusal is not None:
            level, text = Level.WARN, f"no torque: {controller.last_refusal.value}"
        elif controller.saturations > self._saturations_reported:
            level, text = Level.WARN, "the torque is limited"
        self._saturations_reported = controller.saturations
        values = {
            "saturations": controller.saturations,
            "unreadable_messages": self.unusable,
            "unused_setpoints": controller.unused_setpoints,
            **{f"refusals_{cause.name.lower()}": count for cause, count in controller.refusals.items()},
        }
        return self._status(level, text, values)
