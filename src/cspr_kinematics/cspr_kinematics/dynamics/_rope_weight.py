"""The weight of the ropes on the platform and on the load cells (docs/model.md, section 4b)."""

from __future__ import annotations

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel


@kernel
def rope_wrenches(halves: FloatArray, directions: FloatArray, arms: FloatArray, wrenches: FloatArray) -> None:
    """Fill in sum of h_i [e_i; r_i x e_i], (n, 6), of half weights (n, m), directions and arms (n, m, 3)."""
    for n in range(halves.shape[0]):
        for k in range(6):
            wrenches[n, k] = 0.0
        for i in range(halves.shape[1]):
            h = halves[n, i]
            rx, ry, rz = arms[n, i, 0], arms[n, i, 1], arms[n, i, 2]
            rise = h * directions[n, i, 2]
            ex, ey = rise * directions[n, i, 0], rise * directions[n, i, 1]
            ez = rise * directions[n, i, 2] + h
            wrenches[n, 0] += ex
            wrenches[n, 1] += ey
            wrenches[n, 2] += ez
            wrenches[n, 3] += ry * ez - rz * ey
            wrenches[n, 4] += rz * ex - rx * ez
            wrenches[n, 5] += rx * ey - ry * ex
