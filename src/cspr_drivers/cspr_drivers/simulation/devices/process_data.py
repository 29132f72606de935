"""Received and transmitted PDOs of an emulated device at run time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from cspr_drivers.bus.can_bus import CyclicFrame
from cspr_drivers.simulation.devices.pdo_configuration import ActivePdo


@dataclass
class ReceivePdo:
    """A PDO that the master sends.

    Parameters
    ----------
    pdo
        Its parameters.
    writers
        One for each of its objects, in their order.
    """

    pdo: ActivePdo
    writers: tuple[Callable[[int], None], ...]
    _last_time: float | None = field(default=None, init=False)

    def receive(self, data: bytearray, time: float) -> tuple[int, ...]:
        """Take a frame at a time, s; return its values.

        Raises
        ------
        FrameError
            If the frame does not have the length of the mapped objects.
        """
        values = self.pdo.layout.decode(data)
        self._last_time = time
        return values

    def overdue(self, time: float) -> bool:
        """Return, once, whether the frame has failed to come within its event timer by a time, s."""
        timer = self.pdo.event_timer
        if not timer or self._last_time is None or time - self._last_time <= timer:
            return False
        self._last_time = None  # watched again from the next frame on
        return True


class TransmitPdo:
    """A PDO that the device sends.

    Parameters
    ----------
    pdo
        Its parameters.
    readers
        One for each of its objects, in their order.
    """

    def __init__(self, pdo: ActivePdo, readers: tuple[Callable[[], int], ...]) -> None:
        self.synchronous = pdo.synchronous
        self._layout = pdo.layout
        self._event_timer = pdo.event_timer
        self._readers = readers
        # One message object serves every transmission: buses copy or serialise it before `send` returns.
        self._message = CyclicFrame(pdo.cob_id)
        self._last_time = 0.0
        self._last_data = b""

    def on_sync(self) -> CyclicFrame:
        """Return the frame that a SYNC asks for."""
        return self._frame(self._data())

    def on_event(self, time: float) -> CyclicFrame | None:
        """Return the frame to send at a time, s, because a value has changed or the event timer ran out."""
        data = self._data()
        if data == self._last_data and not (
            self._event_timer and time - self._last_time >= self._event_timer
        ):
            return None
        self._last_time = time
        self._last_data = data
        return self._frame(data)

    def _data(self) -> bytes:
        return self._layout.encode(*[reader() for reader in self._readers])

    def _frame(self, data: bytes) -> CyclicFrame:
        self._message.assign(data)
        return self._message
