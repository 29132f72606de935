"""Kalman filter of the payload's mass and first moment, with change detection (docs/model.md, section 10)."""

from __future__ import annotations

import math

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel

UNKNOWNS = 4  # m, m c_x, m c_y, m c_z

# Rows that a push from the side or a swinging load disturbs: F_x, F_y, M_z. They say little of a payload at rest.
_SIDE_ROWS = (0, 1, 5)
_FIRST_MOMENT = 3  # row: moments come after forces
_VERTICAL = 2  # row, F_z

_LARGEST_INNOVATION = 3.0  # standard deviations, beyond which a row of a side counts less (Huber's weight)
_DRIFT = 0.5  # of the change detection, in the size of a change
_ALARM = 1.6  # time constants for which a change, less the drift, is seen before it counts as one
_OPEN = 6.0  # time constants for which the filter is open after a change
_OPEN_CHANGES = 40.0  # standard deviation of the mass while it is open, in the size of a change
_OPEN_LEVER = 0.05  # m, of the moment over that of the mass
_HEIGHT_TIME = 20.0  # s in which the height of the centre of mass returns to the assumed one
# m/s^2 across the platform's vertical, by tilting or accelerating; less than this does not tell a height: it would be
# learned from the noise of poses and tensions, which have the same origin
_LEAST_ACROSS = 0.3
_LEAST_GRAVITY = 1.0  # m/s^2; less of the vertical balance says nothing of a mass


@kernel
def smooth(
    step: float, time_constant: float, values: FloatArray, first: FloatArray, second: FloatArray
) -> None:
    """Let two poles of one time constant, s, follow values (n, k), in place; of these the second is the result."""
    share = -math.expm1(-step / time_constant)
    for i in range(values.shape[0]):
        for k in range(values.shape[1]):
            first[i, k] += share * (values[i, k] - first[i, k])
            second[i, k] += share * (first[i, k] - second[i, k])


@kernel
def open_filter(covariance: FloatArray, change: float) -> None:
    """Let mass and horizontal first moment be anything: an unknown load was put on, far larger than a `change`, kg."""
    mass = _OPEN_CHANGES * change
    moment = _OPEN_LEVER * mass
    covariance[0, 0] = max(covariance[0, 0], mass * mass)
    for k in (1, 2):
        covariance[k, k] = max(covariance[k, k], moment * moment)


@kernel
def estimate(
    step: float,
    time_constant: float,
    mass_walk: float,
    moment_walk: float,
    force_noise: float,
    moment_noise: float,
    change: float,
    height: float,
    height_deviation: float,
    least_mass: float,
    balance: FloatArray,
    payload: FloatArray,
    covariance: FloatArray,
    detection: FloatArray,
    residual: FloatArray,
) -> bool:
    """Estimate from the smoothed balance y = Y theta; return whether the payload is found to have changed.

    Parameters
    ----------
    step, time_constant
        Since the last estimate, and of each of the two poles by which the balance was smoothed, s.
    mass_walk, moment_walk
        Of the random walk, kg and kg m in the square root of a second.
    force_noise, moment_noise
        Of the balance before it was smoothed, N and N m.
    change
        Size of a change of the mass that is to be detected, kg.
    height, height_deviation, least_mass
        Assumed z of the centre of mass and its standard deviation, m, for no less than a mass, kg.
    balance
        (6, 5): y, and the columns of Y.
    payload, covariance
        theta (4,) and its covariance (4, 4), in place.
    detection
        (3,), in place: two sums of the change detection, and for how much longer the filter is open, s.
    residual
        Result (6,): y - Y theta.
    """
    # the height, which a weight does not tell, returns to what is assumed
    keep = math.exp(-step / _HEIGHT_TIME)
    assumed = payload[0] * height
    payload[3] = assumed + keep * (payload[3] - assumed)
    for k in range(UNKNOWNS):
        covariance[3, k] *= keep
        covariance[k, 3] *= keep
    spread = height_deviation * max(payload[0], least_mass)
    covariance[3, 3] += (1.0 - keep * keep) * spread * spread
    covariance[0, 0] += mass_walk * mass_walk * step
    covariance[1, 1] += moment_walk * moment_walk * step
    covariance[2, 2] += moment_walk * moment_walk * step

    alarm = False
    if balance[_VERTICAL, 1] > _LEAST_GRAVITY:
        error = balance[_VERTICAL, 0]
        for k in range(UNKNOWNS):
            error -= balance[_VERTICAL, 1 + k] * payload[k]
        seen = error / balance[_VERTICAL, 1] / change
        detection[0] = max(0.0, detection[0] + (seen - _DRIFT) * step / time_constant)
        detection[1] = max(0.0, detection[1] - (seen + _DRIFT) * step / time_constant)
        alarm = max(detection[0], detection[1]) > _ALARM
    if alarm:
        detection[2] = _OPEN * time_constant
    if detection[2] > 0.0:
        detection[2] -= step
        detection[0] = detection[1] = 0.0
        open_filter(covariance, change)

    # two poles make the noise of neighbouring cycles alike: as much as is left of one in four time constants
    correlated = 1.0 + 4.0 * time_constant / step
    row, gain, column = residual[:UNKNOWNS].copy(), residual[:UNKNOWNS].copy(), residual[:UNKNOWNS].copy()
    across = 0.0
    for i in range(_FIRST_MOMENT, 6):
        across += balance[i, UNKNOWNS] * balance[i, UNKNOWNS]
    telling = 1.0 if across > _LEAST_ACROSS * _LEAST_ACROSS else 0.0
    for i in range(6):
        for k in range(UNKNOWNS):
            column[k] = balance[i, 1 + k]
        column[3] *= telling
        noise = force_noise if i < _FIRST_MOMENT else moment_noise
        variance = noise * noise * correlated
        innovation = balance[i, 0]
        for k in range(UNKNOWNS):
            innovation -= balance[i, 1 + k] * payload[k]
            row[k] = 0.0
            for j in range(UNKNOWNS):
                row[k] += covariance[k, j] * column[j]
            variance += row[k] * column[k]
        weight = 1.0
        if i in _SIDE_ROWS:
            weight = max(1.0, abs(innovation) / (_LARGEST_INNOVATION * math.sqrt(variance)))
        for k in range(UNKNOWNS):
            gain[k] = row[k] / (variance * weight)
            payload[k] += gain[k] * innovation
        for k in range(UNKNOWNS):
            for j in range(UNKNOWNS):
                covariance[k, j] -= gain[k] * row[j]
    for k in range(UNKNOWNS):
        for j in range(k):
            covariance[k, j] = covariance[j, k] = 0.5 * (covariance[k, j] + covariance[j, k])
    for i in range(6):
        residual[i] = balance[i, 0]
        for k in range(UNKNOWNS):
            residual[i] -= balance[i, 1 + k] * payload[k]
    return alarm
