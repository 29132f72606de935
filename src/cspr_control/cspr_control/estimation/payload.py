"""The payload in real time: filtered, checked, bounded and rate-limited before the feed-forward uses it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_control.errors import MeasurementError
from cspr_control.estimation.payload_measurement import PayloadMeasurement, measure_payload
from cspr_kinematics import Payload, Pose, Robot

UPDATE_PERIOD = 0.02
"""Of the estimates, s."""


class Invalidity(Enum):
    """Why tensions and pose do not tell the payload at present."""

    NO_TENSIONS = "no cable tensions have arrived"
    NO_POSE = "no platform pose has arrived"
    STALE_TENSIONS = "the cable tensions are too old"
    STALE_POSE = "the platform pose is too old"
    SLACK_CABLE = "a cable is slack"
    MOVING_TOO_FAST = "the platform moves too fast"
    TURNING_TOO_FAST = "the platform turns too fast"
    NOT_VERTICAL = "the cables pull sideways, as on a platform that accelerates"


@dataclass(frozen=True)
class EstimatorSettings:
    """The parameters of `PayloadEstimator`, with meanings and units in `cspr_msgs_py.parameters.table`.

    Below ``minimum_mass`` the centre of mass would be a quotient of measurement errors; above ``max_speed`` and
    ``max_angular_speed`` the static balance is not believed.
    """

    time_constant: float
    mass_rate_limit: float
    center_rate_limit: float
    max_payload: float
    max_offset: float
    minimum_mass: float
    payload_height: float
    slack_tension: float
    max_speed: float
    max_angular_speed: float
    max_sideways_ratio: float
    tensions_timeout: float
    pose_timeout: float


@dataclass(frozen=True, eq=False)
class PayloadEstimate:
    """State of the estimation.

    Attributes
    ----------
    published
        Filtered, bounded and rate-limited: what the feed-forward may use.
    raw
        The newest measurement, valid or not; None before the first.
    filtered_mass
        Low-passed payload mass, kg, before bounds and rate limit; NaN before the first valid measurement.
    filtered_center
        x and y (2,) that belong to it, m, in platform; zero below the minimum mass.
    invalidities
        Why the newest measurement was not used; empty if it was.
    samples
        Number of valid measurements so far.
    stamp
        ROS time of the newest input that took part in ``published``, ns; 0 before the first.
    """

    published: Payload
    raw: PayloadMeasurement | None
    filtered_mass: float
    filtered_center: NDArray[np.float64]
    invalidities: tuple[Invalidity, ...]
    samples: int
    stamp: int

    @property
    def valid(self) -> bool:
        """Whether the newest measurement was used."""
        return not self.invalidities


class PayloadEstimator:
    """Estimates the payload from measured tensions at the estimated pose.

    Tensions arrive at the bus rate and are averaged between two updates. The mass and the first moments are
    filtered, because they depend linearly on the tensions; the centre of mass is their quotient. The first
    valid measurements are averaged until they span the time constant: nothing ramps up from zero. What is
    published follows within bounds and at a limited rate, and stays as it is while the measurement is not
    valid.

    Time is monotonic time of arrival, s; stamps are ROS time, ns.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    settings
        Settings; may be replaced at any time.
    initial
        Published before the first valid measurement, and where the rate limit starts.

    Attributes
    ----------
    newest
        Result of the last update.
    """

    def __init__(self, robot: Robot, settings: EstimatorSettings, initial: Payload | None = None) -> None:
        self.settings = settings
        self._robot = robot
        self._tension_sum = np.zeros(robot.number_of_cables)
        self._tension_count = 0
        self._tensions_time = -math.inf
        self._tensions_stamp = 0
        self._pose: Pose | None = None
        self._pose_time = -math.inf
        self._pose_stamp = 0
        self._speed = 0.0
        self._angular_speed = 0.0
        self._update_time = math.nan
        self._filtered = np.zeros(3)  # mass, first moments about y and x: m, m x, m y
        payload = Payload.none() if initial is None else initial
        self.newest = PayloadEstimate(payload, None, math.nan, np.zeros(2), (Invalidity.NO_TENSIONS,), 0, 0)

    def observe_tensions(self, time: float, stamp: int, tensions: ArrayLike) -> None:
        """Store measured tensions (m,), N.

        Raises
        ------
        MeasurementError
            If they are not m finite numbers; they are then not used.
        """
        tensions = np.asarray(tensions, dtype=float)
        if tensions.shape != self._tension_sum.shape or not np.isfinite(tensions).all():
            raise MeasurementError(
                f"tensions are {tensions.tolist()}; {len(self._tension_sum)} finite numbers are needed"
            )
        self._tension_sum += tensions
        self._tension_count += 1
        self._tensions_time, self._tensions_stamp = time, stamp

    def observe_pose(self, time: float, stamp: int, pose: Pose) -> None:
        """Store an estimated pose; its speed follows from the difference to the previous one."""
        elapsed = (stamp - self._pose_stamp) * 1e-9
        if self._pose is not None and 0.0 < elapsed <= self.settings.pose_timeout:
            turn = pose.rotation @ self._pose.rotation.T
            sine = 0.5 * math.hypot(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
            self._speed = float(np.linalg.norm(pose.position - self._pose.position)) / elapsed
            self._angular_speed = math.asin(min(sine, 1.0)) / elapsed
        self._pose, self._pose_time, self._pose_stamp = pose, time, stamp

    def update(self, time: float) -> PayloadEstimate:
        """Estimate the payload from what has arrived since the last update."""
        step = time - self._update_time
        self._update_time = time
        previous = self.newest
        if self._pose is None or (self._tension_count == 0 and previous.raw is None):
            cause = Invalidity.NO_POSE if self._pose is None else Invalidity.NO_TENSIONS
            self._mean_tensions()  # without a pose they are of no use later either
            return self._hold(None, (cause,))
        stale = self._staleness(time)
        if self._tension_count == 0:
            return self._hold(previous.raw, stale) if stale else previous
        tensions = self._mean_tensions()
        raw = measure_payload(self._robot, self._pose, tensions, self.settings.payload_height)
        invalidities = (*stale, *self._disturbances(raw, tensions))
        if invalidities:
            return self._hold(raw, invalidities)
        return self._accept(raw, step if math.isfinite(step) else 0.0)

    def _mean_tensions(self) -> NDArray[np.float64]:
        mean = self._tension_sum / max(self._tension_count, 1)
        self._tension_sum = np.zeros_like(self._tension_sum)
        self._tension_count = 0
        return mean

    def _staleness(self, time: float) -> tuple[Invalidity, ...]:
        checks = (
            (Invalidity.STALE_TENSIONS, time - self._tensions_time > self.settings.tensions_timeout),
            (Invalidity.STALE_POSE, time - self._pose_time > self.settings.pose_timeout),
        )
        return tuple(cause for cause, present in checks if present)

    def _disturbances(self, raw: PayloadMeasurement, tensions: NDArray[np.float64]) -> tuple[Invalidity, ...]:
        settings = self.settings
        sideways = math.hypot(raw.wrench[0], raw.wrench[1])
        checks = (
            (Invalidity.SLACK_CABLE, tensions.min() < settings.slack_tension),
            (Invalidity.MOVING_TOO_FAST, self._speed > settings.max_speed),
            (Invalidity.TURNING_TOO_FAST, self._angular_speed > settings.max_angular_speed),
            (Invalidity.NOT_VERTICAL, sideways > settings.max_sideways_ratio * abs(raw.wrench[2])),
        )
        return tuple(cause for cause, present in checks if present)

    def _hold(self, raw: PayloadMeasurement | None, invalidities: tuple[Invalidity, ...]) -> PayloadEstimate:
        self.newest = replace(self.newest, raw=raw, invalidities=invalidities)
        return self.newest

    def _accept(self, raw: PayloadMeasurement, step: float) -> PayloadEstimate:
        settings, last = self.settings, self.newest
        samples = last.samples + 1
        # The mean of the first samples, until its weight falls to that of the low-pass.
        weight = max(1.0 / samples, -math.expm1(-step / settings.time_constant))
        self._filtered = self._filtered + weight * (np.array([raw.mass, *raw.moment]) - self._filtered)
        mass = float(self._filtered[0])
        center = self._filtered[1:] / mass if mass > settings.minimum_mass else np.zeros(2)
        self.newest = PayloadEstimate(
            self._limited(last.published, mass, center, step),
            raw,
            mass,
            center,
            (),
            samples,
            max(self._tensions_stamp, self._pose_stamp),
        )
        return self.newest

    def _limited(self, last: Payload, mass: float, center: NDArray[np.float64], step: float) -> Payload:
        settings, offset = self.settings, self.settings.max_offset
        mass_step, center_step = settings.mass_rate_limit * step, settings.center_rate_limit * step
        published_mass = _moved(last.mass, mass, 0.0, settings.max_payload, mass_step)
        published_center = [
            _moved(before, goal, -offset, offset, center_step)
            for before, goal in zip(last.center_of_mass[:2].tolist(), center.tolist(), strict=True)
        ]
        return Payload(published_mass, [*published_center, settings.payload_height])


def _moved(before: float, goal: float, lowest: float, highest: float, step: float) -> float:
    """Return a number moved towards its goal, or the bound before that, by no more than a step."""
    change = min(max(goal, lowest), highest) - before
    return before + min(max(change, -step), step)
