"""How fast a load swings that hangs on a sling, from its pull."""

from __future__ import annotations

import math
from collections import deque
from functools import cache

import numpy as np
from numpy.typing import NDArray

_STEP = 0.02  # s between two entries of the memory
_SPANS = (100, 60, 40, 30)  # entries
_SLOWEST, _FASTEST = 2.0 * math.pi * 0.35, 2.0 * math.pi * 2.0  # rad/s: slings of 2 m and of 60 mm
_LONG = 60  # entries from which an error of the pull can be told from the swing
_EXPLAINED = 0.95  # share of the pull's variance that a pendulum must explain

Complex = NDArray[np.complex128]


class SwingFrequency:
    """Finds the angular frequency omega of a pendulum from what it pulls and how its hook moves.

    A load at the horizontal distance e from the plumb line of its hook pulls with w = omega^2 e per unit of its mass.
    By Newton's law its own acceleration is -w, so that e'' = -(w + a) with the hook's acceleration a, whatever that
    is. Integrated twice, with a polynomial for what is not known of the beginning and for a constant error of w,

        w = omega^2 e_2 + c_0 + c_1 t + c_2 t^2,   e_2'' = -(w + a),

    of which the last two seconds give omega^2 by least squares, or the newest part of them that fits: what was before
    may have been another load. Two integrals take noise away where two derivatives would add it. A rigid load has
    w + a = 0, which no frequency explains.

    Vectors along x and y of base are complex numbers.
    """

    def __init__(self) -> None:
        self._times: deque[float] = deque(maxlen=_SPANS[0])
        self._pulls, self._apart = np.zeros((2, _SPANS[0]), dtype=complex)  # w and w + a, the newest last

    def clear(self) -> None:
        """Begin anew."""
        self._times.clear()

    def update(self, time: float, pull: complex, hook: complex, smallest: float) -> float | None:
        """Take what the load does at a time; return omega, rad/s, if it can be told.

        Parameters
        ----------
        time
            In s.
        pull, hook
            w and a, m/s^2.
        smallest
            Root mean square of what the polynomial leaves of w, from which omega can be told, m/s^2.
        """
        times = self._times
        since = time - times[-1] if times else math.inf
        if since < 0.95 * _STEP:
            return None
        if since > 1.5 * _STEP:
            times.clear()
        times.append(time)
        for memory, newest in ((self._pulls, pull), (self._apart, pull + hook)):
            memory[:-1] = memory[1:]
            memory[-1] = newest
        count = len(times)
        if count < _SPANS[-1]:
            return None
        moved = np.zeros(count, dtype=complex)  # e_2, whose second differences are -(w + a)
        step = (times[-1] - times[0]) / (count - 1)
        moved[1:] = np.cumsum(np.cumsum(self._apart[-count:-1])) * -(step**2)
        for span in _SPANS:
            if span <= count and (omega := _fitted(self._pulls[-span:], moved[-span:], smallest)) is not None:
                return omega
        return None


def _fitted(pulls: Complex, moved: Complex, smallest: float) -> float | None:
    """Return omega, rad/s, by which w fits e_2, if it does."""
    count = len(pulls)
    basis = _polynomials(count)
    pulls = pulls - basis @ (pulls @ basis)
    strength = np.vdot(pulls, pulls).real
    if strength < count * smallest**2:
        return None
    moved = moved - basis @ (moved @ basis)
    common, motion = np.vdot(moved, pulls).real, np.vdot(moved, moved).real
    if common <= 0.0 or common**2 < _EXPLAINED * strength * motion:
        return None
    omega = math.sqrt(common / motion)
    return omega if _SLOWEST <= omega <= _FASTEST else None


@cache
def _polynomials(count: int) -> Complex:
    """Return an orthonormal basis (count, n) of the polynomials of second order on a grid; of first order if short."""
    order = 2 if count >= _LONG else 1
    return np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, count), order + 1))[0].astype(complex)
