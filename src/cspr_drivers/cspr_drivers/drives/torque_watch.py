"""Drives that apply a torque other than the commanded one: a runaway pays out metres of cable in a second.

Its speed shows that only once the motor is fast; its torque (6077h) shows it in the next answer.
"""

from __future__ import annotations

from cspr_drivers.config.can_file import TorqueCheck


class TorqueWatch:
    """The torque commanded of each drive, the one it applies, and since when the two differ.

    A command that comes late in a cycle shows one answer later: an answer that fits the previous command is not wrong.
    Torques in N m at the motor shaft, times in s of one monotonic clock.

    Parameters
    ----------
    count
        Number of drives (m).
    check
        Difference and time that are allowed.
    """

    def __init__(self, count: int, check: TorqueCheck) -> None:
        self._difference = check.difference
        self._time = check.time
        self._told = [0.0] * count
        self._told_before = [0.0] * count
        self._since: list[float | None] = [None] * count

    def told(self, index: int, torque: float) -> None:
        """Note the torque that is commanded of a drive from now on."""
        self._told[index] = torque

    def answered(self, index: int, torque: float, time: float, operates: bool) -> str:
        """Check the torque that a drive reports; return what is wrong with it, or an empty text.

        Parameters
        ----------
        index
            Of the drive.
        torque
            As measured at a SYNC.
        time
            When the answer came.
        operates
            Whether the drive follows its torque at all; it is not checked otherwise.
        """
        told, before = self._told[index], self._told_before[index]
        self._told_before[index] = told
        fits = abs(torque - told) <= self._difference or abs(torque - before) <= self._difference
        since = self._since[index]
        if fits or not operates:
            self._since[index] = None
        elif since is None:
            self._since[index] = time
        elif time - since >= self._time:
            return f"applies {torque:z.2f} N m instead of {told:z.2f} N m"
        return ""
