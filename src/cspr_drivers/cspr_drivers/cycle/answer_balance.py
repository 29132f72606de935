"""Answers that devices owe: one for each SYNC, and no more. Who gives more is not alone at its node id.

That holds however late answers are, so nobody is accused who is slow: what a device owes goes up at each SYNC and down
with each answer. Another device that answers every SYNC as well is found out in the third cycle.
"""

from __future__ import annotations

import math

_SPARE = 2  # answers that a device may be granted when it has long given one in each cycle


class AnswerBalance:
    """How many answers each device still owes.

    Parameters
    ----------
    count
        Number of devices, or of frames in which they answer.
    silence, period
        Time after which an answer does not come any more, and that of a cycle, s.
    """

    def __init__(self, count: int, silence: float, period: float) -> None:
        self._most = max(_SPARE, math.ceil(silence / period))
        self._owed = [_SPARE] * count
        self._given = [0] * count  # answers in the present cycle
        self._punctual = [0] * count  # cycles in a row with one answer each

    def sync(self) -> None:
        """Begin a cycle: from now on each device owes one more answer."""
        for index, given in enumerate(self._given):
            self._given[index] = 0
            self._punctual[index] = self._punctual[index] + 1 if given == 1 else 0
            # An answer that was lost would be owed for ever, and one of another device pass for it; a SYNC that this
            # computer has not heard, or a device twice, would count against the device for ever.
            if self._punctual[index] >= self._most:
                self._owed[index] = _SPARE
            self._owed[index] = min(self._owed[index], self._most) + 1

    def answered(self, index: int) -> bool:
        """Note an answer; return whether it is one more than the SYNC frames call for."""
        self._given[index] += 1
        if not self._owed[index]:
            return True
        self._owed[index] -= 1
        return False
