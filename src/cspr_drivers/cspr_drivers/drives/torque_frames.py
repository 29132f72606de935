"""The RPDO of each drive: control word and torque in one frame, and what a command must be to get into it."""

from __future__ import annotations

import math
from enum import Enum
from typing import NamedTuple

from cspr_drivers.canopen.frame_table import FunctionCode, cob_id
from cspr_drivers.config.can_config import CanConfig, DriveConfig


class CommandFault(Enum):
    """Why a command is not passed on; the value says it in words."""

    UNREADABLE = "unreadable"
    NOT_FINITE = "not finite"
    OUT_OF_RANGE = "beyond the torque limit"
    STALE = "older than the command timeout"
    AHEAD = "stamped later than the newest motor states"


def command_fault(torque: float, limit: float, age: float, timeout: float) -> CommandFault | None:
    """Return what is wrong with a command, or `None`.

    Parameters
    ----------
    torque, limit
        Commanded torque, and the largest allowed one, N m.
    age, timeout
        Stamp of the newest motor states less that of the command, and the largest age, s.
    """
    if not math.isfinite(torque):
        return CommandFault.NOT_FINITE
    if abs(torque) > limit:
        return CommandFault.OUT_OF_RANGE
    if age > timeout:
        return CommandFault.STALE
    return CommandFault.AHEAD if age < 0.0 else None


class Frame(NamedTuple):
    """A frame to be sent.

    Attributes
    ----------
    bus
        Name of its bus.
    cob_id, data
        As they go on the bus.
    deadline
        Monotonic time, s, until which it is worth sending again while the interface has no room for it.
    command
        Motor, from 0, whose torque command it passes on, and stamp of the motor states that the command answers.
    """

    bus: str
    cob_id: int
    data: bytes
    deadline: float = -math.inf
    command: tuple[int, int] | None = None


class TorqueFrame:
    """The RPDO of one drive.

    Parameters
    ----------
    config
        Frame layout.
    drive
        The drive.

    Attributes
    ----------
    torque
        Torque to be sent, in thousandths of the rated torque.
    stamp_ns
        Stamp of the newest motor states that a command has answered.
    sent
        Whether a frame was made since this was last set to `False`.
    control_word
        Control word of the last frame, `None` before the first.
    deadline
        Until when the last frame was worth sending, s.
    """

    def __init__(self, config: CanConfig, drive: DriveConfig) -> None:
        self.torque = 0
        self.stamp_ns = 0
        self.sent = False
        self.control_word: int | None = None
        self.deadline = -math.inf
        self._bus = drive.bus
        self._cob_id = cob_id(FunctionCode.RPDO1, drive.node_id)
        self._layout = config.pdo.drive_rpdo

    def make(self, control_word: int, deadline: float, command: tuple[int, int] | None = None) -> Frame:
        """Return the frame of a control word and the present torque."""
        self.sent = True
        self.control_word = control_word
        self.deadline = deadline
        data = self._layout.encode(control_word, self.torque)
        return Frame(self._bus, self._cob_id, data, deadline, command)
