"""Open buses that the drivers of one process share: opened by the first of them, closed after the last."""

from __future__ import annotations

import threading

from cspr_drivers.bus.can_ports import CanPorts, SyncHandler
from cspr_drivers.bus.opening import open_ports
from cspr_drivers.clock import COMPUTER, Clock
from cspr_drivers.config.can_config import CanConfig


class SharedPorts:
    """The buses of a configuration, open while somebody uses them.

    Parameters
    ----------
    config
        Buses.
    clock
        Clock of the machine.
    on_sync
        Called as a handler of `CanPorts.on_sync` whenever the buses are open.
    """

    def __init__(
        self, config: CanConfig, clock: Clock = COMPUTER, on_sync: SyncHandler | None = None
    ) -> None:
        self._config = config
        self._on_sync = on_sync
        self._ports: CanPorts | None = None
        self._clock = clock
        self._users = 0

    def acquire(self) -> CanPorts:
        """Return the open buses; `release` gives them back.

        Raises
        ------
        BusError
            If one cannot be opened.
        """
        if self._ports is None:
            self._ports = open_ports(self._config, self._clock)
            if self._on_sync is not None:
                self._ports.on_sync(self._on_sync, threading.Lock())
        self._users += 1
        return self._ports

    def release(self) -> None:
        """Give the buses back."""
        self._users -= 1
        if self._users == 0 and self._ports is not None:
            self._ports.close()
            self._ports = None
