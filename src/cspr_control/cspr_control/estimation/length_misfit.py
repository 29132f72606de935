"""Whether the lengths of a run fit poses as well as their stated uncertainty says (docs/calibration.md)."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cspr_kinematics import Robot

SPACING = 0.005
"""Share of the cables' mean length at home by which a cable changes from one place to the next."""
_LEAST_PLACES = 20


class LengthMisfit:
    """The root mean square of |e|, the errors of all lengths at the pose that fits them best, over a run.

    Each place counts once, however long the robot stands there: at home, where the motors are at zero, all lengths
    fit whatever the geometry is.

    Attributes
    ----------
    places
        Number of places that counted so far.
    explained
        What errors of the robot's `length_deviation` leave on average, m; infinite for six cables, which always fit.
    """

    def __init__(self, robot: Robot) -> None:
        m = robot.number_of_cables
        self.places = 0
        self.explained = robot.length_deviation * math.sqrt(m - 6) if m > 6 else math.inf
        self._spacing = SPACING * float(robot.winch.home_lengths.mean())
        self._last = robot.winch.home_lengths
        self._squares = 0.0

    @property
    def rms(self) -> float:
        """Over the places so far, m; not-a-number before the first."""
        return math.sqrt(self._squares / self.places) if self.places else math.nan

    def observe(self, lengths: NDArray[np.float64], errors: NDArray[np.float64]) -> None:
        """Count lengths (m,) and their errors (m,) at the pose that fits them best, m, if they are of another place."""
        if np.abs(lengths - self._last).max() < self._spacing:
            return
        self._last = lengths.copy()
        self.places += 1
        self._squares += float(errors @ errors)

    @property
    def problem(self) -> str:
        """What is wrong with the robot's description, if the lengths say that something is; else empty."""
        if self.places < _LEAST_PLACES or self.rms <= self.explained:
            return ""
        return (
            f"cable lengths misfit by {1e3 * self.rms:.2f} mm RMS over {self.places} places, where length_uncertainty "
            f"explains {1e3 * self.explained:.2f} mm: pulleys that robot.yaml does not describe, or wrong exit or "
            "anchor points; record a run and find the pulleys' radius with cspr identify BAG"
        )
