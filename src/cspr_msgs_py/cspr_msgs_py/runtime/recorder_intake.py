"""The recorder's subscriptions, and what becomes of each message that they bring."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from cspr_msgs_py.message_definitions import message_class
from cspr_msgs_py.runtime.process import LEAN_NODE
from cspr_msgs_py.topics import EVENTS

# What may arrive between two polls, and much more: the recorder is niced and may get its turn late.
_DEPTH = 500


@dataclass(eq=False)
class Source:
    """A topic that is recorded."""

    name: str
    type_name: str
    latched: bool
    subscription: Subscription
    index: int | None = None  # place in the bag once a message has come
    held: tuple[int, int, bytes, int] | None = None  # newest message while paused
    lost: int = 0
    counted: bool = True  # whether the gaps of the sequence numbers say what is lost
    _sequence: int = 0  # of the newest message

    def count(self, sequence: int) -> None:
        """Look for a gap between the numbers that the publisher gave its messages."""
        if sequence > self._sequence + 1 and self._sequence and self.counted:
            self.lost += sequence - self._sequence - 1
        elif sequence <= self._sequence and sequence != 1:  # not a new publisher, but two that take turns
            self.counted, self.lost = False, 0
        self._sequence = sequence


class Intake:
    """Takes what arrives on any number of topics, as it went over the wire.

    The subscriptions are polled: to be woken for every message would cost several times more, at the expense of
    the control loop, than to take what has arrived fifty times a second.

    Parameters
    ----------
    options
        Keyword arguments of :class:`rclpy.node.Node`.
    add_topic : callable
        Called with name and type of a topic when its first message comes; returns its index for `write`.
    write : callable
        Takes index, log time (ns), publish time (ns), bytes and sequence number of a message.
    """

    def __init__(
        self,
        options: dict[str, Any],
        add_topic: Callable[[str, str], int],
        write: Callable[[int, int, int, bytes, int], None],
    ) -> None:
        self.paused = False
        self._node = Node("_recorder_intake", **{**LEAN_NODE, **options})
        self._add_topic = add_topic
        self._write = write
        self._sources: dict[str, Source] = {}

    def __contains__(self, name: str) -> bool:
        return name in self._sources

    def subscribe(self, name: str, type_name: str, profile: QoSProfile, latched: bool) -> None:
        """Record a topic from now on.

        Raises
        ------
        MessageError
            If its type is not installed.
        """
        profile.depth = max(profile.depth, _DEPTH)
        subscription = self._node.create_subscription(
            message_class(type_name), name, _never_called, profile, raw=True
        )
        self._sources[name] = Source(name, type_name, latched, subscription)

    def poll(self) -> None:
        """Hand on what has arrived since the last time."""
        for source in self._sources.values():
            subscription = source.subscription
            take, kind = subscription.handle.take_message, subscription.msg_type
            with subscription.handle:
                while (taken := take(kind, True)) is not None:
                    data, info = taken
                    sequence = info["publication_sequence_number"] or 0
                    source.count(sequence)
                    message = info["received_timestamp"], info["source_timestamp"], data, sequence
                    if self.paused and source.name != EVENTS.name:
                        source.held = message if source.latched else None
                    else:
                        self._hand_on(source, message)

    def pause(self) -> None:
        """Record nothing but events until :meth:`resume`."""
        self.poll()
        self.paused = True

    def resume(self) -> None:
        """Record again, beginning with the states that latched topics took on during the pause."""
        self.poll()
        self.paused = False
        for source in self._sources.values():
            if source.held is not None:
                self._hand_on(source, source.held)
                source.held = None

    @property
    def lost(self) -> Counter[str]:
        """Number of messages that were published and did not arrive, by topic; only topics that lost any.

        Not counted for topics with several publishers, and for messages before the first that arrived.
        """
        return Counter({source.name: source.lost for source in self._sources.values() if source.lost})

    def destroy(self) -> None:
        """Destroy the subscriptions."""
        self._node.destroy_node()

    def _hand_on(self, source: Source, message: tuple[int, int, bytes, int]) -> None:
        if source.index is None:
            source.index = self._add_topic(source.name, source.type_name)
        self._write(source.index, *message)


def _never_called(message: bytes) -> None:
    raise AssertionError("the intake's subscriptions are polled, not spun")
