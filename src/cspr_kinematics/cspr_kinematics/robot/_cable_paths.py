"""Cable paths over swivelling pulleys, their lengths, directions and wrench matrix (docs/model.md, 1-2).

A geometry array, (m, 10), has a row for each cable: exit point a (3) in base, anchor point b (3) in
platform, pulley radius R, and the unit vector k (3) of the swivel axis in base.
"""

from __future__ import annotations

import math

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel

# A cable shorter than this has no meaningful direction: its anchor point lies on its exit point, m.
SHORTEST_CABLE = 1e-6

# Faults of a cable's path.
PATH_EXISTS = 0
NO_LENGTH = 1  # the anchor point lies on the exit point
INSIDE_PULLEY = 2  # no tangent from the pulley reaches the anchor point
ON_SWIVEL_AXIS = 3  # the length is known, the direction of the pulley is not
BEYOND_RANGE = 4  # the length exceeds the range of floating-point numbers


@kernel
def cable_path(
    dx: float, dy: float, dz: float, radius: float, kx: float, ky: float, kz: float
) -> tuple[int, float, float, float, float, float]:
    """Return the path of a cable to an anchor point at d from its exit point.

    The cable runs up the swivel axis k to the exit point, where the axis touches the pulley, around the
    pulley by the wrap angle phi, and straight on to the anchor point. In the plane of the pulley, with e the
    unit vector across the axis towards the anchor point, d = s e + h k, and the centre lies at R e. The free
    length f is that of the tangent; its direction, away from the pulley, is sin(phi) e + cos(phi) k.

    Returns
    -------
    fault : int
        PATH_EXISTS, or one of the faults above.
    length : float
        R phi + f.
    free_length : float
        f.
    ux, uy, uz : float
        Direction from the anchor point towards the pulley.
    """
    if radius == 0.0:
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        if length < SHORTEST_CABLE:
            return NO_LENGTH, length, length, 0.0, 0.0, 0.0
        if not length < math.inf:
            return BEYOND_RANGE, length, length, 0.0, 0.0, 0.0
        return PATH_EXISTS, length, length, -dx / length, -dy / length, -dz / length

    h = dx * kx + dy * ky + dz * kz
    ex, ey, ez = dx - h * kx, dy - h * ky, dz - h * kz
    s = math.sqrt(ex * ex + ey * ey + ez * ez)
    # f^2 = (s - R)^2 + h^2 - R^2, in a form without cancellation
    free_square = s * (s - 2.0 * radius) + h * h
    if free_square < SHORTEST_CABLE * SHORTEST_CABLE:
        return INSIDE_PULLEY, 0.0, 0.0, 0.0, 0.0, 0.0
    free = math.sqrt(free_square)
    across = s - radius
    square = across * across + h * h
    sine = (free * across + radius * h) / square
    cosine = (free * h - radius * across) / square
    wrap = math.atan2(sine, cosine)
    if wrap < 0.0:
        # above the exit point the wrap is in [0, pi], so that it is negative through rounding only
        wrap = 0.0 if h > 0.0 else wrap + 2.0 * math.pi
    length = radius * wrap + free
    if not length < math.inf:
        return BEYOND_RANGE, length, free, 0.0, 0.0, 0.0

    fault = PATH_EXISTS
    if s < SHORTEST_CABLE:
        if radius > SHORTEST_CABLE:
            fault = ON_SWIVEL_AXIS
        # any direction across the axis
        if abs(kx) < 0.6:
            ex, ey, ez = 0.0, kz, -ky
        else:
            ex, ey, ez = -kz, 0.0, kx
        s = math.sqrt(ex * ex + ey * ey + ez * ez)
    x = sine / s
    return fault, length, free, -x * ex - cosine * kx, -x * ey - cosine * ky, -x * ez - cosine * kz


@kernel
def path_at(
    geometry: FloatArray, cable: int, position: FloatArray, rotation: FloatArray
) -> tuple[int, float, float, float, float, float, float, float, float]:
    """Return the result of `cable_path` for a cable at a pose, and its arm r = Q b."""
    bx, by, bz = geometry[cable, 3], geometry[cable, 4], geometry[cable, 5]
    rx = rotation[0, 0] * bx + rotation[0, 1] * by + rotation[0, 2] * bz
    ry = rotation[1, 0] * bx + rotation[1, 1] * by + rotation[1, 2] * bz
    rz = rotation[2, 0] * bx + rotation[2, 1] * by + rotation[2, 2] * bz
    fault, length, free, ux, uy, uz = cable_path(
        position[0] + rx - geometry[cable, 0],
        position[1] + ry - geometry[cable, 1],
        position[2] + rz - geometry[cable, 2],
        geometry[cable, 6],
        geometry[cable, 7],
        geometry[cable, 8],
        geometry[cable, 9],
    )
    return fault, length, free, ux, uy, uz, rx, ry, rz


@kernel
def cables_at_poses(
    geometry: FloatArray,
    positions: FloatArray,
    rotations: FloatArray,
    lengths: FloatArray,
    directions: FloatArray,
    arms: FloatArray,
    wrench_matrices: FloatArray,
    jacobians: FloatArray,
    free_lengths: FloatArray,
) -> tuple[int, int, int]:
    """Fill in the cables (n, m, ...) at n poses; return the first fault and the indices of cable and pose."""
    for n in range(positions.shape[0]):
        u, r, A, J = directions[n], arms[n], wrench_matrices[n], jacobians[n]
        for i in range(geometry.shape[0]):
            fault, length, free, ux, uy, uz, rx, ry, rz = path_at(geometry, i, positions[n], rotations[n])
            if fault != PATH_EXISTS:
                return fault, i, n
            mx, my, mz = ry * uz - rz * uy, rz * ux - rx * uz, rx * uy - ry * ux
            lengths[n, i], free_lengths[n, i] = length, free
            u[i, 0], u[i, 1], u[i, 2] = ux, uy, uz
            r[i, 0], r[i, 1], r[i, 2] = rx, ry, rz
            A[0, i], A[1, i], A[2, i] = ux, uy, uz
            A[3, i], A[4, i], A[5, i] = mx, my, mz
            J[i, 0], J[i, 1], J[i, 2] = -ux, -uy, -uz
            J[i, 3], J[i, 4], J[i, 5] = -mx, -my, -mz
    return PATH_EXISTS, 0, 0


@kernel
def lengths_at_poses(
    geometry: FloatArray, positions: FloatArray, rotations: FloatArray, lengths: FloatArray
) -> tuple[int, int, int]:
    """Fill in the cable lengths alone, which exist even where an anchor point lies on its swivel axis."""
    for n in range(positions.shape[0]):
        for i in range(geometry.shape[0]):
            fault, length, _, _, _, _, _, _, _ = path_at(geometry, i, positions[n], rotations[n])
            if fault not in (PATH_EXISTS, ON_SWIVEL_AXIS):
                return fault, i, n
            lengths[n, i] = length
    return PATH_EXISTS, 0, 0
