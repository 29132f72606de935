"""Heartbeat producer and consumer of an emulated device (CiA 301, section 7.2.8.3.2), time as argument."""

from __future__ import annotations


class HeartbeatProducer:
    """When the device's own heartbeat is due.

    Attributes
    ----------
    milliseconds
        Producer heartbeat time (1017h), 0 for none.
    """

    def __init__(self) -> None:
        self.produce(0)

    def produce(self, milliseconds: int) -> None:
        """Start a new period of a heartbeat, 0 for none."""
        self.milliseconds = milliseconds
        self._next = 0.0

    def due(self, time: float) -> bool:
        """Return whether a heartbeat is due at a time, s; it then counts as sent."""
        if not self.milliseconds or time < self._next:
            return False
        # A producer that was held up goes on from now instead of catching up in a burst.
        self._next = max(self._next + self.milliseconds * 1e-3, time)
        return True


class HeartbeatConsumer:
    """Watch over the heartbeat of one other node.

    Attributes
    ----------
    node_id
        Node that is watched, 0 for none.
    milliseconds
        Longest time between two heartbeats.
    """

    def __init__(self) -> None:
        self.node_id = 0
        self.milliseconds = 0
        self._last: float | None = None

    @property
    def value(self) -> int:
        """Consumer heartbeat time (1016h): node id and milliseconds."""
        return self.node_id << 16 | self.milliseconds

    def watch(self, node_id: int, milliseconds: int) -> None:
        """Watch a node from its next heartbeat on; node id or time 0 end the watch."""
        watched = bool(node_id and milliseconds)
        self.node_id = node_id if watched else 0
        self.milliseconds = milliseconds if watched else 0
        self._last = None

    def received(self, time: float) -> None:
        """Take note of a heartbeat at a time, s."""
        self._last = time

    def missing(self, time: float) -> bool:
        """Return whether the heartbeat has failed to come by a time, s."""
        return self._last is not None and time - self._last > self.milliseconds * 1e-3
