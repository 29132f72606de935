"""The controller of one motor (section III and eq. 14 of the paper).

Eight of these answer every bus cycle: plain floats, no arrays.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from cspr_control.errors import SettingError
from cspr_kinematics import Motor

_NANOSECOND = 1e-9


@dataclass(frozen=True)
class MotorGains:
    """Gains of the control law, the same for all motors; meanings, units, ranges: `cspr_msgs_py.parameters.table`."""

    kp: float
    kd: float
    speed_delay: float
    friction_compensation: float
    friction_smoothing_speed: float

    def require_sampled_stability(self, inertia: float, period: float) -> None:
        """Refuse a derivative gain with which the motor of a slack cable would oscillate.

        A speed fed back once a period T to an inertia J is stable only for Kd < 2 J / T: beyond, each answer
        overcompensates by more than what it corrects.

        Parameters
        ----------
        inertia
            Of the motor and what turns with it, at the motor shaft, kg m^2.
        period
            Of the control cycle, s.

        Raises
        ------
        SettingError
            If the gain reaches the limit.
        """
        limit = 2.0 * inertia / period
        if self.kd >= limit:
            raise SettingError(
                f"kd is {self.kd} N m s/rad; with a motor inertia of {inertia} kg m^2 at {1.0 / period:g} Hz "
                f"it must stay below {limit:.4g}"
            )


class Refusal(Enum):
    """Why a motor state was not answered with a torque."""

    NO_SETPOINT = "no set-point has arrived"
    STALE_SETPOINT = "the set-point is too old"
    NOT_FINITE = "the set-point or the motor state is not finite"


class MotorController:
    """PD control, feed-forward torque and friction compensation of one motor.

    ``tau = Kp (q_d - q) + Kd (qdot_d - qdot) + tau_ff + F_s tanh(qdot_d / v_s) + F_v qdot_d``, limited to the
    motor's torque. A measured speed is an old one, ``speed_delay`` of the gains: as a difference of positions, that of
    half a period ago. It is compared with the desired speed of then, or a motor that accelerates would be pushed ahead.
    Friction is compensated at the *desired* speed: it carries no measurement noise, and tanh instead of the sign makes
    it continuous, so that the torque does not chatter around standstill.

    Parameters
    ----------
    motor
        Torque limit and friction.
    gains
        Gains of the control law.
    setpoint_timeout
        Age at which a set-point is no longer used, s; also the longest time over which it is carried on.

    Attributes
    ----------
    saturations
        Number of torques that had to be limited.
    refusals
        Number of motor states not answered, by cause.
    unused_setpoints
        Number of set-points that did not follow the one in use.
    last_refusal
        Why the newest motor state was not answered; None if it was.
    """

    def __init__(self, motor: Motor, gains: MotorGains, setpoint_timeout: float) -> None:
        self.motor = motor
        self.saturations = 0
        self.unused_setpoints = 0
        self.refusals = dict.fromkeys(Refusal, 0)
        self.last_refusal: Refusal | None = Refusal.NO_SETPOINT
        self._torque_limit, self._speed_limit = motor.torque_limit, motor.speed_limit
        self._timeout = setpoint_timeout
        self._received = -math.inf
        self._stamp = 0
        self._angle = self._speed = self._acceleration = self._torque = 0.0
        self._largest_acceleration = motor.torque_limit / motor.inertia
        self.set_gains(gains)

    def set_gains(self, gains: MotorGains) -> None:
        """Use other gains from the next command on."""
        self._kp, self._kd, self._speed_delay = gains.kp, gains.kd, gains.speed_delay
        self._coulomb = gains.friction_compensation * self.motor.coulomb_friction
        self._viscous = gains.friction_compensation * self.motor.viscous_friction
        self._largest_error = self._torque_limit / gains.kp if gains.kp > 0.0 else math.inf
        self._smoothing = gains.friction_smoothing_speed

    def set_setpoint(self, received: float, stamp: int, angle: float, speed: float, torque: float) -> None:
        """Store a set-point, unless it is none for this motor after the one in use.

        One that is stamped no later, or lies where the motor cannot be by then, nor near enough for the controller not
        to push with all its torque, comes from somebody else. It is counted, and the one before stays in use until it
        is too old: then the drivers have begun to count time anew, or the platform is known to be elsewhere.

        Parameters
        ----------
        received
            Monotonic time of its arrival, s.
        stamp
            ROS time at which it is to be reached, ns.
        angle, speed, torque
            rad, rad/s and N m. Whether they are finite is checked when they are used.
        """
        elapsed = (stamp - self._stamp) * _NANOSECOND
        farthest = self._speed_limit * elapsed + self._largest_error
        follows = elapsed > 0.0 and not abs(angle - self._angle) > farthest
        if not follows and received - self._received <= self._timeout:
            self.unused_setpoints += 1
            return
        if elapsed > 0.0:
            acceleration = (speed - self._speed) / elapsed
            # beyond what the motor can do it is no acceleration but a jump, or not a number
            possible = abs(acceleration) <= self._largest_acceleration
            self._acceleration = acceleration if possible else 0.0
        self._received = received
        self._stamp = stamp
        self._angle = angle
        self._speed = speed
        self._torque = torque

    def command(self, time: float, stamp: int, angle: float, speed: float) -> float | None:
        """Torque that answers a motor state, N m; None where there must be none.

        Parameters
        ----------
        time
            Monotonic time, s.
        stamp
            ROS time at which the state was latched, ns. The set-point is carried to this time with its speed,
            so that the two are compared at one instant.
        angle, speed
            Measured, rad and rad/s.
        """
        ahead = (stamp - self._stamp) * _NANOSECOND
        if time - self._received > self._timeout or not -self._timeout <= ahead <= self._timeout:
            missing = self._received == -math.inf
            return self._refuse(Refusal.NO_SETPOINT if missing else Refusal.STALE_SETPOINT)
        desired_speed = self._speed
        torque = (
            self._kp * (self._angle + desired_speed * ahead - angle)
            + self._kd * (desired_speed - self._acceleration * self._speed_delay - speed)
            + self._torque
            + self._coulomb * math.tanh(desired_speed / self._smoothing)
            + self._viscous * desired_speed
        )
        if not math.isfinite(torque):
            return self._refuse(Refusal.NOT_FINITE)
        self.last_refusal = None
        limit = self._torque_limit
        if torque > limit:
            self.saturations += 1
            return limit
        if torque < -limit:
            self.saturations += 1
            return -limit
        return torque

    def _refuse(self, cause: Refusal) -> float | None:
        self.refusals[cause] += 1
        self.last_refusal = cause
        return None
