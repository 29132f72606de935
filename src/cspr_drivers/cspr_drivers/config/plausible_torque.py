"""Whether the rated torques of drives can be true: one that is in another unit than mN m is wrong by a thousand."""

from __future__ import annotations

from collections.abc import Sequence

_LIMITS = (
    0.02,
    32.767,
)  # largest torque of a motor in units of its rated one; 6071h counts its thousandths in 16 bits
_ALIKE = 10.0  # between the winches of one robot


def torque_doubt(rated_torque: float, torque_limit: float, others: Sequence[float] = ()) -> str:
    """Return in words why a drive's rated torque cannot be true; empty when it can.

    Parameters
    ----------
    rated_torque
        What the drive calls its rated torque (6076h), N m.
    torque_limit
        Largest torque that its motor is to have, N m.
    others
        Rated torques of the robot's other drives, N m.
    """
    low, high = _LIMITS
    if not low <= torque_limit / rated_torque <= high:
        return (
            f"torque_limit, {torque_limit:g} N m, must be from {low:g} to {high:g} times rated_torque, "
            f"{rated_torque:g} N m: does the drive count 6076h in mN m?"
        )
    for other in others:
        if not 1.0 / _ALIKE <= rated_torque / other <= _ALIKE:
            return (
                f"rated_torque, {rated_torque:g} N m, is more than {_ALIKE:g} times off that of another drive, "
                f"{other:g} N m: do both count 6076h in mN m?"
            )
    return ""
