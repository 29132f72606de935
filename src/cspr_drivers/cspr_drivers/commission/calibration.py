"""Calibration of a load cell with dead weights: the straight line of least squares, and how far points lie off it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cspr_drivers.errors import DriverError

GRAVITY = 9.81  # m/s^2, as in the robot's model

LARGEST_RESIDUAL = 0.01  # of the largest load


class CalibrationError(DriverError):
    """The readings do not make a calibration: weights, wiring or cell are not what they should be."""


@dataclass(frozen=True)
class Calibration:
    """Tension = `scale` * reading - `offset`, all in N.

    Attributes
    ----------
    scale, offset
        Of the line, as `can.yaml` has them.
    rms_residual, largest_residual
        Of the loads about the line, N.
    """

    scale: float
    offset: float
    rms_residual: float
    largest_residual: float


def calibrate(readings: Sequence[float], masses: Sequence[float]) -> Calibration:
    """Return the calibration of least squares.

    Parameters
    ----------
    readings
        What the cell shows with each weight, N (n,).
    masses
        The weights, kg (n,); 0 for the slack cable.

    Raises
    ------
    CalibrationError
        If there are less than two different weights, the reading does not change with them, or a point is further
        off the line than a hundredth of the largest load.
    """
    shown = np.asarray(readings, dtype=float)
    loads = GRAVITY * np.asarray(masses, dtype=float)
    if np.unique(loads).size < 2:
        raise CalibrationError("at least two different weights are needed; a slack cable counts as 0 kg")
    if np.ptp(shown) < 0.1 * np.ptp(loads):
        raise CalibrationError(
            f"the reading changes by {np.ptp(shown):.1f} N with a load that changes by {np.ptp(loads):.1f} N: "
            "is the weight on this cable, and is this its load cell?"
        )
    columns = np.column_stack([shown, -np.ones_like(shown)])
    (scale, offset), *_ = np.linalg.lstsq(columns, loads, rcond=None)
    residuals = loads - columns @ np.array([scale, offset])
    largest = float(np.abs(residuals).max())
    if largest > LARGEST_RESIDUAL * loads.max():
        raise CalibrationError(
            f"a point lies {largest:.1f} N off the line, more than {100 * LARGEST_RESIDUAL:g} % of the largest load: "
            "check the weights and whether they hang freely"
        )
    return Calibration(float(scale), float(offset), float(np.sqrt(np.mean(residuals**2))), largest)
