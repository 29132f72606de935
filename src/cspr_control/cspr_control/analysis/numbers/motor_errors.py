"""How far each motor is from where it should be: position and velocity error at the measured states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_control.errors import ControlError
from cspr_msgs_py.bag.columns import JointStates

Floats = NDArray[np.float64]
Times = NDArray[np.int64]

LONGEST_CARRY = 0.5
"""Age of a set-point from which it says nothing about a state any more, s."""


@dataclass(frozen=True, eq=False)
class MotorErrors:
    """Desired minus measured.

    Attributes
    ----------
    time_ns : ndarray, shape (n,)
        Stamps of the motor states.
    position, velocity : ndarray, shape (n, m)
        rad and rad/s, at the motor shaft.
    """

    time_ns: Times
    position: Floats
    velocity: Floats

    def part(self, chosen: NDArray[np.bool_]) -> MotorErrors:
        """Return the errors at some of the times."""
        return MotorErrors(self.time_ns[chosen], self.position[chosen], self.velocity[chosen])


def motor_errors(states: JointStates, setpoints: JointStates) -> MotorErrors:
    """Compare each measured state with the set-point that was in force.

    The newest set-point at or before a state, or the one that comes at most half a cycle after it, is carried to the
    state's time with its own speed, as the motor controllers do. States without a set-point of the last
    `LONGEST_CARRY` seconds are left out.

    Parameters
    ----------
    states, setpoints
        In the order of their stamps.

    Raises
    ------
    ControlError
        If no state has a set-point.
    """
    stamps = states.time_ns
    if stamps.size < 2 or setpoints.time_ns.size == 0:
        raise ControlError(
            f"there are {stamps.size} motor states and {setpoints.time_ns.size} set-points: no errors of the motors"
        )
    half_cycle = int(np.median(np.diff(stamps)) // 2)
    match = np.searchsorted(setpoints.time_ns, stamps + half_cycle, side="right") - 1
    ahead = (stamps - setpoints.time_ns[match]) * 1e-9
    valid = (match >= 0) & (ahead <= LONGEST_CARRY)
    if not valid.any():
        raise ControlError("no motor state has a set-point of the same time: no errors of the motors")
    match, ahead = match[valid], ahead[valid]
    demanded = setpoints.position[match] + setpoints.velocity[match] * ahead[:, None]
    return MotorErrors(
        stamps[valid], demanded - states.position[valid], setpoints.velocity[match] - states.velocity[valid]
    )
