"""Tensions that follow those of the feed-forward through two poles, and the motors' part in the stretch under them."""

from __future__ import annotations

import math

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel


@kernel
def follow(wanted: FloatArray, since: float, time_constant: float, state: FloatArray) -> None:
    """Let tensions go on towards those that are wanted (m,), N, for `since` s; exact over a step of any length.

    Parameters
    ----------
    time_constant
        Of each of the two poles, s.
    state
        (3, m), in place: tensions, N, and their first and second derivatives in time.
    """
    share = since / time_constant
    left = math.exp(-share)
    for i in range(wanted.shape[0]):
        beyond, rate = state[0, i] - wanted[i], state[1, i]
        falling = rate * time_constant + beyond
        state[0, i] = wanted[i] + left * (beyond + falling * share)
        state[1, i] = left * (rate - falling * (share / time_constant))
        state[2, i] = (wanted[i] - state[0, i]) / time_constant**2 - 2.0 / time_constant * state[1, i]


@kernel
def motors_of_stretched_cables(
    lengths: FloatArray,
    rates: FloatArray,
    state: FloatArray,
    stiffness: FloatArray,
    dead_lengths: FloatArray,
    home_lengths: FloatArray,
    ratio: float,
    result: FloatArray,
) -> None:
    """Fill in what the motors must do for cables of lengths that change at rates.

    Parameters
    ----------
    lengths, rates
        (m,), m and m/s.
    state
        (3, m), as in `follow`.
    stiffness, dead_lengths, home_lengths
        (m,): EA, N; between drum and exit point, m; unstretched lengths where motor angles are zero, m.
    ratio
        Cable length per motor angle, m/rad.
    result
        (3, m): angles, rad, speeds, rad/s, and the accelerations that the stretch alone asks for, rad/s^2.
    """
    for i in range(lengths.shape[0]):
        # f + d = (l + d) / (1 + t / EA), and its derivatives by l and t
        whole, extension = lengths[i] + dead_lengths[i], 1.0 + state[0, i] / stiffness[i]
        per_newton = -whole / (stiffness[i] * extension**2)
        result[0, i] = (whole / extension - dead_lengths[i] - home_lengths[i]) / ratio
        result[1, i] = (rates[i] / extension + per_newton * state[1, i]) / ratio
        result[2, i] = per_newton * state[2, i] / ratio
