"""The open buses of a process, shared by all of its drivers: by name, with SYNC on all of them at once."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from functools import partial
from queue import Empty, SimpleQueue

from cspr_drivers.bus.can_bus import CanPort, CyclicFrame
from cspr_drivers.canopen.frame_table import SYNC_COB_ID, FunctionCode, cob_id
from cspr_drivers.cycle.driver_time import DriverTime
from cspr_drivers.errors import BusError, FrameError

SyncHandler = Callable[[float, int], None]


class CanPorts:
    """The open buses of a process, by name.

    The handlers of `on_sync` hear of each SYNC, whether this process sends them or another one does.

    Attributes
    ----------
    clock
        Clock of the machine, which all buses share.
    driver_time
        Turns the stamps of SYNCs that another process sends into those of that process.
    """

    def __init__(self, ports: Iterable[CanPort]) -> None:
        self._ports = {port.name: port for port in ports}
        self._sync_handlers: list[tuple[SyncHandler, threading.Lock]] = []
        self._sync = CyclicFrame(SYNC_COB_ID)
        self._producing = False
        self.driver_time = DriverTime()
        first = next(iter(self._ports.values()))
        self.clock = first.clock
        first.subscribe(SYNC_COB_ID, self._receive_sync)

    def __getitem__(self, name: str) -> CanPort:
        return self._ports[name]

    def __iter__(self) -> Iterator[CanPort]:
        return iter(self._ports.values())

    def on_sync(self, handler: SyncHandler, lock: threading.Lock) -> None:
        """Call `handler` with monotonic time, s, and ROS time, ns, just before each SYNC, with `lock` held.

        All locks are taken before the time is: what a handler would have to wait for must not come between the
        time stamp of a SYNC and the SYNC, for speeds are differences of positions over these times.
        """
        self._sync_handlers.append((handler, lock))

    def off_sync(self, handler: SyncHandler) -> None:
        """Stop calling a handler."""
        self._sync_handlers = [pair for pair in self._sync_handlers if pair[0] != handler]

    def send_sync(self) -> None:
        """Put SYNC on every bus."""
        self._producing = True
        with ExitStack() as locks:
            for _, lock in self._sync_handlers:
                locks.enter_context(lock)
            now, stamp = self.clock.monotonic(), self.clock.system_ns()
            for handler, _ in self._sync_handlers:
                handler(now, stamp)
        for port in self._ports.values():
            port.send(self._sync)

    def _receive_sync(self, data: bytes | bytearray, now: float) -> None:
        if self._producing:
            raise FrameError(f"another device sends SYNC as well ({len(data)} bytes)")
        stamp = self.driver_time.sync(self.clock.system_ns() - int(1e9 * (self.clock.monotonic() - now)))
        for handler, lock in self._sync_handlers:
            with lock:
                handler(now, stamp)

    def require_no_driver(self, node_id: int, wait: float) -> None:
        """Listen for a time, s, whether a driver is active on a bus.

        Raises
        ------
        BusError
            As soon as its heartbeat, as node `node_id`, is seen.
        """
        identifier = cob_id(FunctionCode.HEARTBEAT, node_id)
        heard: SimpleQueue[str] = SimpleQueue()

        def note(bus: str, *_frame: object) -> None:
            heard.put(bus)

        for port in self:
            port.subscribe(identifier, partial(note, port.name))
        try:
            bus = heard.get(timeout=wait)
        except Empty:
            return
        finally:
            for port in self:
                port.unsubscribe(identifier)
        raise BusError(
            f"a driver is active on the CAN bus {bus}: its heartbeat as node {node_id} was seen; stop it first"
        )

    def close(self) -> None:
        """Close all buses."""
        for port in self._ports.values():
            port.close()
