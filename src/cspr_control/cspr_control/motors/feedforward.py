"""Feed-forward: from the reference of the platform to the set-point of each motor (eqs. 1-15)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_control.errors import PayloadError
from cspr_control.motors.stretch import SmoothedStretch
from cspr_control.motors.swing_damping import SwingSettings
from cspr_kinematics import (
    InvalidInputError,
    Method,
    Motion,
    Payload,
    Robot,
    SingularWrenchMatrixError,
    TensionBlend,
    available_wrenches,
    inverse_kinematics,
    length_accelerations,
    required_wrench,
    rope_wrench,
    static_wrench,
)
from cspr_msgs_py.parameters.table import defaults, node_parameters
from cspr_msgs_py.vocabulary import FeedforwardModel, PayloadSource, PayloadStatus

_DEFAULT = defaults("feedforward")
_NANOSECOND = 1e-9  # s
_LARGEST_OFFSET = node_parameters("feedforward")["nominal_payload_center"].maximum or math.inf
"""Largest coordinate of a payload's centre of mass, m: beyond it the unit was mistaken, whatever the robot."""


@dataclass(frozen=True)
class FeedforwardSettings:
    """What may change while the robot moves; meanings and units of the parameters: `cspr_msgs_py.parameters.table`.

    Attributes
    ----------
    nominal_payload
        Payload assumed without an estimate.
    tension_method
        See `cspr_kinematics.distribute_tensions`; one of `cspr_kinematics.bounded_methods`.
    swing
        See `cspr_control.motors.swing_damping`.
    """

    model: FeedforwardModel = field(default=FeedforwardModel(_DEFAULT["model"]))
    stretch_compensation: bool = _DEFAULT["stretch_compensation"]
    stretch_slew: float = _DEFAULT["stretch_slew"]
    winch_inertia: bool = _DEFAULT["winch_inertia"]
    rope_weight: bool = _DEFAULT["rope_weight"]
    payload_source: PayloadSource = field(default=PayloadSource(_DEFAULT["payload_source"]))
    nominal_payload: Payload = field(default_factory=Payload.none)
    max_payload: float = _DEFAULT["max_payload"]
    payload_timeout: float = _DEFAULT["payload_timeout"]
    switch_slew: float = _DEFAULT["switch_slew"]
    tension_method: Method = _DEFAULT["tension_method"]
    swing: SwingSettings = field(default_factory=lambda: SwingSettings.of(_DEFAULT))


def checked_payload(what: str, mass: float, center_of_mass: ArrayLike, max_payload: float) -> Payload:
    """Build a payload that the robot can carry.

    Parameters
    ----------
    what
        Name of the payload in the error's message.
    mass
        kg.
    center_of_mass
        (3,) in platform, m.
    max_payload
        Largest mass, kg.

    Raises
    ------
    PayloadError
        If a number is not finite, the mass is negative or exceeds the largest one, or the centre of mass is
        further off than that of a nominal payload may be.
    """
    try:
        payload = Payload(mass, center_of_mass)
    except InvalidInputError as error:
        raise PayloadError(f"{what}: {error}") from error
    if mass > max_payload:
        raise PayloadError(f"{what}: the mass is {mass} kg; it must not exceed max_payload, {max_payload} kg")
    center = payload.center_of_mass.tolist()
    if max(map(abs, center)) > _LARGEST_OFFSET:
        raise PayloadError(
            f"{what}: the centre of mass is {center} m; no coordinate may exceed {_LARGEST_OFFSET:g} m"
        )
    return payload


class Setpoint(NamedTuple):
    """What all m motors should do at the time of the reference.

    Attributes
    ----------
    angle, speed
        Motor angles (m,), rad, and speeds (m,), rad/s.
    torque
        Feed-forward torque (m,), N m: what holds the tensions, what accelerates the winches, and the bridging of a
        switch.
    tensions
        Cable tensions at the frame (m,) behind the torque, N; zero without a model.
    wrench_matrix, wrench
        What the tensions must satisfy: A (6, m), and the wrench (6,) of the model and the ropes, N and N m.
    feasible
        Whether tensions within the robot's limits give the wrench exactly. If not, ``tensions`` is the
        closest solution within them.
    wrench_residual
        Norm of the wrench that ``tensions`` fail to give; N and N m count alike, as with a lever of 1 m.
    payload, payload_status
        The payload counted on, and where it comes from.
    """

    angle: NDArray[np.float64]
    speed: NDArray[np.float64]
    torque: NDArray[np.float64]
    tensions: NDArray[np.float64]
    wrench_matrix: NDArray[np.float64]
    wrench: NDArray[np.float64]
    feasible: bool
    wrench_residual: float
    payload: Payload
    payload_status: PayloadStatus


@dataclass(frozen=True)
class Margins:
    """How far a set-point is from what the cables can just do, N; negative beyond it.

    Attributes
    ----------
    tension
        Distance of the tensions from the nearest of their limits. Tensions of least norm may lie on a limit where
        others that give the same wrench do not.
    wrench
        Shortest additional wrench that no tensions within the limits give; moments count as forces at 1 m. -inf
        at a singular pose.
    """

    tension: float
    wrench: float

    @classmethod
    def of(cls, setpoint: Setpoint, robot: Robot) -> Margins:
        """Compute the margins of a set-point: 0.2 ms for 8 cables, 2 ms for 16, too long for every cycle."""
        below, above = setpoint.tensions - robot.tension_min, robot.tension_max - setpoint.tensions
        try:
            reach = available_wrenches(setpoint.wrench_matrix, robot.tension_min, robot.tension_max)
            wrench = float(reach.margin(setpoint.wrench))
        except SingularWrenchMatrixError:
            wrench = -math.inf
        return cls(float(min(below.min(), above.min())), wrench)


class Feedforward:
    """Inverse kinematics and inverse dynamics along the reference.

    A change of model or of the payload's source would step the torque. The step is bridged: the difference from
    the torque before the change is added to the new one and decays at ``switch_slew``. A change of the tension
    method passes through mixtures of both methods, which give the same wrench (`TensionBlend`), at the same pace.

    Parameters
    ----------
    robot
        The robot as the controller assumes it to be.
    settings
        Everything that may change while the robot moves.

    Attributes
    ----------
    following
        Whether the motors follow the set-points: until they do, these allow for the stretch as it is; see `rest_at`.
    """

    def __init__(self, robot: Robot, settings: FeedforwardSettings) -> None:
        self._robot = robot
        self._settings = settings
        self._blend = TensionBlend(
            settings.tension_method, slew=settings.switch_slew / robot.winch.transmission_ratio
        )
        self._estimate: Payload | None = None
        self._estimate_time = -math.inf
        self._status: PayloadStatus | None = None  # of the newest set-point
        self.following = True
        self._stretch = SmoothedStretch(robot)
        self._stamp: int | None = None  # of the newest set-point
        self._bridge_pending = False
        self._offset = np.zeros(robot.number_of_cables)
        self._torque: NDArray[np.float64] | None = None  # of the newest set-point
        self._time = -math.inf  # of the newest set-point

    @property
    def settings(self) -> FeedforwardSettings:
        """Settings in use."""
        return self._settings

    def configure(self, settings: FeedforwardSettings) -> None:
        """Use other settings from the next set-point on.

        Raises
        ------
        cspr_kinematics.InvalidInputError
            If there is no such tension method.
        """
        self._blend.select(settings.tension_method)
        self._blend.slew = settings.switch_slew / self._robot.winch.transmission_ratio
        self._bridge_pending |= _load_model(settings) != _load_model(self._settings)
        self._settings = settings

    def set_estimate(self, time: float, mass: float, center_of_mass: ArrayLike) -> None:
        """Store an estimated payload.

        Parameters
        ----------
        time
            Monotonic time of its arrival, s.
        mass, center_of_mass
            kg, and (3,) in platform, m.

        Raises
        ------
        PayloadError
            If the robot cannot carry it; the previous estimate stays.
        """
        self._estimate = checked_payload(
            "estimated payload", mass, center_of_mass, self._settings.max_payload
        )
        self._estimate_time = time

    def payload_in_use(self, time: float) -> tuple[Payload, PayloadStatus]:
        """Payload that a set-point at monotonic ``time`` (s) counts on, and where it comes from."""
        if self._settings.payload_source is PayloadSource.NOMINAL:
            return self._settings.nominal_payload, PayloadStatus.NOMINAL
        if self._estimate is None:
            return self._settings.nominal_payload, PayloadStatus.AWAITED
        stale = time - self._estimate_time > self._settings.payload_timeout
        return self._estimate, PayloadStatus.HELD if stale else PayloadStatus.ESTIMATED

    def rest_at(self, tensions: NDArray[np.float64]) -> None:
        """Let set-points allow for the stretch under measured tensions (m,), N.

        They are then where the motors are. From there they go to the stretch under the model's tensions.
        """
        self._stretch.rest_at(tensions)

    def compute(self, time: float, reference: Motion, stamp: int | None = None) -> Setpoint:
        """Set-point of all motors for one reference; the numbers are the paper's equations, as in docs/model.md.

        Parameters
        ----------
        time
            Monotonic time, s, not before the last call's.
        reference
            A single point, not a batch.
        stamp
            ROS time for which it is, ns, by which the stretch goes on; that of the call if it is not known.
        """
        robot, winch, model = self._robot, self._robot.winch, self._settings.model
        pose, twist, acceleration = reference
        payload, status = self.payload_in_use(time)
        since = 0.0 if self._torque is None else max(time - self._time, 0.0)

        cables = inverse_kinematics(robot, pose)  # lengths (1)-(3), Jacobian (7)
        length_rates = cables.jacobian @ twist.vector  # (5), (6)
        if model is FeedforwardModel.DYNAMIC:
            wrench = required_wrench(robot, pose, twist, acceleration, payload)  # (8)-(13)
        else:
            wrench = static_wrench(robot, pose, payload)  # the weight alone (13)
        if self._settings.rope_weight:
            wrench = wrench + rope_wrench(robot, cables)  # not in the paper
        if model is FeedforwardModel.NONE:
            tensions, feasible, residual = np.zeros(robot.number_of_cables), True, 0.0
        else:
            limits = robot.tension_min, robot.tension_max
            found = self._blend.distribute(cables.wrench_matrix, wrench, *limits, since)  # (15)
            tensions, feasible, residual = found.tensions, bool(found.feasible), float(found.residual)
        elapsed = self._elapsed(time, stamp)
        modelled = self._settings.stretch_compensation and model is not FeedforwardModel.NONE
        if not (modelled and self.following):
            self._stretch.keep()
        else:
            self._stretch.follow(tensions, elapsed, self._settings.stretch_slew)
        motors = self._stretch.motors(cables.lengths, length_rates)
        torque = winch.motor_torque(tensions)  # (6)
        if model is FeedforwardModel.DYNAMIC and self._settings.winch_inertia:
            accelerations = length_accelerations(robot, pose, twist, acceleration)  # derivative of (5)
            turning = winch.motor_acceleration(accelerations) + motors.stretch_acceleration
            torque = torque + robot.motor.inertia * turning  # not in the paper
        torque = self._bridged(torque, status, since)
        self._torque, self._time, self._status = torque, time, status

        return Setpoint(
            motors.angle,  # (6), with stretch
            motors.speed,
            torque,
            tensions,
            cables.wrench_matrix,
            wrench,
            feasible,
            residual,
            payload,
            status,
        )

    def _elapsed(self, time: float, stamp: int | None) -> float:
        """Return the time from the last set-point to this one, s."""
        now = round(time / _NANOSECOND) if stamp is None else stamp
        since = 0 if self._stamp is None else max(now - self._stamp, 0)
        self._stamp = now
        return since * _NANOSECOND

    def _bridged(
        self, torque: NDArray[np.float64], status: PayloadStatus, since: float
    ) -> NDArray[np.float64]:
        """Return the torque of the model with what is left of the last switch, ``since`` s after the last one."""
        # An estimate that arrives for the first time, or again after a gap, is a switch too.
        gap = self._status in (PayloadStatus.HELD, PayloadStatus.AWAITED)
        switched = self._bridge_pending or (gap and status is PayloadStatus.ESTIMATED)
        if switched and self._torque is not None:
            self._offset = self._torque - torque
        else:
            step = self._settings.switch_slew * since
            self._offset = self._offset - np.minimum(np.maximum(self._offset, -step), step)
        self._bridge_pending = False
        return torque + self._offset


def _load_model(settings: FeedforwardSettings) -> tuple[object, ...]:
    """Return what the torque follows from, besides the tension method."""
    payload = settings.nominal_payload
    winches = settings.winch_inertia and settings.model is FeedforwardModel.DYNAMIC
    ropes = settings.rope_weight and settings.model is not FeedforwardModel.NONE
    return (
        settings.model,
        winches,
        ropes,
        settings.payload_source,
        payload.mass,
        *payload.center_of_mass.tolist(),
    )
