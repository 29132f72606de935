"""All that the stability of the closed loop depends on, in one record with a fingerprint."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path

from cspr_control.estimation.payload import EstimatorSettings
from cspr_control.motors.feedforward import FeedforwardSettings
from cspr_control.motors.motor_control import MotorGains
from cspr_control.parameters.control_settings import ControlSettings
from cspr_kinematics import Robot
from cspr_msgs_py.json_file import plain
from cspr_msgs_py.vocabulary import PayloadMethod

LATENCY = 0.0015
"""From the SYNC that latches angles and tensions until the torques that answer it act, s."""


@dataclass(frozen=True)
class LoopConfiguration:
    """Robot, controllers, estimator and timing of a closed loop.

    Attributes
    ----------
    robot
        As the controllers believe it to be.
    gains, feedforward, payload
        Settings of motor controllers, feed-forward and payload estimation. The loop through the estimate is judged
        whatever the feed-forward does at present, for that may change while the robot moves.
    control_rate
        Of the control cycle, Hz.
    latency
        From the SYNC that latches angles and tensions until the torques that answer it act, s.
    """

    robot: Robot
    gains: MotorGains
    feedforward: FeedforwardSettings
    payload: EstimatorSettings
    control_rate: float
    latency: float = LATENCY

    @classmethod
    def of(cls, robot: Robot, settings: ControlSettings, latency: float = LATENCY) -> LoopConfiguration:
        """Return the loop of a control graph."""
        return cls(
            robot, settings.gains, settings.feedforward, settings.payload, settings.control_rate, latency
        )

    @property
    def time_constant(self) -> float:
        """Of the filter of the estimate, s."""
        method = self.payload.method
        return (self.payload.static if method is PayloadMethod.STATIC else self.payload.motion).time_constant

    @cached_property
    def fingerprint(self) -> str:
        """Of all numbers that it holds, and of the program that judges them: 64 hexadecimal digits."""
        numbers = json.dumps(plain(self), sort_keys=True)
        return hashlib.sha256(numbers.encode() + _program()).hexdigest()


@cache
def _program() -> bytes:
    """Return the program of this room: what it computed before it was changed does not count any more."""
    return b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.glob("*.py")))
