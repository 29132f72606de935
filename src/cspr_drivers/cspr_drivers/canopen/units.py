"""Conversion between SI quantities and the numbers that devices carry on the bus.

Drives count encoder increments (6064h) and torque in thousandths of the rated torque (6071h, 6077h);
amplifiers send the measured value with a fixed number of decimal digits (9130h, 6132h). Both directions stand
here, so that driver and emulated device cannot disagree about scale or sign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

from msgspec import Meta

_LARGEST = 2**31 - 1  # in 32 bits with a sign


@dataclass(frozen=True)
class DriveUnits:
    """Scale and sign of one drive. Positive motor angle and torque pay the cable out.

    Attributes
    ----------
    polarity
        +1 when the encoder counts up as the cable is paid out, else -1.
    encoder_increments
        Increments per revolution of the motor shaft.
    home_counts
        Position value at the home pose, where the motor angle is zero.
    rated_torque
        Torque that the drive calls 1000, N m.
    torque_limit
        Largest torque at the motor shaft, N m.
    """

    polarity: Literal[1, -1]
    encoder_increments: Annotated[int, Meta(ge=1, le=_LARGEST)]
    home_counts: Annotated[int, Meta(ge=-_LARGEST, le=_LARGEST)]
    rated_torque: Annotated[float, Meta(ge=0.001)]
    torque_limit: Annotated[float, Meta(gt=0.0)]

    @cached_property
    def max_torque(self) -> int:
        """Torque limit in thousandths of the rated torque, rounded down (6072h)."""
        # The small excess keeps 1500 from becoming 1499 by a rounding error of the division.
        return math.floor(1000.0 * self.torque_limit / self.rated_torque * (1.0 + 1e-12))

    def angle(self, counts: int) -> float:
        """Return the motor angle, rad, at a position value."""
        return self.polarity * (counts - self.home_counts) * (2.0 * math.pi / self.encoder_increments)

    def counts(self, angle: float) -> int:
        """Return the position value nearest to a motor angle, rad."""
        return self.home_counts + self.polarity * round(angle * self.encoder_increments / (2.0 * math.pi))

    def torque(self, per_mille: int) -> float:
        """Return the torque, N m, of a number of thousandths of the rated torque."""
        return self.polarity * per_mille * self.rated_torque / 1000.0

    def per_mille(self, torque: float) -> int:
        """Return the nearest number of thousandths for a torque, N m, held within `max_torque`."""
        limit = self.max_torque
        return self.polarity * max(-limit, min(limit, round(1000.0 * torque / self.rated_torque)))


@dataclass(frozen=True)
class LoadCellUnits:
    """Scale and zero of one load cell. Tension is positive when the cable pulls.

    Attributes
    ----------
    decimal_digits
        Decimal digits of the process value (6132h).
    scale
        Tension of the cable for a displayed newton, from the cell's calibration.
    offset
        Tension that the cell shows for a slack cable, N, after scaling.
    """

    decimal_digits: Annotated[int, Meta(ge=0, le=6)]
    scale: float
    offset: float

    def tension(self, process_value: int) -> float:
        """Return the cable's tension, N, of a process value."""
        return self.scale * process_value / 10.0**self.decimal_digits - self.offset

    def process_value(self, tension: float) -> int:
        """Return the process value nearest to a tension, N."""
        return round((tension + self.offset) / self.scale * 10.0**self.decimal_digits)
