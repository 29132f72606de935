"""One measurement of the payload from the cable tensions (eqs. 16 and 17)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics import GRAVITY, Pose, Robot, inverse_kinematics

_g = -float(GRAVITY[2])  # m/s^2


@dataclass(frozen=True, eq=False)
class PayloadMeasurement:
    """What the tensions of one instant say about what hangs from the cables.

    Attributes
    ----------
    wrench
        ``A t`` (6,) of the cables on the platform about its origin, in base, N and N m.
    total_mass
        Of platform and payload, kg.
    total_moment
        Total mass times x and y of the common centre of mass in platform (2,), kg m.
    mass, moment
        The same of the payload alone. The mass can be negative by measurement errors.
    """

    wrench: NDArray[np.float64]
    total_mass: float
    total_moment: NDArray[np.float64]
    mass: float
    moment: NDArray[np.float64]


def measure_payload(
    robot: Robot, pose: Pose, tensions: NDArray[np.float64], payload_height: float = 0.0
) -> PayloadMeasurement:
    """Solve the static balance for the masses.

    At rest ``A t`` carries the weight: ``m = (A t)_z / g``, and the moment about the platform's origin gives
    the horizontal place of the centre of mass, ``m x = -(A t)_my / g`` and ``m y = (A t)_mx / g`` in base
    axes. For a tilted platform these are turned into platform axes; that takes the height of the centre of
    mass, which a weight does not tell.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    pose
        Where the platform is.
    tensions
        Measured, (m,), N.
    payload_height
        Assumed z of the payload's centre of mass in platform, m.
    """
    wrench = inverse_kinematics(robot, pose).wrench_matrix @ tensions
    platform = robot.platform
    total_mass = float(wrench[2]) / _g
    mass = total_mass - platform.mass
    vertical_moment = platform.mass * platform.center_of_mass[2] + mass * payload_height
    Q = pose.rotation
    moment_in_base = np.array([-wrench[4], wrench[3]]) / _g
    total_moment = np.linalg.solve(Q[:2, :2], moment_in_base - Q[:2, 2] * vertical_moment)
    return PayloadMeasurement(
        wrench, total_mass, total_moment, mass, total_moment - platform.mass * platform.center_of_mass[:2]
    )
