"""ROS time as the driver of the drives counts it, in the process of another driver that hears the same SYNCs.

Each process begins to count with the time of day at its own start, which may have been set or slewed since.
"""

from __future__ import annotations

from collections import deque

_WINDOW = 250  # stamps of the driver: how soon another driver, with another time, is followed


class DriverTime:
    """What has to be added to the own stamp of a SYNC, ns, to have that of the driver.

    The driver's stamp is heard after the SYNC, sometimes only after the next one, and never before: of many differences
    the largest is that of one and the same SYNC.
    """

    def __init__(self) -> None:
        self.difference_ns = 0
        self._newest_ns: int | None = None
        self._differences: deque[int] = deque(maxlen=_WINDOW)

    def sync(self, stamp_ns: int) -> int:
        """Return the driver's stamp of a SYNC that has the stamp `stamp_ns` here."""
        self._newest_ns = stamp_ns
        return stamp_ns + self.difference_ns

    def heard(self, stamp_ns: int) -> None:
        """Note a stamp of the driver."""
        if self._newest_ns is not None:
            self._differences.append(stamp_ns - self._newest_ns)
            self.difference_ns = max(self._differences)
