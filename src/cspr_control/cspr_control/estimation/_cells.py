"""What readings and motors say of the load cells in one cycle."""

from __future__ import annotations

import math

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel


@kernel
def note_readings(time: float, readings: FloatArray, last: FloatArray, changed: FloatArray) -> None:
    """Keep the last readings (m,) and the times (m,), s, at which each last showed another value."""
    for i in range(readings.shape[0]):
        if readings[i] != last[i]:
            last[i], changed[i] = readings[i], time


@kernel
def longest_still(time: float, changed: FloatArray) -> tuple[int, float]:
    """Return the index of the reading that has stood still longest, and for how long, s; infinite before the first."""
    longest = 0
    for i in range(changed.shape[0]):
        if changed[i] < changed[longest]:
            longest = i
    return longest, time - changed[longest]


@kernel
def tensions_of_motors(
    before: float,
    period: float,
    ratio: float,
    inertia: float,
    coulomb: float,
    viscous: float,
    friction_speed: float,
    inertia_error: float,
    unmodelled: float,
    angles: FloatArray,
    torques: FloatArray,
    result: FloatArray,
) -> None:
    """Solve the balance of each motor's shaft for the tension of its cable.

    Parameters
    ----------
    before, period
        From the first cycle to the second, and from the second to the third, s.
    ratio
        Cable length per motor angle, m/rad.
    inertia, coulomb, viscous
        Of the motor, kg m^2, N m and N m s/rad.
    friction_speed
        Above which the direction of friction is known, rad/s.
    inertia_error
        Share of the inertia that is uncertain.
    unmodelled
        Standard deviation of what neither friction nor inertia explain, N.
    angles, torques
        (3, m): of three cycles, the oldest first, rad and N m.
    result
        (2, m): tensions in the cycle in the middle, N, and their variances, N^2.
    """
    span = before + period
    for i in range(angles.shape[1]):
        early = (angles[1, i] - angles[0, i]) / before
        late = (angles[2, i] - angles[1, i]) / period
        speed = (before * late + period * early) / span
        acceleration = 2.0 * (late - early) / span
        # a mean that weighs the torque as the second difference weighs the motion: as a triangle over both periods
        sides = before * torques[0, i] + period * torques[2, i]
        torque = (sides + 2.0 * span * torques[1, i]) / (3.0 * span)
        direction = math.tanh(speed / friction_speed)
        friction = coulomb * direction + viscous * speed
        result[0, i] = (inertia * acceleration - torque + friction) / ratio
        stiction = (1.0 - direction**2) * (coulomb / ratio) ** 2
        result[1, i] = unmodelled**2 + stiction + (inertia_error * inertia * acceleration / ratio) ** 2
