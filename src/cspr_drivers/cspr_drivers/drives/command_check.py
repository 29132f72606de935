"""What a torque command must be before it may reach a drive."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum


class CommandFault(Enum):
    """Why a command is not passed on; the value says it in words."""

    UNREADABLE = "unreadable"
    NOT_FINITE = "not finite"
    OUT_OF_RANGE = "beyond the torque limit"
    STALE = "older than the command timeout"
    AHEAD = "stamped later than the newest motor states"


@dataclass(frozen=True)
class CommandCheck:
    """Limits of one motor's command.

    Attributes
    ----------
    torque_limit
        Largest absolute torque, N m.
    timeout
        Largest age, s.
    """

    torque_limit: float
    timeout: float

    def fault(self, torque: float, age: float) -> CommandFault | None:
        """Return what is wrong with a command, or `None`.

        Parameters
        ----------
        torque
            Torque demanded, N m.
        age
            Stamp of the newest motor states less that of the command, s.
        """
        if not math.isfinite(torque):
            return CommandFault.NOT_FINITE
        if abs(torque) > self.torque_limit:
            return CommandFault.OUT_OF_RANGE
        if age > self.timeout:
            return CommandFault.STALE
        if age < 0.0:
            return CommandFault.AHEAD
        return None
