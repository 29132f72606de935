"""Stamps of topics that have one publisher each: every message is stamped later than the one before.

One that is not comes from somebody else who publishes there too, and nobody can say which of the two is right. When
the drivers are started again they begin to count anew: the stamps go back once, and the robot is at rest. What a node
publishes itself comes back to it, each message once.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable

from cspr_msgs_py.topics import Topic

_LASTS = 1.0  # s for which a topic stays doubtful
_ON_THE_WAY = 200  # of the messages of one topic that a node has sent and not heard


class StampOrder:
    """Whether stamps repeat or go back; times are monotonic, s, stamps in ns."""

    def __init__(self) -> None:
        self._newest: dict[Topic, tuple[int, Hashable]] = {}
        self._sent: dict[Topic, deque[Hashable]] = {}
        self._broken: dict[Topic, tuple[float, str]] = {}  # when each topic's last was, and what was wrong

    def observe(self, time: float, topic: Topic, stamp_ns: int, content: Hashable = None) -> bool:
        """Note the stamp of a message; return whether it is out of order.

        Where content is given the same message may come again: an estimate that is held.
        """
        newest, before = self._newest.get(topic, (stamp_ns - 1, None))
        repeats = stamp_ns == newest and (content is None or content != before)
        self._newest[topic] = stamp_ns, content
        if broken := repeats or stamp_ns < newest:
            self._broken[topic] = time, f"stamps of {topic.name} repeat or go back"
        return broken

    def sent(self, topic: Topic, content: Hashable) -> None:
        """Note a message that is about to be published."""
        self._sent.setdefault(topic, deque(maxlen=_ON_THE_WAY)).append(content)

    def heard(self, time: float, topic: Topic, content: Hashable) -> bool:
        """Note a message of a topic that this node publishes itself; return whether it is none of its own."""
        own = self._sent.get(topic, deque())
        if content in own:
            own.remove(content)
            return False
        self._broken[topic] = time, f"{topic.name} brings what {topic.writer} has not sent"
        return True

    def problem(self, time: float) -> str:
        """Return which topics have more than one publisher, or an empty text."""
        return "; ".join(
            f"{wrong}: somebody publishes it beside {topic.writer}"
            for topic, (moment, wrong) in self._broken.items()
            if time - moment <= _LASTS
        )
