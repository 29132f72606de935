"""The mathematics of a control cycle in plain numpy, to compare the compiled kernels with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics import GRAVITY, Acceleration, Payload, Pose, Robot, Twist

FloatArray = NDArray[np.float64]
_NEXT, _AFTER_NEXT = np.array([1, 2, 0]), np.array([2, 0, 1])
_REGULARISATION = 1e-9  # where fewer than 6 cables are free
_MOST_STEPS = 50


def cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return a.take(_NEXT, -1) * b.take(_AFTER_NEXT, -1) - a.take(_AFTER_NEXT, -1) * b.take(_NEXT, -1)


def wrench_matrix(robot: Robot, pose: Pose) -> tuple[FloatArray, FloatArray]:
    """Return lengths (..., m) and A (..., 6, m) for fixed exit points."""
    arms = robot.anchor_points @ pose.rotation.swapaxes(-1, -2)
    vectors = robot.exit_points - pose.position[..., None, :] - arms
    lengths = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    directions = vectors / lengths[..., None]
    columns = np.concatenate((directions, cross(arms, directions)), axis=-1)
    return lengths, columns.swapaxes(-1, -2)


def wrench(
    robot: Robot, pose: Pose, twist: Twist, acceleration: Acceleration, payload: Payload
) -> FloatArray:
    """Return the required wrench (..., 6)."""
    body = robot.platform
    mass = body.mass + payload.mass
    inertia = body.inertia_about_origin + payload.inertia_about_origin
    mc = pose.rotation @ (body.first_moment + payload.first_moment)
    omega, alpha, a = twist.angular, acceleration.angular, acceleration.linear - GRAVITY
    force = mass * a + cross(alpha, mc) + cross(omega, cross(omega, mc))
    I_P = pose.rotation @ inertia @ pose.rotation.swapaxes(-1, -2)
    turning = (I_P @ alpha[..., None])[..., 0] + cross(omega, (I_P @ omega[..., None])[..., 0])
    return np.concatenate((force, cross(mc, a) + turning), axis=-1)


def bounded(A: FloatArray, w: FloatArray, low: FloatArray | float, high: FloatArray | float) -> FloatArray:
    """Return the bounded tensions of least norm (m,) of one pose with a wrench within reach.

    The solution is clip(A^T y, low, high) at the maximum of the dual function, which is concave and piecewise
    quadratic: Newton's iteration with the columns that are not clipped, halving steps that do not rise.
    """
    y = np.linalg.solve(A @ A.T, w)
    asked = y @ A
    tensions = np.clip(asked, low, high)
    value = y @ w - (asked - 0.5 * tensions) @ tensions
    for _ in range(_MOST_STEPS):
        error = w - A @ tensions
        if np.abs(error).max() < 1e-9 * np.max(high):
            break
        free = A[:, tensions == asked]
        step = np.linalg.solve(free @ free.T + _REGULARISATION * np.eye(6), error)
        share = 1.0
        while True:
            trial = (y + share * step) @ A
            clipped = np.clip(trial, low, high)
            risen = (y + share * step) @ w - (trial - 0.5 * clipped) @ clipped
            if risen >= value or share < 1e-6:
                break
            share *= 0.5
        y, asked, tensions, value = y + share * step, trial, clipped, risen
    return tensions
