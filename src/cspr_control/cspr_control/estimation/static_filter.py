"""The payload of a platform that moves slowly: the static balance, low-passed (eqs. 16 and 17)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_control.estimation.observation import Found, Held, Observation
from cspr_control.estimation.payload_measurement import measure_payload
from cspr_kinematics import Payload, Robot

_SPEED_TIME = 0.02  # s over which speeds are taken: a pose is known to some hundredths of a millimetre


@dataclass(frozen=True)
class StaticSettings:
    """The parameters of `StaticFilter`, with meanings and units in `cspr_msgs_py.parameters.table`.

    Above ``max_speed`` and ``max_angular_speed`` the static balance is not believed.
    """

    time_constant: float
    max_speed: float
    max_angular_speed: float
    max_sideways_ratio: float
    payload_height: float


class StaticFilter:
    """Estimates the payload from the wrench of the cables as if the platform stood still.

    Mass and first moments are filtered, because they depend linearly on the tensions. The first valid measurements
    are averaged until they span the time constant: nothing ramps up from zero.

    Parameters are those of `MotionFilter`.
    """

    alarms = 0
    deviations = (math.nan, math.nan)  # it has no account of its own

    def __init__(self, robot: Robot, settings: StaticSettings, payload: Payload) -> None:
        self.settings = settings
        self._robot = robot
        self._samples = 0
        self._filtered = np.zeros(3)  # mass, first moments along x and y
        self.begin_at(payload)
        self._pose: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
        self._elapsed = 0.0
        self._speed = 0.0
        self._angular_speed = 0.0

    def begin_at(self, payload: Payload) -> None:
        """Let the estimate begin at a payload; the first measurement takes its place."""
        self._filtered = np.array([payload.mass, *payload.first_moment[:2]])

    def restart(self) -> None:
        """Begin the speeds anew."""
        self._pose = None
        self._speed = self._angular_speed = 0.0

    def observe(
        self, observation: Observation, wait: Held | None, excluded: int | None = None
    ) -> Held | Found:
        """Take what a cycle says; see `MotionFilter.observe`. Without one of the cells nothing can be said."""
        self._observe_pose(observation)
        raw = measure_payload(
            self._robot, observation.rotation, observation.wrench, self.settings.payload_height
        )
        settings = self.settings
        sideways = math.hypot(observation.wrench[0], observation.wrench[1])
        if wait is not None:
            return wait
        for cause, present in (
            (Held.EXCLUDED, excluded is not None),
            (Held.MOVING_TOO_FAST, self._speed > settings.max_speed),
            (Held.TURNING_TOO_FAST, self._angular_speed > settings.max_angular_speed),
            (Held.NOT_VERTICAL, sideways > settings.max_sideways_ratio * abs(observation.wrench[2])),
        ):
            if present:
                return cause
        self._samples += 1
        step = observation.step if math.isfinite(observation.step) else 0.0
        # the mean of the first samples, until its weight falls to that of the low-pass
        weight = max(1.0 / self._samples, -math.expm1(-step / settings.time_constant))
        self._filtered = self._filtered + weight * (np.array([raw.mass, *raw.moment]) - self._filtered)
        mass = float(self._filtered[0])
        moment = np.array([*self._filtered[1:], mass * settings.payload_height])
        return Found(mass, moment, None)

    def _observe_pose(self, observation: Observation) -> None:
        if self._pose is None or not math.isfinite(observation.step):
            self.restart()
            self._pose, self._elapsed = (observation.position.copy(), observation.rotation.copy()), 0.0
            return
        self._elapsed += observation.step
        if self._elapsed < _SPEED_TIME:
            return
        position, rotation = self._pose
        turn = observation.rotation @ rotation.T
        sine = 0.5 * math.hypot(turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1])
        self._speed = float(np.linalg.norm(observation.position - position)) / self._elapsed
        self._angular_speed = math.asin(min(sine, 1.0)) / self._elapsed
        self._pose, self._elapsed = (observation.position.copy(), observation.rotation.copy()), 0.0
