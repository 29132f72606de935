"""Conversion between SI quantities and the numbers that devices carry on the bus.

Drives count encoder increments (6064h) and torque in thousandths of the rated torque (6071h, 6077h);
amplifiers send the measured value with a fixed number of decimal digits (9130h, 6132h). Both directions stand
here, so that driver and emulated device cannot disagree about scale or sign. The unit of velocities (606Ch) is what
the drive says (60A9h, and 60A8h for positions): prefix, numerator, denominator and a reserved byte, highest first
(CiA 402-2; codes of units and prefixes: CiA 303-2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

from msgspec import Meta

_LARGEST = 2**31 - 1  # in 32 bits with a sign
_COUNTER = 2**32  # numbers that such a counter tells apart

_REVOLUTION = 0xB4
_INCREMENT = 0xB5
_RADIAN = 0x10
_SECOND = 0x03
_MINUTE = 0x47

_DURATION = {_SECOND: 1.0, _MINUTE: 60.0}

INCREMENTS = _INCREMENT << 16
"""60A8h of a drive that counts positions in encoder increments."""


def wrapped(counts: int) -> int:
    """Return a number as a counter of 32 bits with a sign shows it: after 2147483647 comes -2147483648."""
    return (counts + _COUNTER // 2) % _COUNTER - _COUNTER // 2


@dataclass(frozen=True)
class DriveUnits:
    """Scale and sign of one drive. Positive motor angle and torque pay the cable out.

    Position values (6064h) are those of a counter that wraps: of all angles that one may mean, the nearest to home.

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
    home_counts: Annotated[int, Meta(ge=-_LARGEST - 1, le=_LARGEST)]
    rated_torque: Annotated[float, Meta(ge=0.001)]
    torque_limit: Annotated[float, Meta(gt=0.0)]

    @cached_property
    def max_torque(self) -> int:
        """Torque limit in thousandths of the rated torque, rounded down (6072h)."""
        # The small excess keeps 1500 from becoming 1499 by a rounding error of the division.
        return math.floor(1000.0 * self.torque_limit / self.rated_torque * (1.0 + 1e-12))

    def angle(self, counts: int) -> float:
        """Return the motor angle, rad, at a position value."""
        return self.polarity * wrapped(counts - self.home_counts) * (2.0 * math.pi / self.encoder_increments)

    def counts(self, angle: float) -> int:
        """Return the position value nearest to a motor angle, rad."""
        increments = round(angle * self.encoder_increments / (2.0 * math.pi))
        return wrapped(self.home_counts + self.polarity * increments)

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


def velocity_unit(code: int, encoder_increments: int) -> float | None:
    """Return the velocity, rad/s, of one unit of 606Ch; `None` when the code is not known.

    Parameters
    ----------
    code
        Value of 60A9h.
    encoder_increments
        Increments per revolution of the motor shaft.
    """
    prefix, numerator, denominator = code >> 24, code >> 16 & 0xFF, code >> 8 & 0xFF
    angles = {_REVOLUTION: 2.0 * math.pi, _INCREMENT: 2.0 * math.pi / encoder_increments, _RADIAN: 1.0}
    if numerator not in angles or denominator not in _DURATION:
        return None
    exponent = prefix - 0x100 if prefix & 0x80 else prefix  # an INTEGER8: powers of ten
    if abs(exponent) > 9:
        return None
    return 10.0**exponent * angles[numerator] / _DURATION[denominator]
