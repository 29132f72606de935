"""The quintic from rest to rest, and its use as a smooth step.

``s(x) = 10 x^3 - 15 x^4 + 6 x^5`` runs from 0 to 1 while x does; its first and second derivative vanish at
both ends, so motions joined there have a continuous acceleration.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

PEAK_SPEED = 15.0 / 8.0
"""Largest s', at x = 1/2."""
PEAK_ACCELERATION = 10.0 / math.sqrt(3.0)
"""Largest \\|s''\\|, at x = (1 -+ 1/sqrt(3)) / 2."""


Reals = TypeVar("Reals", float, NDArray[np.float64])
"""One number, as in every control cycle, or an array of them."""


def within(x: Reals, low: float, high: float) -> Reals:
    """Return each number, or the nearer end of [low, high] where it lies outside."""
    if isinstance(x, np.ndarray):
        return np.clip(x, low, high)
    return min(max(x, low), high)


def quintic(x: Reals) -> tuple[Reals, Reals, Reals]:
    """Value, first and second derivative of the quintic; x outside [0, 1] counts as the nearer end."""
    x = within(x, 0.0, 1.0)
    value = x**3 * (10.0 + x * (-15.0 + 6.0 * x))
    first = 30.0 * x**2 * (1.0 - x) ** 2
    second = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x)
    return value, first, second


def quintic_integral(x: float) -> float:
    """Integral of the quintic from 0 to x in [0, 1]; 1/2 at x = 1."""
    x = min(max(x, 0.0), 1.0)
    return x**4 * (2.5 + x * (-3.0 + x))


def quintic_duration(distance: float, speed: float, acceleration: float) -> float:
    """Shortest duration (s) of a quintic over ``distance`` that keeps a speed and an acceleration limit.

    Distance, speed and acceleration share one unit of length, metres or radians.
    """
    return max(PEAK_SPEED * distance / speed, math.sqrt(PEAK_ACCELERATION * distance / acceleration))
