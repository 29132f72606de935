"""The force of elastic cables that winches pay out and that cannot push.

MuJoCo's own tendon springs have a constant rest length, and a damper of theirs would push on a slack cable.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics.compiled import kernel

FloatArray = NDArray[np.float64]


@kernel
def cable_and_motor_forces(
    length: FloatArray,
    length_rate: FloatArray,
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
        Geometric length from exit to anchor point, m, and its rate, m/s.
    angle, speed
        Of the motors, rad and rad/s.
    free_at_home
        Free length from exit to anchor point at angle zero, m.
    constants
        (4,): cable paid out an angle, m/rad; axial stiffness, N; damping over stiffness, s; length between drum
        and exit point, m.
    torque_input, damping
        Torque that a drive is told, N m, and its own velocity feedback, N m s/rad.
    torque_limit
        Of the motors, N m.
    tension, applied_torque
        Results, N and N m.
    control
        Result (2 m,): forces along the tendons, then torques at the shafts.
    """
    pay_out, stiffness, damping_time, dead_length = constants
    m = len(length)
    for i in range(m):
        free = free_at_home[i] + pay_out * angle[i]
        stretch = length[i] - free
        pull = 0.0
        if stretch > 0.0:
            rate = length_rate[i] - pay_out * speed[i]
            pull = max(0.0, stiffness / (free + dead_length) * (stretch + damping_time * rate))
        torque = torque_input[i] - damping[i] * speed[i]
        torque = min(max(torque, -torque_limit), torque_limit)
        tension[i] = pull
        applied_torque[i] = torque
        control[i] = -pull
        control[m + i] = torque + pay_out * pull
