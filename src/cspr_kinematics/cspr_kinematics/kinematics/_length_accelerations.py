"""Second derivatives of the cable lengths along a motion (docs/model.md, section 2)."""

from __future__ import annotations

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel
from cspr_kinematics.robot._cable_paths import PATH_EXISTS, SHORTEST_CABLE, path_at


@kernel
def length_accelerations_of_motions(
    geometry: FloatArray,
    positions: FloatArray,
    rotations: FloatArray,
    twists: FloatArray,
    accelerations: FloatArray,
    result: FloatArray,
) -> tuple[int, int, int]:
    """Fill in the accelerations of the cable lengths (n, m) of n motions; return the first fault, cable and motion.

    With w the velocity and z the acceleration of the anchor point, lddot = -u . z - udot . w. The cable turns in its
    pulley's plane about the point where it leaves the pulley, at the distance f from the anchor point, and with the
    plane about the swivel axis, at the distance s: -udot . w = w_in^2 / f + w_out^2 sin(phi) / s, where w_in and w_out
    are the parts of w across the cable, in the plane and out of it.
    """
    for n in range(positions.shape[0]):
        p, Q, twist, acceleration = positions[n], rotations[n], twists[n], accelerations[n]
        ox, oy, oz = twist[3], twist[4], twist[5]
        lx, ly, lz = acceleration[3], acceleration[4], acceleration[5]
        for i in range(geometry.shape[0]):
            fault, _, free, ux, uy, uz, rx, ry, rz = path_at(geometry, i, p, Q)
            if fault != PATH_EXISTS:
                return fault, i, n
            vx, vy, vz = oy * rz - oz * ry, oz * rx - ox * rz, ox * ry - oy * rx  # omega x r
            zx = acceleration[0] + ly * rz - lz * ry + oy * vz - oz * vy
            zy = acceleration[1] + lz * rx - lx * rz + oz * vx - ox * vz
            zz = acceleration[2] + lx * ry - ly * rx + ox * vy - oy * vx
            wx, wy, wz = twist[0] + vx, twist[1] + vy, twist[2] + vz
            cx, cy, cz = (
                uy * wz - uz * wy,
                uz * wx - ux * wz,
                ux * wy - uy * wx,
            )  # the part across, turned about u
            turning = (cx * cx + cy * cy + cz * cz) / free
            if geometry[i, 6] > SHORTEST_CABLE:
                kx, ky, kz = geometry[i, 7], geometry[i, 8], geometry[i, 9]
                dx, dy, dz = (
                    p[0] + rx - geometry[i, 0],
                    p[1] + ry - geometry[i, 1],
                    p[2] + rz - geometry[i, 2],
                )
                nx, ny, nz = (
                    ky * dz - kz * dy,
                    kz * dx - kx * dz,
                    kx * dy - ky * dx,
                )  # k x d, across the plane
                square = nx * nx + ny * ny + nz * nz
                # u x k = sin(phi) n / s
                sine = (uy * kz - uz * ky) * nx + (uz * kx - ux * kz) * ny + (ux * ky - uy * kx) * nz
                out = wx * nx + wy * ny + wz * nz
                turning += out * out / square * (sine / square - 1.0 / free)
            result[n, i] = turning - (ux * zx + uy * zy + uz * zz)
    return PATH_EXISTS, 0, 0
