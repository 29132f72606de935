"""One measurement of the payload from what the cables pull at rest (eqs. 16 and 17)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics import GRAVITY, Robot

_g = -float(GRAVITY[2])  # m/s^2


@dataclass(frozen=True, eq=False)
class PayloadMeasurement:
    """What the cables' pull at one instant says about what hangs from them.

    Attributes
    ----------
    total_mass
        Of platform and payload, kg.
    total_moment
        Total mass times x and y of the common centre of mass in platform (2,), kg m.
    mass, moment
        The same of the payload alone. The mass can be negative by measurement errors.
    """

    total_mass: float
    total_moment: NDArray[np.float64]
    mass: float
    moment: NDArray[np.float64]


def measure_payload(
    robot: Robot, rotation: NDArray[np.float64], wrench: NDArray[np.float64], payload_height: float = 0.0
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
    rotation
        Of the platform, (3, 3).
    wrench
        ``A t`` (6,) of the cables on the platform about its origin, in base, N and N m.
    payload_height
        Assumed z of the payload's centre of mass in platform, m.
    """
    platform = robot.platform
    total_mass = float(wrench[2]) / _g
    mass = total_mass - platform.mass
    vertical_moment = platform.mass * platform.center_of_mass[2] + mass * payload_height
    Q = rotation
    moment_in_base = np.array([-wrench[4], wrench[3]]) / _g
    total_moment = np.linalg.solve(Q[:2, :2], moment_in_base - Q[:2, 2] * vertical_moment)
    return PayloadMeasurement(
        total_mass, total_moment, mass, total_moment - platform.mass * platform.center_of_mass[:2]
    )
