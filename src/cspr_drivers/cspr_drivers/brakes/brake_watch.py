"""Motors that turn although their brake is closed: a brake that slips lets the load down while all else says "held"."""

from __future__ import annotations

import math

_SETTLING = 0.1  # s after a brake has closed in which it stops its motor
_MOVES = 1.0  # rad/s
_STEPS = (
    3  # positions in which a motor that slips is seen on its way: what steps and stands still is the encoder
)
_WINDOW = 60.0  # s after which motion counts anew: what a shaft creeps in days is no slip


class BrakeWatch:
    """How far each motor has turned since its brake closed. Angles in rad, times in s of one monotonic clock.

    Parameters
    ----------
    count
        Number of motors (m).
    limit
        Angle that is no slip: of the backlash of a brake, and the noise of an encoder.
    """

    def __init__(self, count: int, limit: float) -> None:
        self._limit = limit
        self._last = [(math.nan, math.nan)] * count  # time and angle
        self._closed: list[tuple[float, float, float] | None] = [None] * count  # when, where, how fast
        self._from = [(math.nan, math.nan)] * count  # time and angle that a slip is counted from
        self._steps = [0] * count  # positions since then that differ from those before
        self._moved = [-math.inf] * count
        self._slips: set[int] = set()

    def clear(self) -> None:
        """Begin anew: the operator has seen to it, or angles have another zero."""
        self._last = [(math.nan, math.nan)] * len(self._last)
        self._closed = [None] * len(self._closed)
        self._slips.clear()

    def observe(self, index: int, time: float, angle: float, closed: bool) -> float:
        """Return how far a motor has turned with its brake closed, with its sign, if that is a slip; else 0.

        Parameters
        ----------
        index
            Of the motor.
        time, angle
            When it was where.
        closed
            Whether its brake is closed, and nothing else holds it.
        """
        (before, was), self._last[index] = self._last[index], (time, angle)
        speed = abs(angle - was) / (time - before) if time > before else 0.0
        if not closed:
            self._closed[index] = None
            self._slips.discard(index)
            return 0.0
        closing = self._closed[index]
        if closing is None:
            closing = self._closed[index] = (time, angle, speed)
            self._from[index], self._steps[index] = (time, angle), 0
        settled = closing[0] + _SETTLING
        begin = self._from[index][0]
        if index not in self._slips and time >= settled and not settled <= begin >= time - _WINDOW:
            self._from[index], self._steps[index] = (time, angle), 0
        self._steps[index] += angle != was
        allowed = self._limit + (_SETTLING * closing[2] if time < settled else 0.0)
        if self._steps[index] >= _STEPS and abs(angle - self._from[index][1]) > allowed:
            self._slips.add(index)
        if speed > _MOVES:
            self._moved[index] = time
        return angle - closing[1] if index in self._slips else 0.0

    def moving(self, time: float) -> list[int]:
        """Return the motors, from 0, that have slipped within the last half second."""
        return sorted(index for index in self._slips if time - self._moved[index] < 5.0 * _SETTLING)
