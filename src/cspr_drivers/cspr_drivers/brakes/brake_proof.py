"""The proof that closed brakes hold, before the drives lose their torque.

Brakes that the host commands (60FEh) close while the drives stay in operation. Then the torque is taken back, with the
drives ready to give it again within a cycle, and each brake carries its load alone.
"""

from __future__ import annotations

import math

DURATION = 0.2  # s, of the test of all brakes
_RAMP = 0.05  # s of it, in which the torque goes


class BrakeProof:
    """A test of all brakes at once. Angles in rad, times in s of one monotonic clock.

    Parameters
    ----------
    count
        Number of motors (m).
    limit
        Angle by which a motor may turn.

    Attributes
    ----------
    slipped
        How far each motor whose brake does not hold had turned when that showed, rad, by motor from 0.
    """

    def __init__(self, count: int, limit: float) -> None:
        self._limit = limit
        self._angles = [math.nan] * count
        self._since: float | None = None
        self.slipped: dict[int, float] = {}

    def begin(self, time: float) -> None:
        """Begin to take the torque back: all brakes are closed. Nothing happens if that is so already."""
        if self._since is None:
            self._since = time

    def observe(self, index: int, angle: float) -> None:
        """Note where a motor is; as soon as one has turned too far all drives have their torque again."""
        if self._since is None:
            self._angles[index] = angle
        elif abs(angle - self._angles[index]) > self._limit and index not in self.slipped:
            self.slipped[index] = angle - self._angles[index]

    def torque_share(self, time: float) -> float:
        """Return which share of its torque a drive is to have at a time."""
        if self._since is None or self.slipped:
            return 1.0
        return max(0.0, 1.0 - (time - self._since) / _RAMP)

    def passed(self, time: float) -> bool:
        """Return whether all brakes have held for long enough."""
        return self._since is not None and not self.slipped and time - self._since >= DURATION
