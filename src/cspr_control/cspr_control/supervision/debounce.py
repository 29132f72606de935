"""Debouncing: a limit counts as violated only after a while."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Debounce:
    """Tells when a limit has been violated without a break for longer than a stated time.

    The limit of a quantity that jumps for a moment in good operation (a cable goes slack when the reference
    changes its velocity at once) must not stop the robot at the first sample.

    Parameters
    ----------
    count
        Number m of cables or motors.
    allowed_time
        How long a violation may last, s.
    """

    def __init__(self, count: int, allowed_time: float) -> None:
        self._allowed_time = allowed_time
        self._since: NDArray[np.float64] = np.full(count, np.inf)

    def clear(self) -> None:
        """Forget what was seen."""
        self._since.fill(np.inf)

    def update(self, time: float, violated: ArrayLike) -> int | None:
        """Note which of the m violate the limit at ``time`` (monotonic, s).

        Returns
        -------
        The index of the one that has violated it longest, if that is longer than allowed; else None.
        """
        violated = np.asarray(violated, dtype=bool)
        self._since = np.where(violated, np.minimum(self._since, time), np.inf)
        first = int(self._since.argmin())
        return first if time - self._since[first] >= self._allowed_time else None
