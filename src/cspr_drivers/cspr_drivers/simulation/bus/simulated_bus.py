"""A bus in simulated time: driver and devices at its ends, and frames that take as long as on a real bus."""

from __future__ import annotations

import threading
from collections.abc import Callable

import can
import canopen

from cspr_drivers.bus.can_bus import CanPort
from cspr_drivers.bus.virtual_bus import copied_frame
from cspr_drivers.canopen.frame_table import SYNC_COB_ID
from cspr_drivers.clock import Clock
from cspr_drivers.simulation.bus.bus_timing import DRIVER, BusTiming


class SimulatedBus:
    """The devices' end of a bus whose frames pass when `deal` is called.

    Parameters
    ----------
    name
        Name in the configuration.
    bitrate
        bit/s.
    clock
        Simulated time.
    on_sync
        Called with the devices' network as a SYNC is through, in place of the network.

    Attributes
    ----------
    network
        The canopen network of the devices.
    timing
        The frames on the bus.
    disturbed
        What frames with an identifier go through on their way, None for nothing.
    driver_listens
        Whether the driver takes frames: a process that was stopped does not.
    """

    channel_info = "simulated time"

    def __init__(
        self, name: str, bitrate: int, clock: Clock, on_sync: Callable[[canopen.Network], None]
    ) -> None:
        self.timing = BusTiming(bitrate)
        self.network = canopen.Network(self)
        self.disturbed: dict[int, Callable[[bytes], bytes | None]] = {}
        self.driver_listens = True
        self.next_end = self.timing.next_end
        self._name = name
        self._clock = clock
        self._on_sync = on_sync
        self._end: _DriverEnd | None = None
        self._port: CanPort | None = None

    def open(self) -> CanPort:
        """Open the driver's end."""
        self._end = _DriverEnd(self._send_from)
        self._port = CanPort(self._name, self._end, clock=self._clock)
        return self._port

    def cut_off(self) -> None:
        """Let the driver's end send nothing more: frames of a process that was killed are those of before."""
        self._end = None

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        """Put a frame of a device on the bus."""
        self.timing.offer(copied_frame(message), "devices", self._clock.monotonic())

    def deal(self, now: float) -> None:
        """Give the frames that are through at a monotonic time, s, to whom they are for."""
        for _, sender, frame in self.timing.passed(now):
            frame.timestamp = self._clock.time_of_day()
            if frame.arbitration_id in self.disturbed:
                data = self.disturbed[frame.arbitration_id](bytes(frame.data))
                if data is None:
                    continue
                frame.data = bytearray(data)
            if sender != DRIVER:
                if self.driver_listens and self._port is not None:
                    self._port.receive(frame)
            elif frame.arbitration_id == SYNC_COB_ID:
                self._on_sync(self.network)
            else:
                for hear in self.network.subscribers.get(frame.arbitration_id, ()):
                    hear(frame.arbitration_id, frame.data, frame.timestamp)

    def _send_from(self, end: _DriverEnd, message: can.Message) -> None:
        if end is self._end:
            self.timing.offer(copied_frame(message), DRIVER, self._clock.monotonic())


class _DriverEnd(can.BusABC):  # type: ignore[misc]  # python-can's classes count as untyped
    """The driver's end of a bus; what it receives comes another way."""

    def __init__(self, send: Callable[[_DriverEnd, can.Message], None]) -> None:
        super().__init__(channel=None)
        self._send = send
        self._closed = threading.Event()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._send(self, msg)

    def _recv_internal(self, timeout: float | None) -> tuple[None, bool]:
        self._closed.wait(timeout)
        return None, True

    def shutdown(self) -> None:
        self._closed.set()
        super().shutdown()
