"""Wrench of a moving platform, from the ten inertial parameters (docs/model.md, section 4).

The parameters, (10,), are mass m, first moment m c_p (3), and inertia about the platform's origin Ixx, Ixy,
Ixz, Iyy, Iyz, Izz, all in platform axes; the off-diagonal elements are those of the tensor.
"""

from __future__ import annotations

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.motion._linear import fill_matrix

GRAVITY_Z = -9.81  # m/s^2, along z of base


@kernel
def required_wrenches(
    parameters: FloatArray,
    rotations: FloatArray,
    angular_velocities: FloatArray,
    linear_accelerations: FloatArray,
    angular_accelerations: FloatArray,
    wrenches: FloatArray,
) -> None:
    """Fill in w = H [a; alpha] + C xdot - w_g, (n, 6), about the platform's origin in base axes."""
    m, px, py, pz = parameters[0], parameters[1], parameters[2], parameters[3]
    xx, xy, xz = parameters[4], parameters[5], parameters[6]
    yy, yz, zz = parameters[7], parameters[8], parameters[9]
    for n in range(rotations.shape[0]):
        Q = rotations[n]
        # gravity acts like an upward acceleration of the whole platform
        ax, ay = linear_accelerations[n, 0], linear_accelerations[n, 1]
        az = linear_accelerations[n, 2] - GRAVITY_Z
        ox, oy, oz = angular_velocities[n, 0], angular_velocities[n, 1], angular_velocities[n, 2]
        lx, ly, lz = angular_accelerations[n, 0], angular_accelerations[n, 1], angular_accelerations[n, 2]
        cx = Q[0, 0] * px + Q[0, 1] * py + Q[0, 2] * pz
        cy = Q[1, 0] * px + Q[1, 1] * py + Q[1, 2] * pz
        cz = Q[2, 0] * px + Q[2, 1] * py + Q[2, 2] * pz

        # omega x mc, then m a + alpha x mc + omega x (omega x mc)
        vx, vy, vz = oy * cz - oz * cy, oz * cx - ox * cz, ox * cy - oy * cx
        wrenches[n, 0] = m * ax + (ly * cz - lz * cy) + (oy * vz - oz * vy)
        wrenches[n, 1] = m * ay + (lz * cx - lx * cz) + (oz * vx - ox * vz)
        wrenches[n, 2] = m * az + (lx * cy - ly * cx) + (ox * vy - oy * vx)

        # I_P omega and I_P alpha: to platform axes, through the tensor, and back
        bx = Q[0, 0] * ox + Q[1, 0] * oy + Q[2, 0] * oz
        by = Q[0, 1] * ox + Q[1, 1] * oy + Q[2, 1] * oz
        bz = Q[0, 2] * ox + Q[1, 2] * oy + Q[2, 2] * oz
        dx = Q[0, 0] * lx + Q[1, 0] * ly + Q[2, 0] * lz
        dy = Q[0, 1] * lx + Q[1, 1] * ly + Q[2, 1] * lz
        dz = Q[0, 2] * lx + Q[1, 2] * ly + Q[2, 2] * lz
        hx, hy, hz = xx * bx + xy * by + xz * bz, xy * bx + yy * by + yz * bz, xz * bx + yz * by + zz * bz
        # I alpha + omega x (I omega), in platform axes
        tx = xx * dx + xy * dy + xz * dz + (by * hz - bz * hy)
        ty = xy * dx + yy * dy + yz * dz + (bz * hx - bx * hz)
        tz = xz * dx + yz * dy + zz * dz + (bx * hy - by * hx)
        wrenches[n, 3] = cy * az - cz * ay + (Q[0, 0] * tx + Q[0, 1] * ty + Q[0, 2] * tz)
        wrenches[n, 4] = cz * ax - cx * az + (Q[1, 0] * tx + Q[1, 1] * ty + Q[1, 2] * tz)
        wrenches[n, 5] = cx * ay - cy * ax + (Q[2, 0] * tx + Q[2, 1] * ty + Q[2, 2] * tz)


@kernel
def static_wrenches(parameters: FloatArray, rotations: FloatArray, wrenches: FloatArray) -> None:
    """Fill in the wrenches (n, 6) that hold the platform at rest, -w_g."""
    g = -GRAVITY_Z
    px, py, pz = parameters[1], parameters[2], parameters[3]
    for n in range(rotations.shape[0]):
        Q = rotations[n]
        wrenches[n, 0], wrenches[n, 1], wrenches[n, 2] = 0.0, 0.0, parameters[0] * g
        wrenches[n, 3] = (Q[1, 0] * px + Q[1, 1] * py + Q[1, 2] * pz) * g
        wrenches[n, 4] = -(Q[0, 0] * px + Q[0, 1] * py + Q[0, 2] * pz) * g
        wrenches[n, 5] = 0.0


@kernel
def balance_regressors(
    rotations: FloatArray,
    angular_velocities: FloatArray,
    linear_accelerations: FloatArray,
    angular_accelerations: FloatArray,
    regressors: FloatArray,
) -> None:
    """Fill in the regressors (n, 6, 10) of the required wrench in the inertial parameters.

    The wrench is linear in the parameters: column k is the wrench of parameter k alone with the value 1.
    """
    for n in range(rotations.shape[0]):
        Y = regressors[n]
        Q = rotations[n]
        ox, oy, oz = angular_velocities[n, 0], angular_velocities[n, 1], angular_velocities[n, 2]
        lx, ly, lz = angular_accelerations[n, 0], angular_accelerations[n, 1], angular_accelerations[n, 2]
        ax, ay = linear_accelerations[n, 0], linear_accelerations[n, 1]
        az = linear_accelerations[n, 2] - GRAVITY_Z
        fill_matrix(Y, 0.0)
        Y[0, 0], Y[1, 0], Y[2, 0] = ax, ay, az
        for k in range(3):
            # unit first moment: the k-th platform axis in base
            cx, cy, cz = Q[0, k], Q[1, k], Q[2, k]
            vx, vy, vz = oy * cz - oz * cy, oz * cx - ox * cz, ox * cy - oy * cx
            Y[0, 1 + k] = (ly * cz - lz * cy) + (oy * vz - oz * vy)
            Y[1, 1 + k] = (lz * cx - lx * cz) + (oz * vx - ox * vz)
            Y[2, 1 + k] = (lx * cy - ly * cx) + (ox * vy - oy * vx)
            Y[3, 1 + k], Y[4, 1 + k], Y[5, 1 + k] = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
        bx = Q[0, 0] * ox + Q[1, 0] * oy + Q[2, 0] * oz
        by = Q[0, 1] * ox + Q[1, 1] * oy + Q[2, 1] * oz
        bz = Q[0, 2] * ox + Q[1, 2] * oy + Q[2, 2] * oz
        dx = Q[0, 0] * lx + Q[1, 0] * ly + Q[2, 0] * lz
        dy = Q[0, 1] * lx + Q[1, 1] * ly + Q[2, 1] * lz
        dz = Q[0, 2] * lx + Q[1, 2] * ly + Q[2, 2] * lz
        # I alpha + omega x (I omega) in platform axes, for each element of I alone with the value 1
        for i in range(3):
            r0, r1, r2 = Q[i, 0], Q[i, 1], Q[i, 2]
            Y[3 + i, 4] = r0 * dx + r1 * (bz * bx) - r2 * (by * bx)
            Y[3 + i, 5] = r0 * (dy - bz * bx) + r1 * (dx + bz * by) + r2 * (bx * bx - by * by)
            Y[3 + i, 6] = r0 * (dz + by * bx) + r1 * (bz * bz - bx * bx) + r2 * (dx - by * bz)
            Y[3 + i, 7] = -r0 * (bz * by) + r1 * dy + r2 * (bx * by)
            Y[3 + i, 8] = r0 * (by * by - bz * bz) + r1 * (dz - bx * by) + r2 * (dy + bx * bz)
            Y[3 + i, 9] = r0 * (by * bz) - r1 * (bx * bz) + r2 * dz
