"""Executable ``recorder``: writes every topic of the graph, as it went over the wire, to one bag.

The topics of the table are subscribed at once, any other when it appears in the graph. No message is decoded.
"""

import importlib.metadata
import platform
import time
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden

from cspr_msgs_py.bag_file import Attachment, BagFile, Compression
from cspr_msgs_py.bag_metadata import RecordedTopic
from cspr_msgs_py.bag_writer import BagWriter
from cspr_msgs_py.conversions import Level, diagnostic_status
from cspr_msgs_py.errors import MessageError, StartError
from cspr_msgs_py.message_definitions import message_class, message_definition
from cspr_msgs_py.nodes.process import LEAN_NODE, Diagnostics, declare, run_nodes, steady_timer
from cspr_msgs_py.nodes.scheduling import set_niceness
from cspr_msgs_py.qos import qos_profile
from cspr_msgs_py.topics import graph_topics

GRAPH_PERIOD = 0.5  # s between two looks for new topics

_POLL_PERIOD = 0.02  # s

# What may arrive between two polls, and much more: the recorder is niced and may get its turn late.
_DEPTH = 500

_FIXED_TOPICS = {topic.name: topic for topic in graph_topics(0)}


@dataclass
class _Source:
    """A topic that is recorded, and its place in the bag once a message has come."""

    name: str
    type_name: str
    subscription: Subscription
    index: int | None = None


def _never_called(message: bytes) -> None:
    raise AssertionError("the intake's subscriptions are polled, not spun")


class Recorder(Node):
    """Subscribes to every topic and hands its bytes to the bag.

    Parameters
    ----------
    options
        Keyword arguments of :class:`rclpy.node.Node`.

    Raises
    ------
    StartError, BagError
        If a parameter is wrong, the bag exists already or cannot be written.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("recorder", **options)
        # Its subscriptions are polled: to be woken for every message would cost several times more, at the
        # expense of the control loop, than to take what has arrived fifty times a second.
        self._intake = Node("_recorder_intake", **{**LEAN_NODE, **options})
        self._sources: list[_Source] = []
        self._recorded: set[str] = set()
        self._refused: set[str] = set()  # topics that cannot be recorded
        self._failed = False
        self._bag = self._create_bag()
        self._writer = BagWriter(self._bag)
        for topic in _FIXED_TOPICS.values():
            self._record(topic.name, topic.type, qos_profile(topic))
        self._look_for_topics()
        self._recording_timers = (
            steady_timer(self, GRAPH_PERIOD, self._look_for_topics),
            steady_timer(self, _POLL_PERIOD, self._poll),
        )
        self._diagnostics = Diagnostics(self, self._status)
        self.get_logger().info(f"recording to {self._bag.directory}")

    def make_safe(self) -> None:
        """Write what waits and finish the bag."""
        if self._failed:  # said already, when it ended the process
            return
        self._poll()
        self._writer.close()
        total, dropped = sum(self._writer.counts.values()), sum(self._writer.drops.values())
        self.get_logger().info(f"recorded {total} messages, dropped {dropped}, in {self._bag.directory}")

    def _create_bag(self) -> BagFile:
        output = declare(
            self,
            "output",
            "",
            "directory of the bag, which must not exist yet; runs/<UTC time>/bag if empty",
            read_only=True,
        )
        attach = declare(self, "attach", [""], "configuration files to keep inside the bag", read_only=True)
        compression = declare(self, "compression", "zstd", "of the bag: zstd, lz4 or none", read_only=True)
        niceness = declare(
            self, "nice", 5, "nice level of this process", minimum=0, maximum=19, read_only=True
        )
        rate = declare(
            self, "control_rate", 250.0, "noted in the bag", minimum=0.0, unit="Hz", read_only=True
        )
        if compression not in {member.value for member in Compression}:
            raise StartError(f"parameter compression: {compression!r} is none of zstd, lz4, none")
        refusal = set_niceness(niceness)
        if refusal is not None:
            self.get_logger().warning(refusal)
        started = datetime.now(UTC)
        return BagFile(
            output or Path("runs") / started.strftime("%Y%m%dT%H%M%SZ") / "bag",
            _information(started, rate),
            [Attachment.from_file(path) for path in attach if path],
            Compression(compression),
            start_ns=time.time_ns(),
        )

    def _look_for_topics(self) -> None:
        """Subscribe to what has appeared in the graph; end the process if the bag cannot be written."""
        if self._writer.error is not None:
            self._failed = True
            raise self._writer.error
        for name, types in self.get_topic_names_and_types():
            if name in self._recorded or name in self._refused or topic_or_service_is_hidden(name):
                continue
            publishers = self.get_publishers_info_by_topic(name)
            if not publishers:  # nobody says yet with which quality of service
                continue
            if len(types) > 1:
                self.get_logger().warning(f"{name} has several types, only {types[0]} is recorded: {types}")
            try:
                self._record(name, types[0], _compatible([publisher.qos_profile for publisher in publishers]))
            except MessageError as error:
                self._refused.add(name)
                self.get_logger().warning(f"{name} is not recorded: {error}")

    def _record(self, name: str, type_name: str, profile: QoSProfile) -> None:
        profile.depth = max(profile.depth, _DEPTH)
        subscription = self._intake.create_subscription(
            message_class(type_name), name, _never_called, profile, raw=True
        )
        self._sources.append(_Source(name, type_name, subscription))
        self._recorded.add(name)

    def _poll(self) -> None:
        """Hand on what has arrived since the last time."""
        write = self._writer.write
        for source in self._sources:
            subscription = source.subscription
            with subscription.handle:
                while (taken := subscription.handle.take_message(subscription.msg_type, True)) is not None:
                    data, info = taken
                    if source.index is None:
                        source.index = self._writer.add_topic(self._describe(source.name, source.type_name))
                    write(source.index, info["received_timestamp"], info["source_timestamp"], data)

    def destroy_node(self) -> None:
        """Destroy the node and the one that holds its subscriptions."""
        self._intake.destroy_node()
        super().destroy_node()

    def _describe(self, name: str, type_name: str) -> RecordedTopic:
        """Return what the bag says of a topic: what its publishers offer, and what the table knows of it."""
        publishers = self.get_publishers_info_by_topic(name)
        offered = _compatible([publisher.qos_profile for publisher in publishers])
        topic = _FIXED_TOPICS.get(name)
        return RecordedTopic(
            name,
            type_name,
            message_definition(type_name),
            offered.reliability.name.lower(),
            offered.durability.name.lower(),
            topic.depth if topic is not None else 0,
            str(publishers[0].topic_type_hash) if publishers else "",
        )

    def _status(self) -> Iterable[DiagnosticStatus]:
        counts, drops = self._writer.counts, self._writer.drops
        total, dropped = sum(counts.values()), sum(drops.values())
        yield diagnostic_status(
            self.get_name(),
            Level.WARN if drops else Level.OK,
            f"{total} messages of {len(counts)} topics recorded"
            + (f", {dropped} dropped: the disk is too slow" if drops else ""),
            {
                "bag": self._bag.directory,
                "messages": total,
                "dropped": dropped,
                "waiting": self._writer.waiting,
                **{f"messages {name}": number for name, number in counts.items()},
                **{f"dropped {name}": number for name, number in drops.items()},
            },
        )


def _compatible(offered: list[QoSProfile]) -> QoSProfile:
    """Return the strictest profile that every one of the publishers can serve."""
    reliable = all(profile.reliability == ReliabilityPolicy.RELIABLE for profile in offered)
    latched = all(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL for profile in offered)
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _information(started: datetime, control_rate: float) -> dict[str, str]:
    return {
        "software": f"cspr_msgs_py {importlib.metadata.version('cspr_msgs_py')}",
        "python": platform.python_version(),
        "host": platform.node(),
        "kernel": f"{platform.system()} {platform.release()}",
        "control_rate": str(control_rate),
        "start_time": started.isoformat(),
    }


def main() -> int:
    """Run the recorder until SIGINT or SIGTERM."""
    # A priority given to all nodes of the graph is not for this one: the control loop comes first.
    return run_nodes(lambda: [Recorder()], realtime=False)


if __name__ == "__main__":
    raise SystemExit(main())
