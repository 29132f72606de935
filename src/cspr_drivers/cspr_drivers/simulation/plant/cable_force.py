"""Elastic cables that winches pay out over swivelling pulleys, and that cannot push.

MuJoCo's own tendon springs have a constant rest length, a damper of theirs would push on a slack cable, and its
tendons wrap around geometry that does not swivel. The pulleys are built here from angles about their centres, not
with the controller's kinematics: a mistake in one of the two would otherwise cancel.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics.compiled import kernel

FloatArray = NDArray[np.float64]


# m; nearer to its swivel axis the anchor point gives a pulley no direction, and the pulley stays as it is
_ON_SWIVEL_AXIS = 1e-9


@kernel
def lead_over_pulleys(
    exit_points: FloatArray,
    anchor_points: FloatArray,
    radii: FloatArray,
    swivel_axes: FloatArray,
    pose: FloatArray,
    departures: FloatArray,
    wrapped: FloatArray,
) -> int:
    """Turn each pulley towards its anchor point, and find where its cable leaves it.

    The cable meets the pulley at the exit point, running along the swivel axis. A pulley of radius 0 is left alone.

    Parameters
    ----------
    exit_points, anchor_points, swivel_axes
        (m, 3): in base, in platform, and unit vectors in base.
    radii
        (m,), m.
    pose
        (7,): position and quaternion (w, x, y, z) of the platform.
    departures
        Result (m, 3): where the cables leave their pulleys, in base.
    wrapped
        Result (m,): cable on the pulleys, m.

    Returns
    -------
    int
        Index of a cable whose anchor point is inside its pulley, -1 if there is none.
    """
    w, x, y, z = pose[3], pose[4], pose[5], pose[6]
    double = 2.0 / (w * w + x * x + y * y + z * z)
    for i in range(len(radii)):
        radius = radii[i]
        if radius == 0.0:
            continue
        bx, by, bz = anchor_points[i]
        cx, cy, cz = y * bz - z * by, z * bx - x * bz, x * by - y * bx
        dx = pose[0] - exit_points[i, 0] + bx + double * (w * cx + y * cz - z * cy)
        dy = pose[1] - exit_points[i, 1] + by + double * (w * cy + z * cx - x * cz)
        dz = pose[2] - exit_points[i, 2] + bz + double * (w * cz + x * cy - y * cx)
        kx, ky, kz = swivel_axes[i]
        along = dx * kx + dy * ky + dz * kz
        ex, ey, ez = dx - along * kx, dy - along * ky, dz - along * kz
        across = math.sqrt(ex * ex + ey * ey + ez * ez)
        distance = math.hypot(across - radius, along)  # of the anchor point from the pulley's centre
        if distance <= radius:
            return i
        # Angles about the centre, from the exit point on in the sense in which the cable runs.
        angle = math.atan2(along, radius - across) - math.acos(radius / distance)
        if angle < 0.0:
            angle = 0.0 if along > 0.0 else angle + 2.0 * math.pi
        wrapped[i] = radius * angle
        if across > _ON_SWIVEL_AXIS:
            outwards, upwards = radius * (1.0 - math.cos(angle)) / across, radius * math.sin(angle)
            departures[i, 0] = exit_points[i, 0] + outwards * ex + upwards * kx
            departures[i, 1] = exit_points[i, 1] + outwards * ey + upwards * ky
            departures[i, 2] = exit_points[i, 2] + outwards * ez + upwards * kz
    return -1


@kernel
def cable_and_motor_forces(
    length: FloatArray,
    length_rate: FloatArray,
    wrapped: FloatArray,
    angle: FloatArray,
    speed: FloatArray,
    free_at_home: FloatArray,
    constants: FloatArray,
    torque_input: FloatArray,
    damping: FloatArray,
    torque_limit: float,
    tension: FloatArray,
    applied_torque: FloatArray,
    control: FloatArray,
) -> None:
    """Compute tensions and the torques of the drives, and write both into the controls of the MuJoCo model.

    A taut cable is a spring and a damper in parallel on the free length between drum and anchor; a slack one
    neither pulls, pushes nor damps. All arrays are (m,) except as stated; motor quantities at the motor shaft.

    Parameters
    ----------
    length, length_rate
        From where the cable leaves its pulley, or else its exit point, to the anchor point, m; and the rate of the
        whole length, m/s, at which the anchor point moves along the cable.
    wrapped
        Cable on the pulley, m.
    angle, speed
        Of the motors, rad and rad/s.
    free_at_home
        Free length from exit to anchor point at angle zero, m.
    constants
        (4,): cable paid out per angle, m/rad; axial stiffness, N; damping over stiffness, s; length between drum
        and exit point, m.
    torque_input, damping
        Commanded torque of a drive, N m, and its own velocity feedback, N m s/rad.
    torque_limit
        Of the motors, N m.
    tension, applied_torque
        Results, N and N m.
    control
        Result (2 m,): forces along the tendons, then torques at the shafts.
    """
    transmission_ratio, stiffness, damping_time, dead_length = constants
    m = len(length)
    for i in range(m):
        free = free_at_home[i] + transmission_ratio * angle[i]
        stretch = length[i] + wrapped[i] - free
        pull = 0.0
        if stretch > 0.0:
            rate = length_rate[i] - transmission_ratio * speed[i]
            pull = max(0.0, stiffness / (free + dead_length) * (stretch + damping_time * rate))
        torque = torque_input[i] - damping[i] * speed[i]
        torque = min(max(torque, -torque_limit), torque_limit)
        tension[i] = pull
        applied_torque[i] = torque
        control[i] = -pull
        control[m + i] = torque + transmission_ratio * pull
