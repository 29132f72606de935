"""When the messages of a bag are due: the bag's time, paced by the wall clock."""

import math
from typing import Final

from cspr_msgs_py.wire.cdr import NANOSECONDS

LATEST: Final = 0.5  # s behind the clock beyond which lost time is not made up


class ReplayPace:
    """The bag's time during a replay; clock readings are in seconds, the bag's time in ns.

    Parameters
    ----------
    start_ns : int
        Bag's time at the start.
    now : float
        Clock at the start.
    rate : float
        Seconds of the bag in a second.
    paused : bool
    """

    def __init__(self, start_ns: int, now: float, rate: float = 1.0, paused: bool = False) -> None:
        self.rate = rate
        self.paused = paused
        self._bag_ns = start_ns
        self._clock = now

    def time_ns(self, now: float) -> int:
        """Return the bag's time."""
        if self.paused:
            return self._bag_ns
        return self._bag_ns + round((now - self._clock) * self.rate * NANOSECONDS)

    def delay(self, time_ns: int, now: float) -> float:
        """Return the seconds until the bag's time is `time_ns`: infinite in a pause, negative when it is past."""
        if self.paused:
            return math.inf
        return self._clock + (time_ns - self._bag_ns) / NANOSECONDS / self.rate - now

    def catch_up(self, time_ns: int, now: float) -> bool:
        """Continue from `time_ns` if the replay is too late to catch up without distortion; return whether it was."""
        if self.delay(time_ns, now) > -LATEST:
            return False
        self.move(time_ns, now)
        return True

    def move(self, time_ns: int, now: float) -> None:
        """Let the bag's time be `time_ns` now."""
        self._bag_ns, self._clock = time_ns, now

    def pause(self, now: float, paused: bool = True) -> None:
        """Stop the bag's time, or let it run again."""
        self.move(self.time_ns(now), now)
        self.paused = paused

    def change_rate(self, rate: float, now: float) -> None:
        """Let the bag's time run at another rate from now on."""
        self.move(self.time_ns(now), now)
        self.rate = rate
