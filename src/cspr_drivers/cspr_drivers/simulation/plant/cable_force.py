"""Elastic, heavy cables that winches pay out over swivelling pulleys, and that cannot push.

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
_CREEP = 1e-3  # m/s; a pulley's friction has its full size where the cable is faster than a few times this


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
def pull_of_rope(stretch: float, stiffness: float, sag: float) -> tuple[float, float]:
    """Return the tension of a rope between two points, and its derivative by the distance of these, N and N/m.

    A rope of weight w a metre, of which w h acts across its chord of length l, is longer than the chord by
    (w h)^2 l^3 / (24 T^2), the arc of a flat parabola (H. M. Irvine, Cable Structures, 1981, section 2.2). So
    T = k (s + c / T^2), of which the one positive root is found by Newton's method from above, where it cannot miss.
    Without weight T = k s, and nothing of a slack rope.

    Parameters
    ----------
    stretch
        s: the chord, and what lies on the pulley, less the free length, m; negative if the rope hangs through.
    stiffness
        k, N/m.
    sag
        c = (w h)^2 l^3 / 24, N^2 m.
    """
    taut = stiffness * stretch
    if sag == 0.0:
        return (taut, stiffness) if taut > 0.0 else (0.0, 0.0)
    pull = max(taut, 0.0) + (stiffness * sag) ** (1.0 / 3.0)
    for _ in range(50):
        error = pull * pull * (pull - taut) - stiffness * sag
        step = error / (pull * (3.0 * pull - 2.0 * taut))
        pull -= step
        if step < 1e-12 * pull:
            break
    return pull, stiffness * pull / (3.0 * pull - 2.0 * taut)


@kernel
def cable_and_motor_forces(
    length: FloatArray,
    length_rate: FloatArray,
    wrapped: FloatArray,
    angle: FloatArray,
    speed: FloatArray,
    upper_ends: FloatArray,
    lower_ends: FloatArray,
    center: FloatArray,
    free_at_home: FloatArray,
    constants: FloatArray,
    torque_input: FloatArray,
    damping: FloatArray,
    motor: FloatArray,
    tension: FloatArray,
    applied_torque: FloatArray,
    control: FloatArray,
    hanging: FloatArray,
) -> None:
    """Compute tensions and the torques of the drives, and write both into the controls of the MuJoCo model.

    A cable is a spring and a damper in parallel on the free length between drum and anchor point; it cannot push. Half
    of its weight between the pulley and the platform hangs on the platform, the other half on the pulley; what lies
    between pulley and drum hangs on neither. Of the tension above the pulley friction takes a share, by Coulomb's
    law: the load cell, between pulley and drum, shows less where the cable is paid out, and more where it is wound in.
    A motor has its full torque up to its speed limit; what drives it on fades from there to nothing at the speed at
    which the supply's voltage is used up. All arrays are (m,) except as stated; motor quantities at the motor shaft.

    Parameters
    ----------
    length, length_rate
        From where the cable leaves its pulley, or else its exit point, to the anchor point, m; and the rate of the
        whole length, m/s, at which the anchor point moves along the cable.
    wrapped
        Cable on the pulley, m.
    angle, speed
        Of the motors, rad and rad/s.
    upper_ends, lower_ends
        (m, 3): where the cables leave their pulleys, and the anchor points, in base.
    center
        (3,): centre of mass of the platform in base.
    free_at_home
        Free length from exit to anchor point at angle zero, m.
    constants
        (6,): cable paid out per angle, m/rad; axial stiffness, N; damping over stiffness, s; length between drum
        and exit point, m; weight, N/m; share of the tension that friction in the pulley takes.
    torque_input, damping
        Commanded torque of a drive, N m, and its own velocity feedback, N m s/rad.
    motor
        (3,): torque limit, N m, speed limit and no-load speed, rad/s.
    tension, applied_torque
        Results: what the load cells sense, N, and N m.
    control
        Result (2 m or more,): forces along the tendons, then torques at the shafts.
    hanging
        Result (6,): force and moment about `center` of the weight of the cables on the platform, in base.
    """
    transmission_ratio, stiffness, damping_time, dead_length, weight, friction = constants
    torque_limit, speed_limit, no_load_speed = motor
    m = len(length)
    hanging[:] = 0.0
    for i in range(m):
        free = free_at_home[i] + transmission_ratio * angle[i]
        stretch = length[i] + wrapped[i] - free
        rise = upper_ends[i, 2] - lower_ends[i, 2]
        across = weight * weight * max(length[i] * length[i] - rise * rise, 0.0)  # (w h l)^2
        pull, slope = pull_of_rope(stretch, stiffness / (free + dead_length), across * length[i] / 24.0)
        rate = length_rate[i] - transmission_ratio * speed[i]
        pull = max(0.0, pull + damping_time * slope * rate)
        half = 0.5 * weight * free
        hanging[2] -= half
        hanging[3] -= (lower_ends[i, 1] - center[1]) * half
        hanging[4] += (lower_ends[i, 0] - center[0]) * half
        above = math.sqrt(pull * (pull + 2.0 * half * rise / length[i]) + half * half) if half > 0.0 else pull
        if friction > 0.0:
            above *= (1.0 - friction) ** math.tanh(transmission_ratio * speed[i] / _CREEP)
        torque = torque_input[i] - damping[i] * speed[i]
        driving = torque_limit
        if abs(speed[i]) > speed_limit and torque * speed[i] > 0.0:
            driving *= max(0.0, (no_load_speed - abs(speed[i])) / (no_load_speed - speed_limit))
        torque = min(max(torque, -driving), driving)
        tension[i] = above
        applied_torque[i] = torque
        control[i] = -pull
        control[m + i] = torque + transmission_ratio * above
