"""Rotation, angular velocity and angular acceleration of a motion given by the Euler angles of eq. 4."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics import Acceleration, Pose, Twist

Angles = tuple[float, float, float]
"""alpha, beta and gamma of eq. 4, about z, y and x."""


def euler_motion(
    position: NDArray[np.float64],
    velocity: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    angles: Angles,
    angle_rates: Angles,
    angle_accelerations: Angles,
) -> tuple[Pose, Twist, Acceleration]:
    """Motion of a frame whose orientation is ``Q = Rz(alpha) Ry(beta) Rx(gamma)``.

    The angular velocity is the sum of the three rates, each about its own axis carried along by the rotations
    before it: ``omega = alpha' z + beta' Rz y + gamma' Rz Ry x``. Its derivative adds the turning of those
    axes.

    Parameters
    ----------
    position, velocity, acceleration
        Of the origin, each (3,), in base: m, m/s and m/s^2.
    angles, angle_rates, angle_accelerations
        alpha, beta, gamma (rad) and their first and second time derivative.

    Returns
    -------
    The pose, twist and acceleration; the angular parts are in base axes.
    """
    alpha, beta, gamma = angles
    alpha_rate, beta_rate, gamma_rate = angle_rates
    sin_a, cos_a, sin_b, cos_b = math.sin(alpha), math.cos(alpha), math.sin(beta), math.cos(beta)
    sin_g, cos_g = math.sin(gamma), math.cos(gamma)
    # Axes of the three rotations in base: z, Rz y and Rz Ry x. The last is the first column of Q.
    axes = np.array([[0.0, 0.0, 1.0], [-sin_a, cos_a, 0.0], [cos_a * cos_b, sin_a * cos_b, -sin_b]])
    # Products of the axes: z x Rz y, z x Rz Ry x and Rz y x Rz Ry x.
    products = np.array(
        [
            [-cos_a, -sin_a, 0.0],
            [-sin_a * cos_b, cos_a * cos_b, 0.0],
            [-cos_a * sin_b, -sin_a * sin_b, -cos_b],
        ]
    )
    Q = np.empty((3, 3))
    Q[:, 0] = axes[2]
    Q[:, 1] = cos_g * axes[1] - sin_g * products[2]
    Q[:, 2] = -sin_g * axes[1] - cos_g * products[2]
    turning = np.array([alpha_rate * beta_rate, alpha_rate * gamma_rate, beta_rate * gamma_rate])
    return (
        Pose(position, Q),
        Twist(velocity, np.array(angle_rates) @ axes),
        Acceleration(acceleration, np.array(angle_accelerations) @ axes + turning @ products),
    )
