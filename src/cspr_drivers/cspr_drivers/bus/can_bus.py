"""An open CAN bus: a python-can bus, CANopen's network on it, and one receiving thread."""

from __future__ import annotations

import errno
import logging
import math
import struct
import threading
import traceback
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import can
import canopen

from cspr_drivers.bus.socketcan_bus import GONE, error_frame_text, is_bus_off
from cspr_drivers.clock import COMPUTER, Clock
from cspr_drivers.errors import FrameError
from cspr_drivers.thread_end import end_text

FrameHandler = Callable[[bytes | bytearray, float], None]

# Both libraries log what they also raise; the errors of this package say it once, in one line.
for library in ("can", "canopen"):
    logging.getLogger(library).addHandler(logging.NullHandler())

# The queue of the interface is full (txqueuelen), or the buffer of the socket is.
_NO_ROOM = (errno.ENOBUFS, errno.EAGAIN)
_RETRY_INTERVAL = 200e-6  # s; some two frames on a bus of 1 Mbit/s
# The interface is down, or it is gone.
_NO_INTERFACE = (errno.ENETDOWN, *GONE)


class CyclicFrame(can.Message):  # type: ignore[misc]  # python-can's classes count as untyped
    """A data frame with an 11-bit identifier that is sent again and again with other data.

    Parameters
    ----------
    cob_id
        Its COB-ID.
    data
        Its data; `assign` replaces it.
    """

    def __init__(self, cob_id: int, data: bytes = b"") -> None:
        super().__init__(arbitration_id=cob_id, data=data, is_extended_id=False)

    def assign(self, data: bytes) -> None:
        """Replace the data."""
        self.data = data
        self.dlc = len(data)


class CanPort:
    """One open bus: frames go out by `send`, and come in at the handler of their COB-ID.

    Handlers run in the bus's receiving thread and get the data of the frame and the moment at which it was on
    the bus, in seconds of the monotonic clock. Frames without a handler of this class go to `network`.

    Attributes
    ----------
    name
        Name of the bus in the configuration.
    clock
        Clock of the machine.
    network
        The CANopen network on this bus, for NMT, SDO and EMCY.
    unknown_frames, malformed_frames, send_errors, send_retries, bus_errors
        Counts since the bus was opened. Frames of unknown COB-IDs are seen only on interfaces without filters.
    last_problem
        The newest problem that was counted, in words; empty without any.
    failure
        Why the interface takes no frames at all, in words, until one is sent again; empty otherwise.
    ended
        Why nothing is received any more, in words, for good: the receiving thread has ended; empty otherwise.
    on_failure
        Called, in the receiving thread, with the reason when the bus no longer carries frames; `None` for nobody.
    """

    def __init__(
        self, name: str, bus: can.BusABC, known_cob_ids: Iterable[int] = (), clock: Clock = COMPUTER
    ) -> None:
        self.name = name
        self.clock = clock
        self.network = canopen.Network(bus)
        self.network.NOTIFIER_CYCLE = 0.1  # s; how often the receiving thread checks whether to end
        self.unknown_frames = 0
        self.malformed_frames = 0
        self.send_errors = 0
        self.send_retries = 0
        self.bus_errors = 0
        self.last_problem = ""
        self.failure = ""
        self.ended = ""
        self.on_failure: Callable[[str], None] | None = None
        self._bus = bus
        self._handlers: dict[int, FrameHandler] = {}
        self._known = frozenset(known_cob_ids)
        self._closed = threading.Event()
        self._newest = -math.inf  # when the last frame with a stamp was on the bus
        # The receiver passes on to canopen what is not for a handler here, so it is the only listener.
        self.network.listeners[:] = [Receiver(self.receive, self.receive_failed)]
        self.network.connect()
        self._forget_failure()

    def subscribe(self, cob_id: int, handler: FrameHandler) -> None:
        """Pass the frames of a COB-ID to `handler`."""
        self._handlers[cob_id] = handler

    def unsubscribe(self, cob_id: int) -> None:
        """Stop passing on the frames of a COB-ID."""
        self._handlers.pop(cob_id, None)

    @property
    def dropped_frames(self) -> int:
        """Received frames that the kernel dropped for lack of room, since the bus was opened."""
        return int(getattr(self._bus, "dropped_frames", 0))

    @property
    def receive_buffer(self) -> int | None:
        """Size of the kernel's receive buffer, bytes; `None` where there is none."""
        size = getattr(self._bus, "receive_buffer", None)
        return None if size is None else int(size)

    def send(self, message: can.Message, deadline: float = -math.inf) -> bool:
        """Put a frame on the bus; return whether that went well. Failures are counted, not raised.

        Parameters
        ----------
        message
            The frame.
        deadline
            Time, s, until which the frame is worth sending: while the interface has no room for it, it is tried again
            until then.
        """
        while True:
            try:
                with self.network.send_lock:
                    self._bus.send(message)
            except can.CanError as error:
                code = getattr(error, "error_code", None)
                if code in _NO_ROOM and self.clock.monotonic() < deadline:
                    self.send_retries += 1
                    self.clock.sleep(_RETRY_INTERVAL)
                    continue
                self.send_errors += 1
                if code in _NO_INTERFACE:
                    self.failure = str(error)
                self.last_problem = f"sending COB-ID 0x{message.arbitration_id:03X}: {error}"
                return False
            self.failure = ""
            return True

    def close(self) -> None:
        """Stop receiving and close the bus."""
        if not self._closed.is_set():
            self._closed.set()
            self.network.disconnect()

    def receive(self, message: can.Message) -> None:
        """Pass a received frame to its handler; called by the receiving thread."""
        identifier = message.arbitration_id
        if message.is_error_frame:
            self.bus_errors += 1
            self.last_problem = error_frame_text(message)
            if is_bus_off(message):
                self._failed(self.last_problem)
            return
        if message.is_remote_frame:
            return
        handler = self._handlers.get(identifier)
        try:
            if handler is not None:
                handler(message.data, self._on_bus(message.timestamp))
            elif identifier in self.network.subscribers:
                self.network.notify(identifier, message.data, message.timestamp)
            elif identifier not in self._known:
                self.unknown_frames += 1
                self.last_problem = f"frame of unknown COB-ID 0x{identifier:03X}"
        except (FrameError, struct.error) as error:  # the latter from canopen, for a frame cut short
            self.malformed_frames += 1
            self.last_problem = f"frame of COB-ID 0x{identifier:03X}: {error}"
        except Exception as error:  # a defect: it is told, and the frames after it are received
            self.bus_errors += 1
            problem = f"frame of COB-ID 0x{identifier:03X}: {type(error).__name__}: {error}"
            if problem != self.last_problem:
                traceback.print_exception(error)
            self.last_problem = problem
            self._failed(problem)

    def receive_failed(self, error: Exception) -> None:
        """Count a failure of the receiving thread, which then goes on."""
        if not self._closed.is_set():
            self.bus_errors += 1
            self.last_problem = f"receiving: {error}"
            self._forget_failure()
            self._failed(str(error))
            # An interface that is down fails again at once.
            self._closed.wait(0.1)

    def _failed(self, problem: str) -> None:
        handler = self.on_failure
        if handler is not None:
            try:
                handler(problem)
            except BaseException as error:
                self.ended = end_text(f"bus {self.name}", error)
                raise

    def _forget_failure(self) -> None:
        """Keep canopen from refusing to send forever after one failure; the next frame may get through."""
        if self.network.notifier is not None:
            self.network.notifier.exception = None

    def _on_bus(self, timestamp: float) -> float:
        then, now = self.clock.moment(timestamp), self.clock.monotonic()
        # Neither a device without its own stamps nor a time of day that was set meanwhile may cause a wrong age: frames
        # were on the bus in the order in which they come, and before they come.
        if now - 1.0 < then < now:
            now = max(then, self._newest)
        self._newest = now
        return now


@dataclass(frozen=True)
class Receiver:
    """What python-can's receiving thread calls with frames, and with errors of the interface."""

    take: Callable[[can.Message], None]
    on_error: Callable[[Exception], None]

    def __call__(self, message: can.Message) -> None:
        """Take a frame."""
        self.take(message)
