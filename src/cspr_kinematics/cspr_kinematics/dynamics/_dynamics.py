"""Wrench of a moving platform, from the ten inertial parameters (docs/model.md, section 4).

The parameters, (10,), are mass m, first moment m c_p (3), and inertia about the platform's origin Ixx, Ixy,
Ixz, Iyy, Iyz, Izz, all in platform axes; the off-diagonal elements are those of the tensor.
"""

from __future__ import annotations

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel

GRAVITY_Z = -9.81  # m/s^2, along z of base


@kernel
def required_wrenches(
    parameters: FloatArray,
    rotations: FloatArray,
    twists: FloatArray,
    accelerations: FloatArray,
    wrenches: FloatArray,
) -> None:
    """Fill in w = H [a; alpha] + C xdot - w_g, (n, 6), about the platform's origin in base axes."""
    m, px, py, pz = parameters[0], parameters[1], parameters[2], parameters[3]
    xx, xy, xz = parameters[4], parameters[5], parameters[6]
    yy, yz, zz = parameters[7], parameters[8], parameters[9]
    for n in range(rotations.shape[0]):
        Q = rotations[n]
        # gravity acts like an upward acceleration of the whole platform
        ax, ay, az = accelerations[n, 0], accelerations[n, 1], accelerations[n, 2] - GRAVITY_Z
        ox, oy, oz = twists[n, 3], twists[n, 4], twists[n, 5]
        lx, ly, lz = accelerations[n, 3], accelerations[n, 4], accelerations[n, 5]
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
