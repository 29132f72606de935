"""A SocketCAN interface that filters in the kernel, counts dropped frames, and recovers when the interface comes back.

Sources: Linux kernel documentation, networking/can.rst (raw sockets, filters, error frames); socket(7) (SO_RCVBUF,
SO_RXQ_OVFL); linux/can/error.h (classes of error frames).
"""

from __future__ import annotations

import contextlib
import errno
import select
import socket
import struct
from collections.abc import Collection
from typing import Any

import can
from can.interfaces.socketcan import SocketcanBus

from cspr_drivers.clock import COMPUTER, Clock

_FRAME = struct.Struct("=IB3x8s")  # struct can_frame of linux/can.h
_TIMESTAMP = struct.Struct("@ll")  # struct timespec
_COUNT = struct.Struct("=I")

# Linux constants that Python's socket module does not name.
_SO_RCVBUFFORCE = 33
_SO_TIMESTAMPNS = 35
_SO_RXQ_OVFL = 40

_EXTENDED, _REMOTE, _ERROR = 1 << 31, 1 << 30, 1 << 29  # flags in the identifier
_STANDARD_ID, _ANY_ID = 0x7FF, 0x1FFF_FFFF

# The kernel accounts some 800 bytes for a frame: room for a second of a full bus of 1 Mbit/s, so that a driver that is
# held up loses its commands and not its frames.
RECEIVE_BUFFER = 8 << 20  # bytes

# The interface is gone for this socket: another one has its name now, or none.
GONE = (errno.ENODEV, errno.ENXIO)

_ANCILLARY = socket.CMSG_SPACE(_TIMESTAMP.size) + socket.CMSG_SPACE(_COUNT.size)

_BUS_OFF = 0x40  # classes of error frames
_CONTROLLER = 0x04
_CONTROLLER_STATES = {
    0x01: "receive buffer of the controller overflowed",
    0x02: "transmit buffer of the controller overflowed",
    0x04: "many receive errors (error warning)",
    0x08: "many transmit errors (error warning)",
    0x10: "receiver is error passive",
    0x20: "transmitter is error passive",
    0x40: "recovered to error active",
}
_CLASSES = {
    0x001: "transmission timed out",
    0x002: "lost arbitration",
    0x008: "protocol violation",
    0x010: "transceiver problem",
    0x020: "no acknowledge: no other node is on the bus",
    0x080: "bus error",
    0x100: "controller restarted",
}


class QuickSocketCan(SocketcanBus):  # type: ignore[misc]  # python-can's classes count as untyped
    """python-can's interface with the socket options that a driver needs.

    Parameters
    ----------
    channel
        Name of the network interface.
    cob_ids
        Standard identifiers of the frames to be received; `None` for all frames.
    clock
        Clock of the machine, to which the kernel's time stamps are converted.

    Attributes
    ----------
    dropped_frames
        Frames that the kernel dropped because the receive buffer was full, since the socket was opened.
    receive_buffer
        Size of the receive buffer that the kernel granted, bytes.
    """

    socket: Any  # of python-can's class

    def __init__(self, channel: str, cob_ids: Collection[int] | None = None, clock: Clock = COMPUTER) -> None:
        filters = None
        if cob_ids is not None:
            mask = _STANDARD_ID | _EXTENDED | _REMOTE
            filters = [{"can_id": identifier, "can_mask": mask} for identifier in sorted(cob_ids)]
        super().__init__(channel=channel, can_filters=filters)
        self._clock = clock
        self.dropped_frames = 0
        # Whether the interface was removed; the receiving thread binds to the next one of its name.
        self._gone = False
        self._set_options()

    def _set_options(self) -> None:
        self.socket.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
        try:
            self.socket.setsockopt(socket.SOL_SOCKET, _SO_RCVBUFFORCE, RECEIVE_BUFFER)
        except PermissionError:  # without CAP_NET_ADMIN the kernel grants up to net.core.rmem_max
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self.receive_buffer = self.socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Put a frame into the queue of the interface; never wait.

        Raises
        ------
        can.CanOperationError
            With error code ENOBUFS or EAGAIN when the queue is full.
        """
        identifier = msg.arbitration_id
        if msg.is_extended_id:
            identifier |= _EXTENDED
        if msg.is_remote_frame:
            identifier |= _REMOTE
        try:
            self.socket.send(_FRAME.pack(identifier, msg.dlc, bytes(msg.data)), socket.MSG_DONTWAIT)
        except OSError as error:
            self._gone = self._gone or error.errno in GONE
            raise can.CanOperationError(error.strerror or str(error), error.errno) from error

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        # The kernel reports once that an interface is gone, to the sender or to the receiver.
        if self._gone:
            self._open_again()
        try:
            if not select.select([self.socket], [], [], timeout)[0]:
                return None, True
            data, ancillary, _, _ = self.socket.recvmsg(_FRAME.size, _ANCILLARY)
        except OSError as error:
            self._gone = self._gone or error.errno in GONE
            raise can.CanOperationError(error.strerror or str(error), error.errno) from error
        identifier, length, content = _FRAME.unpack(data)
        timestamp = 0.0
        for _level, kind, value in ancillary:
            if kind == _SO_TIMESTAMPNS:
                seconds, nanoseconds = _TIMESTAMP.unpack_from(value)
                timestamp = seconds + 1e-9 * nanoseconds
            elif kind == _SO_RXQ_OVFL:
                (self.dropped_frames,) = _COUNT.unpack_from(value)
        extended = bool(identifier & _EXTENDED)
        message = can.Message(
            timestamp=timestamp,
            arbitration_id=identifier & (_ANY_ID if extended or identifier & _ERROR else _STANDARD_ID),
            is_extended_id=extended,
            is_remote_frame=bool(identifier & _REMOTE),
            is_error_frame=bool(identifier & _ERROR),
            dlc=length,
            data=content[:length],
            channel=self.channel,
        )
        return message, True

    def _open_again(self) -> None:
        """Bind a new socket to the name, for an interface that was removed and made again; later if there is none."""
        with contextlib.suppress(OSError, can.CanError):
            fresh = SocketcanBus(channel=self.channel, can_filters=self._filters)
            old, self.socket = self.socket, fresh.socket.dup()
            fresh.shutdown()
            old.close()
            self._set_options()
            self._gone = False


def error_frame_text(message: can.Message) -> str:
    """Return in words what an error frame of the kernel reports."""
    kind = message.arbitration_id
    if kind & _BUS_OFF:
        return "bus-off: the controller has left the bus after too many errors"
    if kind & _CONTROLLER and len(message.data) > 1:
        words = [text for bit, text in _CONTROLLER_STATES.items() if message.data[1] & bit]
    else:
        words = [text for bit, text in _CLASSES.items() if kind & bit]
    return ", ".join(words) or "error frame"


def is_bus_off(message: can.Message) -> bool:
    """Return whether an error frame reports that the controller has left the bus."""
    return bool(message.arbitration_id & _BUS_OFF)
