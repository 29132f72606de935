"""What the estimate of the payload feeds back through the feed-forward, by either method, linearised about rest."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are

from cspr_control.estimation._payload_filter import UNKNOWNS, open_filter
from cspr_control.estimation.motion_filter import MotionSettings
from cspr_control.estimation.payload_measurement import measure_payload
from cspr_control.estimation.static_filter import StaticSettings
from cspr_control.stability.linear_plant import LinearPlant, displaced
from cspr_control.stability.payload_path import (
    FeedforwardPath,
    LinearObservation,
    PayloadLoop,
    payload_wrenches,
)
from cspr_control.stability.sampled_loop import SetpointDeviation
from cspr_kinematics import static_wrench

FloatArray = NDArray[np.float64]

_STEP, _WRENCH_STEP = 1e-6, 1e-2  # m and rad, N and N m, of central differences


class StaticFeedback:
    """`StaticFilter`: weighs what the cables pull, and low-passes it; a loop with positive feedback.

    State: the filtered payload, mass, kg, and first moments about x and y, kg m; then those of the observation and of
    the path of the feed-forward.

    Parameters
    ----------
    loop
        That it closes.
    settings
        Of the filter.
    """

    def __init__(self, loop: PayloadLoop, settings: StaticSettings) -> None:
        self._period = loop.period
        self._observe = LinearObservation(loop)
        self._path = FeedforwardPath(loop)
        self._weight = -math.expm1(-loop.period / settings.time_constant)
        self._by_displacement, self._by_wrench = _measurement_slopes(loop.plant, loop.payload_height)
        self._ends = np.cumsum([3, self._observe.size])
        self.size = int(self._ends[-1]) + self._path.size

    def with_time_constant(self, time_constant: float) -> StaticFeedback:
        """Return the same with another filter."""
        other = copy(self)
        other._weight = -math.expm1(-self._period / time_constant)
        return other

    def setpoint(self, state: FloatArray) -> SetpointDeviation:
        """Return what a state makes of the set-points."""
        return self._path.setpoint(state[self._ends[-1] :])

    def advance(self, state: FloatArray, angles: FloatArray, tensions: FloatArray, gain: float) -> FloatArray:
        """Return the state after a SYNC; the set-point of the next one counts on the estimate of the one before."""
        filtered, observed, path = np.split(state, self._ends)
        path = self._path.advance(path, gain * filtered)
        observed, displacement, wrench = self._observe(observed, angles, tensions)
        measured = self._by_displacement @ displacement + self._by_wrench @ wrench
        return np.concatenate((filtered + self._weight * (measured - filtered), observed, path))


class MotionFeedback:
    """`MotionFilter`: a balance y = Y theta, both sides through two poles, then a Kalman filter with its settled gain.

    The deviation of y - Y theta does not contain the feed-forward: where the cables are known, this is no loop. What is
    left of one is due to differences, sampling and latency. The height of the payload's centre of mass, which a weight
    does not tell, is as assumed; theta is mass, kg, and first moments about x and y, kg m.

    State: displacements and wrenches of the last two cycles, the model's side of the balance of earlier cycles, both
    poles of the balance, the estimate, and those of the observation and of the path of the feed-forward.

    Parameters
    ----------
    loop
        That it closes.
    settings
        Of the filter.
    is_open
        Whether the filter is judged as it is for a moment after a change of the mass was detected.
    """

    def __init__(self, loop: PayloadLoop, settings: MotionSettings, is_open: bool = False) -> None:
        self._plant, self._period, self._is_open = loop.plant, loop.period, is_open
        self._observe = LinearObservation(loop)
        self._path = FeedforwardPath(loop)
        self._rows = payload_wrenches(loop.plant, loop.payload_height)
        whole, self._share = divmod(settings.tension_skew / loop.period, 1.0)
        self._whole = int(whole)
        self._ends = np.cumsum([6, 6, 6, 6, 6 * (self._whole + 1), 6, 6, 3, self._observe.size])
        self.size = int(self._ends[-1]) + self._path.size
        self._use(settings)

    def with_time_constant(self, time_constant: float) -> MotionFeedback:
        """Return the same with other poles."""
        other = copy(self)
        other._use(replace(self._settings, time_constant=time_constant))
        return other

    def _use(self, settings: MotionSettings) -> None:
        self._settings = settings
        self._weight = -math.expm1(-self._period / settings.time_constant)
        self._gain = self._kalman_gain()

    def setpoint(self, state: FloatArray) -> SetpointDeviation:
        """Return what a state makes of the set-points."""
        return self._path.setpoint(state[self._ends[-1] :])

    def advance(self, state: FloatArray, angles: FloatArray, tensions: FloatArray, gain: float) -> FloatArray:
        """Return the state after a SYNC; the set-point of the next one counts on the estimate of the one before."""
        last, older, wrench_before, wrench_older, line, first, second, estimate, observed, path = np.split(
            state, self._ends
        )
        path = self._path.advance(path, gain * estimate)
        observed, displacement, wrench = self._observe(observed, angles, tensions)
        acceleration = (displacement - 2.0 * last + older) / self._period**2
        needed = self._plant.mass_matrix @ acceleration + self._plant.weight_slope @ last
        line = np.concatenate((needed, line))  # the newest first
        newer, behind = (line[6 * k : 6 * k + 6] for k in (self._whole, self._whole + 1))
        pull = (wrench_older + 4.0 * wrench_before + wrench) / 6.0
        balance = pull - (1.0 - self._share) * newer - self._share * behind
        first = first + self._weight * (balance - first)
        second = second + self._weight * (first - second)
        estimate = estimate + self._gain @ (second - self._rows @ estimate)
        balance_memory = (displacement, last, wrench, wrench_before, line[:-6])
        return np.concatenate((*balance_memory, first, second, estimate, observed, path))

    def _kalman_gain(self) -> FloatArray:
        """Return the gain (3, 6) that the filter comes to at rest, or has while it is open."""
        settings, period, Y = self._settings, self._period, self._rows
        walks = np.array([settings.mass_walk, settings.moment_walk, settings.moment_walk])
        noise = np.repeat([settings.force_noise, settings.moment_noise], 3)
        R = np.diag(noise**2 * (1.0 + 4.0 * settings.time_constant / period))
        if self._is_open:
            P = np.zeros((UNKNOWNS, UNKNOWNS))
            open_filter(P, settings.change_mass)
            P = P[:3, :3]
        else:
            P = solve_discrete_are(np.eye(3), Y.T, np.diag(walks**2 * period), R)
        return np.asarray(P @ Y.T @ np.linalg.inv(Y @ P @ Y.T + R))


def _measurement_slopes(plant: LinearPlant, payload_height: float) -> tuple[FloatArray, FloatArray]:
    """Return how a static measurement of mass and moments follows displacement and wrench, (3, 6) both."""
    weight = static_wrench(plant.robot, plant.pose, plant.payload)

    def measured(displacement: FloatArray, change: FloatArray) -> FloatArray:
        found = measure_payload(
            plant.robot, displaced(plant.pose, displacement).rotation, weight + change, payload_height
        )
        return np.array([found.mass, *found.moment])

    same = np.zeros(6)
    by_displacement = [
        (measured(step, same) - measured(-step, same)) / (2.0 * _STEP) for step in _STEP * np.eye(6)
    ]
    by_wrench = [
        (measured(same, step) - measured(same, -step)) / (2.0 * _WRENCH_STEP)
        for step in _WRENCH_STEP * np.eye(6)
    ]
    return np.array(by_displacement).T, np.array(by_wrench).T
