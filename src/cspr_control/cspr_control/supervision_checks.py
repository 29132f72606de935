"""What the supervisor watches while the robot is enabled: ages, following errors and tensions."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from cspr_control.errors import SettingError
from cspr_control.watch import LastingViolation


class MonitoredInput(Enum):
    """Inputs whose age is watched, by the topic that brings them."""

    MOTOR_STATES = "/motor_states"
    CABLE_TENSIONS = "/cable_tensions"
    SETPOINT = "/setpoint"
    PLATFORM_POSE = "/platform_pose"
    DRIVE_STATES = "/drive_states"


class FaultKind(Enum):
    """What made the supervisor stop the robot."""

    STALE_TOPIC = "stale topic"
    FOLLOWING_ERROR = "following error"
    TENSION_LOW = "cable tension below its limit"
    TENSION_HIGH = "cable tension above its limit"
    DRIVE_FAULT = "drive fault"
    DRIVE_STATE = "unexpected drive state"
    TIMEOUT = "no answer in time"


@dataclass(frozen=True)
class Fault:
    """Why the robot was stopped."""

    kind: FaultKind
    detail: str

    def __str__(self) -> str:
        return f"{self.kind.value}: {self.detail}"


def _default_ages() -> dict[MonitoredInput, float]:
    return {
        MonitoredInput.MOTOR_STATES: 0.1,
        MonitoredInput.CABLE_TENSIONS: 0.1,
        MonitoredInput.SETPOINT: 0.1,
        MonitoredInput.PLATFORM_POSE: 0.3,
        MonitoredInput.DRIVE_STATES: 3.0,
    }


@dataclass(frozen=True)
class SupervisionLimits:
    """Limits beyond which the robot is stopped.

    Attributes
    ----------
    max_ages
        Age from which each input counts as stale, s.
    following_error
        Largest difference between desired and measured motor angle, rad.
    following_error_time
        How long it may be exceeded, s.
    tension_min, tension_max
        Limits of the cable tensions, N.
    tension_min_time, tension_max_time
        How long they may be passed, s.
    enable_timeout, stop_timeout, drive_timeout
        Longest time for the drives to become enabled, for the trajectory to come to rest and for the drives
        to become disabled, s.
    """

    max_ages: dict[MonitoredInput, float] = field(default_factory=_default_ages)
    following_error: float = 12.0
    following_error_time: float = 0.2
    tension_min: float = 50.0
    tension_min_time: float = 0.5
    tension_max: float = 3000.0
    tension_max_time: float = 0.1
    enable_timeout: float = 5.0
    stop_timeout: float = 3.0
    drive_timeout: float = 5.0

    def __post_init__(self) -> None:
        values = {name: value for name, value in vars(self).items() if name != "max_ages"}
        values |= {f"largest age of {source.value}": age for source, age in self.max_ages.items()}
        for name, value in values.items():
            if not (math.isfinite(value) and value >= 0.0):
                raise SettingError(f"{name} is {value}; it must be finite and not negative")
        if self.tension_min >= self.tension_max:
            raise SettingError(
                f"tension_min, {self.tension_min} N, must be below tension_max, {self.tension_max} N"
            )


class SupervisionChecks:
    """Holds the newest inputs and compares them with the limits.

    Times are monotonic times of arrival, s; stamps ROS time, ns.

    Parameters
    ----------
    count
        Number m of motors and cables.
    limits
        The limits.
    """

    def __init__(self, count: int, limits: SupervisionLimits) -> None:
        self._limits = limits
        self._arrivals = dict.fromkeys(MonitoredInput, -math.inf)
        self._angles = np.zeros(count)
        self._angles_stamp = 0
        self._desired = np.zeros(count)
        self._desired_speed = np.zeros(count)
        self._desired_stamp = 0
        self._tensions = np.full(count, np.nan)
        self._following = LastingViolation(count, limits.following_error_time)
        self._low = LastingViolation(count, limits.tension_min_time)
        self._high = LastingViolation(count, limits.tension_max_time)

    def clear(self) -> None:
        """Forget violations under way: the robot is about to be enabled."""
        for watch in (self._following, self._low, self._high):
            watch.clear()

    def observe_arrival(self, source: MonitoredInput, time: float) -> None:
        """Note that an input arrived."""
        self._arrivals[source] = time

    def observe_motors(self, time: float, stamp: int, angles: NDArray[np.float64]) -> None:
        """Take over measured motor angles (m,), rad."""
        self.observe_arrival(MonitoredInput.MOTOR_STATES, time)
        self._angles, self._angles_stamp = angles, stamp

    def observe_setpoint(
        self, time: float, stamp: int, angles: NDArray[np.float64], speeds: NDArray[np.float64]
    ) -> None:
        """Take over desired motor angles (m,), rad, and speeds (m,), rad/s."""
        self.observe_arrival(MonitoredInput.SETPOINT, time)
        self._desired, self._desired_speed, self._desired_stamp = angles, speeds, stamp

    def observe_tensions(self, time: float, tensions: NDArray[np.float64]) -> None:
        """Take over measured cable tensions (m,), N."""
        self.observe_arrival(MonitoredInput.CABLE_TENSIONS, time)
        self._tensions = tensions

    def age(self, source: MonitoredInput, time: float) -> float:
        """Return the age of an input, s; infinite before the first."""
        return time - self._arrivals[source]

    def following_errors(self) -> NDArray[np.float64]:
        """Desired less measured motor angles (m,), rad, at the time of the measurement."""
        ahead = (self._angles_stamp - self._desired_stamp) * 1e-9
        return np.asarray(self._desired + self._desired_speed * ahead - self._angles)

    def stale(self, time: float) -> Fault | None:
        """Return the first input that is too old."""
        for source, largest in self._limits.max_ages.items():
            age = self.age(source, time)
            if age > largest:
                seen = f"was last received {age:.3f} s ago" if math.isfinite(age) else "has not been received"
                return Fault(FaultKind.STALE_TOPIC, f"{source.value} {seen}, limit {largest:g} s")
        return None

    def excess(self, time: float) -> Fault | None:
        """Return what has been beyond a limit for longer than allowed."""
        limits, errors, tensions = self._limits, self.following_errors(), self._tensions
        # Written so that a number that is not finite counts as beyond the limit.
        motor = self._following.update(time, ~(np.abs(errors) <= limits.following_error))
        if motor is not None:
            detail = (
                f"motor_{motor + 1} is {errors[motor]:.2f} rad behind, limit {limits.following_error:g} rad"
            )
            return Fault(FaultKind.FOLLOWING_ERROR, detail)
        cable = self._high.update(time, ~(tensions <= limits.tension_max))
        if cable is not None:
            detail = f"cable_{cable + 1} at {tensions[cable]:.0f} N, limit {limits.tension_max:g} N"
            return Fault(FaultKind.TENSION_HIGH, detail)
        cable = self._low.update(time, ~(tensions >= limits.tension_min))
        if cable is not None:
            detail = f"cable_{cable + 1} at {tensions[cable]:.0f} N, limit {limits.tension_min:g} N"
            return Fault(FaultKind.TENSION_LOW, detail)
        return None

    def obstacle(self, time: float) -> str | None:
        """Return why the robot must not be enabled now; None when nothing speaks against it."""
        stale = self.stale(time)
        if stale is not None:
            return str(stale)
        errors = self.following_errors()
        worst = int(np.abs(errors).argmax())
        if not abs(errors[worst]) <= self._limits.following_error:
            return (
                f"motor_{worst + 1} is {errors[worst]:.2f} rad away from its set-point, "
                f"limit {self._limits.following_error:g} rad"
            )
        highest = int(self._tensions.argmax())
        if not self._tensions[highest] <= self._limits.tension_max:
            return (
                f"cable_{highest + 1} carries {self._tensions[highest]:.0f} N, "
                f"limit {self._limits.tension_max:g} N"
            )
        return None
