"""When frames are through on a classical CAN bus: their length, and who goes first.

Pure: time is an argument. The bus carries one frame at a time. When it becomes free the waiting frame with the
lowest identifier goes next (ISO 11898-1, bitwise arbitration). Each frame takes the bits that it has when every
stuff bit is needed, so that a cycle that fits here fits on a real bus.
"""

from __future__ import annotations

import errno
import os
from collections import Counter, deque
from enum import Enum, auto
from heapq import heappop, heappush
from typing import NamedTuple, Protocol

import can

from cspr_drivers.bus.bus_load import worst_case_bits
from cspr_drivers.bus.can_bus import copied_frame

BABBLING_COB_ID = 0x001
"""Identifier of a babbling node's frames: before everything but NMT."""

DRIVER = "driver"
"""The sender whose interface goes down, is removed, or whose controller goes off the bus."""

_TRANSMIT_QUEUE = 64  # frames that wait with one sender, as `txqueuelen` of an interface
_ERROR_FRAME_BITS = 23  # active error flag, echo, delimiter and interframe space


class BusDisturbance(Enum):
    """What keeps frames from passing."""

    NONE = auto()
    CUT = auto()  # frames wait forever
    OFF = auto()  # the driver's controller has left the bus, and said so; what it is given is lost
    DOWN = auto()  # the driver's interface is down and refuses frames
    REMOVED = auto()  # the driver has no interface any more
    BABBLING = auto()  # a node sends without a pause
    ERROR_FRAMES = auto()  # every frame is destroyed; its sender gives it up


# What SocketCAN says to a frame for an interface that takes none.
_REFUSALS = {BusDisturbance.DOWN: errno.ENETDOWN, BusDisturbance.REMOVED: errno.ENXIO}
_LOSES_FRAMES = (BusDisturbance.OFF, *_REFUSALS)
_BUS_OFF = 0x40  # class of error frames, linux/can/error.h


class Disturbable(Protocol):
    """A bus on which things can go wrong."""

    def disturb(self, disturbance: BusDisturbance) -> None:
        """Let something disturb the bus from now on, or no longer."""


class Passed(NamedTuple):
    """A frame that is through: when, s, who sent it, and the frame."""

    time: float
    sender: object
    frame: can.Message


class BusTiming:
    """The frames that wait for one bus, and the one that is on it. Not thread-safe: the caller serialises.

    Parameters
    ----------
    bitrate
        bit/s.
    """

    def __init__(self, bitrate: int) -> None:
        self._bit = 1.0 / bitrate
        self._lengths = tuple(worst_case_bits(length) / bitrate for length in range(9))
        self._offered: deque[tuple[float, int, object, can.Message]] = deque()
        self._waiting: list[tuple[int, int, object, can.Message]] = []  # by identifier, then by age
        self._held: Counter[object] = Counter()
        self._count = 0
        self._free = 0.0
        self._looked_at = 0.0
        self._disturbance = BusDisturbance.NONE
        self._to_tell: list[can.Message] = []
        self._babble = can.Message(arbitration_id=BABBLING_COB_ID, data=bytes(8), is_extended_id=False)

    def offer(self, frame: can.Message, sender: object, time: float) -> None:
        """Let a frame wait for the bus from a time, s, on; never from before a frame that was offered earlier.

        Raises
        ------
        can.CanOperationError
            With ENOBUFS, if too many frames of this sender wait already; with ENETDOWN or ENXIO, if its interface is
            down or gone.
        """
        refusal = _REFUSALS.get(self._disturbance)
        if refusal is not None and sender == DRIVER:
            raise can.CanOperationError(os.strerror(refusal), error_code=refusal)
        if self._held[sender] >= _TRANSMIT_QUEUE:
            raise can.CanOperationError("transmit buffer full", error_code=errno.ENOBUFS)
        self._held[sender] += 1
        self._count += 1
        if self._offered:
            time = max(time, self._offered[-1][0])
        self._offered.append((time, self._count, sender, frame))

    def disturb(self, disturbance: BusDisturbance) -> None:
        """Let something disturb the bus, or no longer, from the time on for which it was last looked at."""
        self._free = max(self._free, self._looked_at)
        self._disturbance = disturbance
        self._to_tell = []
        if disturbance is BusDisturbance.OFF:
            self._to_tell.append(
                can.Message(
                    arbitration_id=_BUS_OFF, is_error_frame=True, is_extended_id=False, dlc=8, data=bytes(8)
                )
            )

    @property
    def disturbed(self) -> bool:
        """Whether something disturbs the bus."""
        return self._disturbance is not BusDisturbance.NONE

    def passed(self, time: float) -> list[Passed]:
        """Return, once, the frames that are through at a time, s, in their order."""
        done: list[Passed] = []
        self._looked_at = time
        if self._disturbance in _LOSES_FRAMES:
            self._offered.clear()
            self._waiting.clear()
            self._held.clear()
        if self._disturbance is BusDisturbance.CUT or self._disturbance in _LOSES_FRAMES:
            self._free = time
            done.extend(Passed(time, self, frame) for frame in self._to_tell)
            self._to_tell = []
            return done
        babbling = self._disturbance is BusDisturbance.BABBLING
        offered, waiting = self._offered, self._waiting
        while waiting or offered or babbling:
            if not waiting and not babbling:
                self._free = max(self._free, offered[0][0])  # until then the bus was idle
            start = self._free
            while offered and offered[0][0] <= start:
                _, count, sender, frame = offered.popleft()
                heappush(waiting, (frame.arbitration_id, count, sender, frame))
            if babbling and not (waiting and waiting[0][0] < BABBLING_COB_ID):
                end = start + self._lengths[8]
                if end > time:
                    break
                done.append(Passed(end, self, copied_frame(self._babble)))
            else:
                frame = waiting[0][3]
                end = start + self._lengths[len(frame.data)]
                if end > time:
                    break
                _, _, sender, frame = heappop(waiting)
                self._held[sender] -= 1
                if self._disturbance is BusDisturbance.ERROR_FRAMES:
                    end += _ERROR_FRAME_BITS * self._bit
                    frame, sender = can.Message(is_error_frame=True, is_extended_id=False), self
                done.append(Passed(end, sender, frame))
            self._free = end
        return done

    def next_end(self) -> float | None:
        """Return when the next frame is through, s, if none is offered before it; `None` when none waits."""
        if self._to_tell:
            return self._looked_at
        if self._disturbance is BusDisturbance.CUT or self._disturbance in _LOSES_FRAMES:
            return None
        if self._disturbance is BusDisturbance.BABBLING:
            return self._free + self._lengths[8]
        if self._waiting:
            return self._free + self._lengths[len(self._waiting[0][3].data)]
        if not self._offered:
            return None
        start = max(self._free, self._offered[0][0])
        first = min((o for o in self._offered if o[0] <= start), key=lambda o: (o[3].arbitration_id, o[1]))
        return start + self._lengths[len(first[3].data)]

    def last_end(self) -> float:
        """Return when all frames that wait now are through, s, if none is offered meanwhile."""
        end = self._free + sum(self._lengths[len(entry[3].data)] for entry in self._waiting)
        for time, _, _, frame in self._offered:
            end = max(end, time) + self._lengths[len(frame.data)]
        return end
