"""The gains that have been computed safe, as a map in which a change is looked up within microseconds."""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

from cspr_control.errors import StabilityError
from cspr_control.motors.motor_control import MotorGains

RATIOS = tuple(2.0 ** (step / 2.0) for step in range(-4, 5))
"""Of the gains of the map to those of the configuration."""

_ROUNDING = 1e-9


@dataclass(frozen=True)
class SafeGains:
    """Gains on a grid, and at which of them the loop has its margins.

    Attributes
    ----------
    kp, kd
        Rows and columns of the grid, ascending.
    safe
        A truth value for each row and column.
    """

    kp: tuple[float, ...]
    kd: tuple[float, ...]
    safe: tuple[tuple[bool, ...], ...]

    def require(self, gains: MotorGains) -> None:
        """Refuse gains unless all four corners of their cell are safe.

        Raises
        ------
        StabilityError
            If they are not; says what is.
        """
        rows, columns = _around(self.kp, gains.kp), _around(self.kd, gains.kd)
        asked = f"kp = {gains.kp:g} N m/rad with kd = {gains.kd:g} N m s/rad"
        if not rows or not columns:
            raise StabilityError(
                f"{asked} lies outside of what has been computed, kp from {self.kp[0]:.3g} to {self.kp[-1]:.3g} and kd "
                f"from {self.kd[0]:.3g} to {self.kd[-1]:.3g}: change control.yaml and start again, or go there by steps"
            )
        if all(self.safe[row][column] for row in rows for column in columns):
            return
        fitting = [kd for column, kd in enumerate(self.kd) if all(self.safe[row][column] for row in rows)]
        remedy = (
            f"with this kp, kd from {fitting[0]:.3g} to {fitting[-1]:.3g} is"
            if fitting
            else "no kd is with this kp"
        )
        raise StabilityError(
            f"{asked} is not known to be stable with a margin; {remedy}; see cspr stability --help"
        )


def _around(values: tuple[float, ...], value: float) -> tuple[int, ...]:
    """Return the places of the neighbours of a value, both the same where it is one of them; none outside."""
    for place, known in enumerate(values):
        if math.isclose(known, value, rel_tol=_ROUNDING):
            return place, place
    after = bisect_right(values, value)
    return (after - 1, after) if 0 < after < len(values) else ()
