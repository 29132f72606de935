"""The heartbeat of whoever leads the drives, on every bus, from a thread of its own."""

from __future__ import annotations

import threading

from cspr_drivers.bus.can_bus import CyclicFrame
from cspr_drivers.bus.can_ports import CanPorts
from cspr_drivers.canopen.frame_table import FunctionCode, cob_id
from cspr_drivers.canopen.nmt import NmtState


class MasterHeartbeat:
    """Heartbeat between `__enter__` and `__exit__`; drives that watch it stop when it ends.

    Parameters
    ----------
    ports
        The buses.
    node_id
        Node id of the master.
    period
        s.
    """

    def __init__(self, ports: CanPorts, node_id: int, period: float) -> None:
        self._ports = ports
        self._frame = CyclicFrame(cob_id(FunctionCode.HEARTBEAT, node_id), bytes([NmtState.OPERATIONAL]))
        self._period = period
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="heartbeat", daemon=True)

    def __enter__(self) -> MasterHeartbeat:
        self._thread.start()
        return self

    def __exit__(self, *_raised: object) -> None:
        self._stopping.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stopping.wait(self._period):
            for port in self._ports:
                port.send(self._frame)
