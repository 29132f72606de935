"""Rotations: checks of a matrix, its quaternion, and the matrix of a rotation vector."""

from __future__ import annotations

import math

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel

# Below this angle both quotients of Rodrigues' formula have reached their limits, rad.
_SMALL_ANGLE = 1e-9


@kernel
def pose_defects(positions: FloatArray, rotations: FloatArray) -> tuple[float, float]:
    """Return the largest element of Q Q^T - 1 over n matrices, and the smallest determinant.

    Either is NaN when a position or a matrix is not finite.
    """
    defect, least = 0.0, math.inf
    for n in range(rotations.shape[0]):
        Q = rotations[n]
        # zero for finite numbers, NaN otherwise
        total = 0.0 * positions[n, 0] + 0.0 * positions[n, 1] + 0.0 * positions[n, 2]
        for i in range(3):
            for j in range(i, 3):
                value = Q[i, 0] * Q[j, 0] + Q[i, 1] * Q[j, 1] + Q[i, 2] * Q[j, 2]
                if i == j:
                    value -= 1.0
                total += 0.0 * value
                defect = max(defect, abs(value))
        determinant = (
            Q[0, 0] * (Q[1, 1] * Q[2, 2] - Q[1, 2] * Q[2, 1])
            - Q[0, 1] * (Q[1, 0] * Q[2, 2] - Q[1, 2] * Q[2, 0])
            + Q[0, 2] * (Q[1, 0] * Q[2, 1] - Q[1, 1] * Q[2, 0])
        )
        least = min(least, determinant)
        if not math.isfinite(total):
            return math.nan, math.nan
    return defect, least


@kernel
def turn(x: float, y: float, z: float, rotation: FloatArray, turned: FloatArray) -> None:
    """Fill in exp([v]x) Q for the rotation vector v = (x, y, z) by Rodrigues' formula; not in place."""
    angle = math.sqrt(x * x + y * y + z * z)
    a = max(angle, _SMALL_ANGLE)
    s = math.sin(a) / a
    half = math.sin(0.5 * a) / a
    c = 2.0 * half * half
    # exp([v]x) = (1 - c v^2) 1 + s [v]x + c v v^T
    d = 1.0 - c * angle * angle
    for j in range(3):
        q0, q1, q2 = rotation[0, j], rotation[1, j], rotation[2, j]
        along = c * (x * q0 + y * q1 + z * q2)
        turned[0, j] = d * q0 + s * (y * q2 - z * q1) + along * x
        turned[1, j] = d * q1 + s * (z * q0 - x * q2) + along * y
        turned[2, j] = d * q2 + s * (x * q1 - y * q0) + along * z


@kernel
def orthonormalise(rotation: FloatArray, result: FloatArray) -> None:
    """Fill in a nearly orthonormal matrix without its rounding errors; not in place.

    One Newton step towards the orthogonal factor of the polar decomposition: it squares the defect.
    """
    for i in range(3):
        for j in range(3):
            result[i, j] = 1.5 * rotation[i, j]
    for k in range(3):
        for j in range(3):
            defect = -0.5 * (
                rotation[0, k] * rotation[0, j]
                + rotation[1, k] * rotation[1, j]
                + rotation[2, k] * rotation[2, j]
            )
            for i in range(3):
                result[i, j] += rotation[i, k] * defect


@kernel
def quaternions(rotations: FloatArray, result: FloatArray) -> None:
    """Fill in unit quaternions (n, 4) in the order x, y, z, w with w >= 0, from matrices (n, 3, 3).

    Each of four formulas divides by one component; the one with the largest divisor is used (Shepperd).
    """
    for n in range(rotations.shape[0]):
        Q = rotations[n]
        trace = Q[0, 0] + Q[1, 1] + Q[2, 2]
        largest, choice = trace, 3
        for i in range(3):
            if Q[i, i] > largest:
                largest, choice = Q[i, i], i
        if choice == 3:
            w = 1.0 + trace
            x, y, z = Q[2, 1] - Q[1, 2], Q[0, 2] - Q[2, 0], Q[1, 0] - Q[0, 1]
        elif choice == 0:
            x = 1.0 + 2.0 * Q[0, 0] - trace
            y, z, w = Q[0, 1] + Q[1, 0], Q[0, 2] + Q[2, 0], Q[2, 1] - Q[1, 2]
        elif choice == 1:
            y = 1.0 + 2.0 * Q[1, 1] - trace
            x, z, w = Q[0, 1] + Q[1, 0], Q[1, 2] + Q[2, 1], Q[0, 2] - Q[2, 0]
        else:
            z = 1.0 + 2.0 * Q[2, 2] - trace
            x, y, w = Q[0, 2] + Q[2, 0], Q[1, 2] + Q[2, 1], Q[1, 0] - Q[0, 1]
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        if w < 0.0:
            norm = -norm
        result[n, 0], result[n, 1], result[n, 2], result[n, 3] = x / norm, y / norm, z / norm, w / norm


@kernel
def rotations(quaternions: FloatArray, result: FloatArray) -> float:
    """Fill in rotation matrices (n, 3, 3) of quaternions (n, 4) in the order x, y, z, w, normalising them.

    Returns the largest deviation of a norm from 1, which is NaN when a quaternion is not finite.
    """
    deviation = 0.0
    for n in range(quaternions.shape[0]):
        x, y, z, w = quaternions[n, 0], quaternions[n, 1], quaternions[n, 2], quaternions[n, 3]
        norm = math.sqrt(x * x + y * y + z * z + w * w)
        if not math.isfinite(norm):
            return math.nan
        deviation = max(deviation, abs(norm - 1.0))
        if norm == 0.0:
            continue
        x, y, z, w = x / norm, y / norm, z / norm, w / norm
        result[n, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
        result[n, 0, 1] = 2.0 * (x * y - z * w)
        result[n, 0, 2] = 2.0 * (x * z + y * w)
        result[n, 1, 0] = 2.0 * (x * y + z * w)
        result[n, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
        result[n, 1, 2] = 2.0 * (y * z - x * w)
        result[n, 2, 0] = 2.0 * (x * z - y * w)
        result[n, 2, 1] = 2.0 * (y * z + x * w)
        result[n, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return deviation


@kernel
def euler_motions(
    angles: FloatArray,
    rates: FloatArray,
    growths: FloatArray,
    rotations: FloatArray,
    angular_velocities: FloatArray,
    angular_accelerations: FloatArray,
) -> None:
    """Fill in Q = Rz(alpha) Ry(beta) Rx(gamma), omega and its derivative, from the angles' derivatives (n, 3)."""
    for n in range(angles.shape[0]):
        sa, ca = math.sin(angles[n, 0]), math.cos(angles[n, 0])
        sb, cb = math.sin(angles[n, 1]), math.cos(angles[n, 1])
        sg, cg = math.sin(angles[n, 2]), math.cos(angles[n, 2])
        Q, omega, alpha = rotations[n], angular_velocities[n], angular_accelerations[n]
        Q[0, 0], Q[0, 1], Q[0, 2] = ca * cb, ca * sb * sg - sa * cg, ca * sb * cg + sa * sg
        Q[1, 0], Q[1, 1], Q[1, 2] = sa * cb, sa * sb * sg + ca * cg, sa * sb * cg - ca * sg
        Q[2, 0], Q[2, 1], Q[2, 2] = -sb, cb * sg, cb * cg
        # The axes in base: z, Rz y = (-sa, ca, 0) and Rz Ry x = (ca cb, sa cb, -sb).
        a, b, g = rates[n, 0], rates[n, 1], rates[n, 2]
        omega[0] = -sa * b + ca * cb * g
        omega[1] = ca * b + sa * cb * g
        omega[2] = a - sb * g
        da, db, dg = growths[n, 0], growths[n, 1], growths[n, 2]
        # The products of the rates belong to the axes that turn.
        alpha[0] = -sa * db + ca * cb * dg - ca * a * b - sa * cb * a * g - ca * sb * b * g
        alpha[1] = ca * db + sa * cb * dg - sa * a * b + ca * cb * a * g - sa * sb * b * g
        alpha[2] = da - sb * dg - cb * b * g
