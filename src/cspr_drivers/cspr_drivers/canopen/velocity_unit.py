"""Units of the velocity that drives report (606Ch), as the objects 60A8h and 60A9h name them.

Sources: CiA 402-2 (SI unit position, SI unit velocity), CiA 303-2 (codes of units and prefixes): the bytes of the
value are prefix, numerator, denominator and a reserved one, highest first.
"""

from __future__ import annotations

import math

_REVOLUTION = 0xB4
_INCREMENT = 0xB5
_RADIAN = 0x10
_SECOND = 0x03
_MINUTE = 0x47

_DURATION = {_SECOND: 1.0, _MINUTE: 60.0}

INCREMENTS = _INCREMENT << 16
"""60A8h of a drive that counts positions in encoder increments."""


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
