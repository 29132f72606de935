"""When frames are through on a classical CAN bus: their length, and who goes first.

Pure: time is an argument. The bus carries one frame at a time. When it becomes free the waiting frame with the
lowest identifier goes next (ISO 11898-1, bitwise arbitration). Each frame takes the bits that it has when every
stuff bit is needed, so that a cycle that fits here fits on a real bus.
"""

from __future__ import annotations

import errno
import math
import os
from collections import Counter
from enum import Enum, auto
from heapq import heappop, heappush
from typing import NamedTuple

import can

from cspr_drivers.bus.bus_load import worst_case_bits

BABBLING_COB_ID = 0x001
"""Identifier of a babbling node's frames: before everything but NMT."""

DRIVER = "driver"
"""The sender whose interface goes down, is removed, or whose controller goes off the bus."""

_TRANSMIT_QUEUE = 64  # frames that wait with one sender, as `txqueuelen` of an interface
_ERROR_FRAME_BITS = 23  # active error flag, echo, delimiter and interframe space


class BusDisturbance(Enum):
    """What keeps frames from getting through."""

    NONE = auto()
    CUT = auto()  # frames wait forever
    OFF = auto()  # the driver's controller has left the bus, and said so; what it is given to send is lost
    DOWN = auto()  # the driver's interface is down and refuses frames
    REMOVED = auto()  # the driver's interface is gone
    BABBLING = auto()  # a node sends without a pause
    ERROR_FRAMES = auto()  # every frame is destroyed; its sender gives it up


# What SocketCAN says to a frame for an interface that takes none.
_REFUSALS = {BusDisturbance.DOWN: errno.ENETDOWN, BusDisturbance.REMOVED: errno.ENXIO}
_LOSES_FRAMES = (BusDisturbance.OFF, *_REFUSALS)
_BUS_OFF = 0x40  # class of error frames, linux/can/error.h


class Passed(NamedTuple):
    """A frame that is through: when, s, who sent it, and the frame."""

    time: float
    sender: object
    frame: can.Message


_Waiting = tuple[int, int, object, can.Message]  # identifier, number in the order of offers, sender, frame


class BusTiming:
    """The frames that wait for one bus, and the one that is on it. Not thread-safe: the caller serialises.

    Parameters
    ----------
    bitrate
        bit/s.
    """

    def __init__(self, bitrate: int) -> None:
        self._lengths = tuple(worst_case_bits(length) / bitrate for length in range(9))
        self._error_frame = _ERROR_FRAME_BITS / bitrate
        self._waiting: list[_Waiting] = []  # a heap: by identifier, then by age
        self._held: Counter[object] = Counter()
        self._count = 0
        self._current: _Waiting | None = None  # on the bus, from `_start` to `_end`
        self._start = 0.0
        self._end = math.inf
        self._free = 0.0  # when the last frame was through
        self._newest = 0.0  # when the last frame was offered
        self._looked_at = 0.0
        self._done: list[Passed] = []
        self._disturbance = BusDisturbance.NONE

    def offer(self, frame: can.Message, sender: object, time: float) -> None:
        """Let a frame wait for the bus from a time, s, on; never from before a frame that was offered earlier.

        Raises
        ------
        can.CanOperationError
            With ENOBUFS, if too many frames of this sender wait already; with ENETDOWN or ENXIO, if its interface is
            down or gone.
        """
        if self._disturbance is not BusDisturbance.NONE and self._disturbance in _LOSES_FRAMES:
            refusal = _REFUSALS.get(self._disturbance)
            if refusal is not None and sender == DRIVER:
                raise can.CanOperationError(os.strerror(refusal), error_code=refusal)
            return
        if self._held[sender] >= _TRANSMIT_QUEUE:
            raise can.CanOperationError("transmit buffer full", error_code=errno.ENOBUFS)
        self._held[sender] += 1
        self._count += 1
        self._newest = time = max(time, self._newest)
        if self._end <= time:
            self._advance(time)
        heappush(self._waiting, (frame.arbitration_id, self._count, sender, frame))
        if self._current is None:
            self._begin(max(self._free, time))
        elif time <= self._start and frame.arbitration_id < self._current[0]:
            self._withdraw()  # arbitration is between all frames that wait when the bus becomes free
            self._begin(self._start)

    def disturb(self, disturbance: BusDisturbance) -> None:
        """Set what disturbs the bus from the time of the last look at it on."""
        self._free = max(self._free, self._looked_at)
        self._withdraw()
        self._disturbance = disturbance
        if disturbance in _LOSES_FRAMES:
            self._waiting.clear()
            self._held.clear()
        if disturbance is BusDisturbance.OFF:
            told = can.Message(
                arbitration_id=_BUS_OFF, is_error_frame=True, is_extended_id=False, dlc=8, data=bytes(8)
            )
            self._done.append(Passed(self._looked_at, self, told))
        self._begin(self._free)

    @property
    def disturbed(self) -> bool:
        """Whether something disturbs the bus."""
        return self._disturbance is not BusDisturbance.NONE

    def passed(self, time: float) -> list[Passed]:
        """Return, once, the frames that are through at a time, s, in their order."""
        self._looked_at = time
        self._advance(time)
        done, self._done = self._done, []
        return done

    def next_end(self) -> float | None:
        """Return when the next frame is through, s, if none is offered before it; `None` when none waits."""
        if self._done:
            return self._done[0].time
        return None if self._current is None else self._end

    def last_end(self) -> float:
        """Return when all frames that wait now are through, s, if none is offered meanwhile."""
        end = self._free if self._current is None else self._end
        return end + sum(self._lengths[len(entry[3].data)] for entry in self._waiting)

    def _advance(self, time: float) -> None:
        while self._end <= time:
            assert self._current is not None  # it is on the bus until `_end`
            _, _, sender, frame = self._current
            if sender is not self:
                self._held[sender] -= 1
            if self._disturbance is BusDisturbance.ERROR_FRAMES:
                frame, sender = can.Message(is_error_frame=True, is_extended_id=False), self
            self._done.append(Passed(self._end, sender, frame))
            self._free = self._end
            self._begin(self._free)

    def _begin(self, time: float) -> None:
        """Let the frame with the lowest identifier have the bus from a time, s, on, if one may have it."""
        waiting = self._waiting
        self._current, self._start, self._end = None, time, math.inf
        if self._disturbance is BusDisturbance.BABBLING and not (waiting and waiting[0][0] < BABBLING_COB_ID):
            babble = can.Message(arbitration_id=BABBLING_COB_ID, data=bytes(8), is_extended_id=False)
            self._current = (BABBLING_COB_ID, 0, self, babble)
        elif waiting and self._disturbance is not BusDisturbance.CUT:
            self._current = heappop(waiting)
        else:
            return
        self._end = time + self._lengths[len(self._current[3].data)]
        if self._disturbance is BusDisturbance.ERROR_FRAMES:
            self._end += self._error_frame

    def _withdraw(self) -> None:
        """Take the frame off the bus again; it waits as before."""
        if self._current is not None and self._current[2] is not self:
            heappush(self._waiting, self._current)
        self._current, self._end = None, math.inf
