"""ROS time as the driver of the drives counts it, in the process of another driver that hears the same SYNCs.

Each process begins to count with the time of day at its own start, which may have been set or slewed since.
"""

from __future__ import annotations

_SILENCE = 1_000_000_000  # ns, of a driver that is started again, at least


class DriverTime:
    """What has to be added to the own stamp of a SYNC, ns, to have that of the driver.

    That is the same for as long as both run. The driver's stamp is heard after the SYNC, sometimes only after the next
    one, and never before: of all differences the largest is that of one and the same SYNC.
    """

    def __init__(self) -> None:
        self.difference_ns = 0
        self._own_ns: int | None = None
        self._heard_ns: int | None = None

    def sync(self, stamp_ns: int) -> int:
        """Return the driver's stamp of a SYNC that has the stamp `stamp_ns` here."""
        self._own_ns = stamp_ns
        return stamp_ns + self.difference_ns

    def heard(self, stamp_ns: int) -> None:
        """Note a stamp of the driver."""
        if self._own_ns is None:
            return
        difference = stamp_ns - self._own_ns
        before, self._heard_ns = self._heard_ns, stamp_ns
        same_driver = before is not None and 0 <= stamp_ns - before < _SILENCE
        self.difference_ns = max(difference, self.difference_ns) if same_driver else difference
