"""The bus master's heartbeat, on every bus, from a thread of its own."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

from cspr_drivers.bus.can_bus import CyclicFrame
from cspr_drivers.bus.can_ports import CanPorts
from cspr_drivers.canopen.frame_table import FunctionCode, cob_id
from cspr_drivers.canopen.nmt import NmtState


@contextmanager
def master_heartbeat(ports: CanPorts, node_id: int, period: float) -> Iterator[None]:
    """Send the heartbeat of a node on all buses, once a period, s; drives that watch it stop when the context ends."""
    frame = CyclicFrame(cob_id(FunctionCode.HEARTBEAT, node_id), bytes([NmtState.OPERATIONAL]))
    stopping = threading.Event()

    def send() -> None:
        while not stopping.wait(period):
            for port in ports:
                port.send(frame)

    thread = threading.Thread(target=send, name="heartbeat", daemon=True)
    thread.start()
    try:
        yield
    finally:
        stopping.set()
        thread.join()
