"""The payload of a platform in any motion: its mass and first moment from the balance of forces and moments."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_control.estimation._motion_balance import balance_in_motion
from cspr_control.estimation._payload_filter import UNKNOWNS, estimate, open_filter, smooth
from cspr_control.estimation.observation import Found, Held, Observation
from cspr_kinematics import Payload, Robot

_SETTLED = 5.0  # time constants until what two poles hold is 96 % of cycles without a gap
_LONGEST_DELAY = 64  # cycles


@dataclass(frozen=True)
class MotionSettings:
    """The parameters of `MotionFilter`, with meanings and units in `cspr_msgs_py.parameters.table`."""

    time_constant: float
    mass_walk: float
    moment_walk: float
    force_noise: float
    moment_noise: float
    change_mass: float
    max_acceleration: float
    tension_skew: float
    payload_height: float
    max_offset: float
    minimum_mass: float


class MotionFilter:
    """Kalman filter on theta = (m, m c), the payload's mass and first moment in platform.

    What the cables pull less what the platform alone needs is linear in theta, y = Y(Q, omega, a, alpha) theta, in
    whatever motion; the feed-forward does not appear in it, so that the estimate is no loop. The acceleration is the
    second difference of the pose, and the wrench is weighed alike (`balance_in_motion`). Both sides then pass the same
    two poles, which leaves y = Y theta as it is and takes away the noise. A step of the mass is found by the two
    cumulative sums of Page (Biometrika 41, 1954), which open the filter for a while; rows that a push from the side
    disturbs count less where they do not fit (Huber, Ann. Math. Stat. 35, 1964).

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    settings
        May be replaced at any time.
    payload
        Where the estimate begins.

    Attributes
    ----------
    alarms
        Number of changes of the mass that were detected.
    unexplained
        Wrench of all cells (6,) less that of platform and payload in the newest cycle, unfiltered, N and N m; None
        without a balance.
    """

    def __init__(self, robot: Robot, settings: MotionSettings, payload: Payload) -> None:
        self.settings = settings
        self.alarms = 0
        self.unexplained: NDArray[np.float64] | None = None
        units = np.eye(UNKNOWNS, 10)
        self._parameters = np.vstack((robot.platform.inertial_parameters, units))
        self._payload, self._covariance = np.zeros(UNKNOWNS), np.zeros((UNKNOWNS, UNKNOWNS))
        self.begin_at(payload)
        open_filter(self._covariance, settings.change_mass)
        self._detection = np.zeros(3)
        self._residual = np.zeros(6)
        # of the balance
        self._counts = np.zeros(3, dtype=np.int64)
        self._steps, self._turning = np.zeros(1), np.zeros(3)
        self._positions, self._rotations, self._wrenches = (
            np.zeros((2, 3)),
            np.zeros((1, 3, 3)),
            np.zeros((2, 6)),
        )
        self._twist, self._acceleration, self._column = np.zeros((1, 6)), np.zeros((1, 6)), np.zeros((1, 6))
        self._line = np.zeros((_LONGEST_DELAY, 6, 1 + UNKNOWNS))
        self._pull, self._model = np.zeros(6), np.zeros((6, 1 + UNKNOWNS))
        # of the poles
        self._age = 0.0
        self._balance, self._first, self._second = (np.zeros((6, 1 + UNKNOWNS)) for _ in range(3))

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of mass and moment by the filter's own account, kg and kg m, the larger of x and y."""
        mass, *moment = np.sqrt(self._covariance.diagonal()[:3]).tolist()
        return mass, max(moment)

    def begin_at(self, payload: Payload) -> None:
        """Let the estimate begin at a payload that is in use; should it be another one, that is a change to detect."""
        settings = self.settings
        self._payload[:] = payload.mass, *payload.first_moment
        moment, height = (settings.max_offset * mass for mass in (settings.minimum_mass, payload.mass))
        self._covariance[:] = np.diag(np.square([settings.change_mass, moment, moment, max(moment, height)]))

    def restart(self) -> None:
        """Begin the differences and the poles anew; what is known of the payload stays."""
        self._counts[:] = 0
        self._age = 0.0
        self._first[:] = 0.0
        self._second[:] = 0.0

    def reopen(self) -> None:
        """Begin anew because another cell is left out, or none: what it told of the payload may have been wrong."""
        self.restart()
        open_filter(self._covariance, self.settings.change_mass)

    def observe(
        self, observation: Observation, wait: Held | None, excluded: int | None = None
    ) -> Held | Found:
        """Take what a cycle says; return what is known then, or why the estimate stays as it is.

        Parameters
        ----------
        observation
            Of the cycle.
        wait
            Why the estimate must not follow yet, if so; what is observed meanwhile fills the differences and the poles.
        excluded
            Cable whose tension is not believed, from 0: what it might have pulled is taken out of the balance.
        """
        settings, step = self.settings, observation.step
        if not math.isfinite(step):
            self.restart()
        ready = balance_in_motion(
            step, settings.tension_skew, observation.position, observation.rotation, observation.wrench,
            self._parameters,
            self._counts, self._steps, self._positions, self._rotations, self._wrenches, self._turning, self._twist,
            self._acceleration, self._column, self._line, self._pull, self._model,
        )  # fmt: skip
        self.unexplained = None
        if not ready:
            return Held.STARTING
        if abs(self._acceleration[0, 2]) > settings.max_acceleration:
            self.restart()
            return Held.JOLT
        self._balance[:, 0] = self._pull - self._model[:, 0]
        self._balance[:, 1:] = self._model[:, 1:]
        self.unexplained = self._balance[:, 0] - self._balance[:, 1:] @ self._payload
        if excluded is not None:
            column = observation.jacobian[excluded]
            self._balance -= np.outer(column, column @ self._balance) / (column @ column)
        smooth(step, settings.time_constant, self._balance, self._first, self._second)
        self._age += step
        if self._age < _SETTLED * settings.time_constant:
            return Held.STARTING
        if wait is not None:
            return wait
        self.alarms += estimate(
            step, settings.time_constant, settings.mass_walk, settings.moment_walk, settings.force_noise,
            settings.moment_noise, settings.change_mass, settings.payload_height, settings.max_offset,
            settings.minimum_mass, self._second, self._payload, self._covariance, self._detection, self._residual,
        )  # fmt: skip
        return Found(float(self._payload[0]), self._payload[1:].copy(), -self._residual)
