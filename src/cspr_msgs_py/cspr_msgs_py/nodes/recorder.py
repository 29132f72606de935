"""Executable ``recorder``: writes every topic of the graph, as it went over the wire, to one bag.

The topics of the table are subscribed at once, any other when it appears in the graph. No message is decoded.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.topic_or_service_is_hidden import topic_or_service_is_hidden
from std_msgs.msg import String
from std_srvs.srv import Trigger

from cspr_msgs_py.bag.bag_file import LOST, Attachment, BagFile
from cspr_msgs_py.bag.mcap_writer import Compression
from cspr_msgs_py.bag.metadata import RecordedTopic
from cspr_msgs_py.bag.recording_information import recording_information
from cspr_msgs_py.bag.writer import BagWriter
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.message_definitions import message_definition
from cspr_msgs_py.qos import compatible_profile, offered_qos, qos_profile
from cspr_msgs_py.runtime.parameters import declare_all
from cspr_msgs_py.runtime.process import advertise, report_health, run_nodes, sample_publisher, steady_timer
from cspr_msgs_py.runtime.recorder_intake import Intake
from cspr_msgs_py.runtime.scheduling import set_background
from cspr_msgs_py.topics import EVENTS, RECORDER_STATE, graph_topics
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.cdr import NANOSECONDS
from cspr_msgs_py.wire.samples import Status

GRAPH_PERIOD = 0.5  # s between two looks for new topics

_POLL_PERIOD = 0.02  # s
_MEGABYTE = 1_000_000
_MARK_TEXT = "mark_text"

_FIXED_TOPICS = {topic.name: topic for topic in graph_topics(0)}


class Recorder(Node):
    """Subscribes to every topic, or to those selected, and hands the bytes to the bag.

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
        self._refused: set[str] = set()  # topics that cannot be recorded
        self._failed = False
        values = declare_all(self)
        names = values["topics"]
        self._chosen = {self.resolve_topic_name(name) for name in names if name}
        self._recorded = self._chosen and self._chosen | {EVENTS.name}
        refusal = set_background(values["nice"])
        if refusal is not None:
            self.get_logger().warning(refusal)
        self._bag = _create_bag(values)
        self._writer = BagWriter(self._bag)
        self._intake = Intake(
            options, lambda *topic: self._writer.add_topic(self._describe(*topic)), self._writer.write
        )
        self._events = advertise(self, EVENTS)
        self._marks = 0
        for name, topic in _FIXED_TOPICS.items():
            if not self._recorded or name in self._recorded:
                self._intake.subscribe(name, topic.type, qos_profile(topic), topic.latched)
        self._look_for_topics()
        steady_timer(self, GRAPH_PERIOD, self._look_for_topics)
        steady_timer(self, _POLL_PERIOD, self._intake.poll)
        for name, action in (
            ("pause", self._pause),
            ("resume", self._resume),
            ("split", self._split),
            ("mark", self._mark),
        ):
            self.create_service(Trigger, f"~/{name}", _answer(action))
        self._send_state = sample_publisher(self, RECORDER_STATE)
        self._report_health = report_health(self, self._status)
        self._publish_state("recording")
        self.get_logger().info(f"recording to {self._bag.directory}")

    def make_safe(self) -> None:
        """Write what is queued and finish the bag."""
        self._intake.poll()
        lost = self._intake.lost
        self._writer.close({LOST: {name: str(number) for name, number in lost.items()}} if lost else {})
        total, dropped = sum(self._writer.counts.values()), sum(self._writer.drops.values())
        self.get_logger().info(
            f"recorded {total} messages, dropped {dropped}, lost {lost.total()} on their way, "
            f"in {self._bag.directory}"
        )

    def destroy_node(self) -> None:
        """Destroy the node and the one that holds its subscriptions."""
        self._intake.destroy()
        super().destroy_node()

    def _look_for_topics(self) -> None:
        """Subscribe to what has appeared in the graph; say so if the bag cannot be written any more."""
        if self._writer.error is not None and not self._failed:
            self._failed = True
            self.get_logger().fatal(f"{self._writer.error}; what was recorded before is in the bag")
            self._publish_state("failed", Level.ERROR, str(self._writer.error))
            self._report_health()
        for name, types in self.get_topic_names_and_types():
            if name in self._intake or name in self._refused:
                continue
            if name not in self._recorded if self._recorded else topic_or_service_is_hidden(name):
                continue
            offered = [publisher.qos_profile for publisher in self.get_publishers_info_by_topic(name)]
            if not offered:  # its quality of service is not known yet
                continue
            if len(types) > 1:
                self.get_logger().warning(f"{name} has several types, only {types[0]} is recorded: {types}")
            profile = compatible_profile(offered, depth=1)
            latched = profile.durability == profile.durability.TRANSIENT_LOCAL
            try:
                self._intake.subscribe(name, types[0], profile, latched)
            except MessageError as error:
                self._refused.add(name)
                self.get_logger().warning(f"{name} is not recorded: {error}")

    def _describe(self, name: str, type_name: str) -> RecordedTopic:
        """Return what the bag says about a topic: what its publishers offer, and what the table has about it."""
        publishers = self.get_publishers_info_by_topic(name)
        topic = _FIXED_TOPICS.get(name)
        return RecordedTopic(
            name,
            type_name,
            message_definition(type_name),
            tuple(offered_qos(each.qos_profile, topic.depth if topic else 0) for each in publishers),
            str(publishers[0].topic_type_hash) if publishers else "",
        )

    def _pause(self) -> str:
        if self._intake.paused:
            return "the recording is already paused"
        self._note("recording paused")
        self._intake.pause()
        self._publish_state("paused")
        return "the recording is paused"

    def _resume(self) -> str:
        if not self._intake.paused:
            return "the recording is not paused"
        self._intake.resume()
        self._note("recording resumed")
        self._publish_state("recording")
        return "the recording continues"

    def _split(self) -> str:
        self._intake.poll()
        self._writer.split()
        return f"the recording continues in file {self._bag.files} of {self._bag.directory}"

    def _mark(self) -> str:
        self._marks += 1
        text = self.get_parameter(_MARK_TEXT).value
        mark = f"mark {self._marks}"
        self._note(f"{mark}: {text}" if text else mark)
        if text:  # it belongs to one event, not to every later one
            self.set_parameters([Parameter(_MARK_TEXT, value="")])
        return f"{mark} is on {EVENTS.name}"

    def _note(self, text: str) -> None:
        self._events.publish(String(data=text))

    def _publish_state(self, state: str, level: Level = Level.OK, cause: str = "") -> None:
        if self._failed and level is not Level.ERROR:
            return  # which no service undoes
        values = {"bag": self._bag.directory, "cause": cause}
        self._send_state(Status.of(self.get_name(), level, state, values))

    def _status(self) -> Iterable[Status]:
        counts, drops, lost = self._writer.counts, self._writer.drops, self._intake.lost
        total, dropped = sum(counts.values()), sum(drops.values())
        text = f"{total} messages of {len(counts)} topics recorded"
        level = Level.WARN if drops or lost else Level.OK
        if self._intake.paused:
            text += ", paused"
        if drops:
            text += f", {dropped} dropped: the disk is too slow"
        if lost:
            text += f", {lost.total()} lost on the way: the computer is too slow"
        if self._writer.error is not None:
            level, text = Level.ERROR, str(self._writer.error)
        missing = sorted(name for name in self._chosen if name not in counts)
        yield Status.of(
            self.get_name(),
            level,
            text,
            {
                "bag": self._bag.directory,
                "files": self._bag.files,
                "paused": self._intake.paused,
                "messages": total,
                "dropped": dropped,
                "lost": lost.total(),
                "waiting": self._writer.waiting,
                **({"no message yet": " ".join(missing)} if missing else {}),
                **{f"messages {name}": number for name, number in counts.items()},
                **{f"dropped {name}": number for name, number in drops.items()},
                **{f"lost {name}": number for name, number in lost.items()},
            },
        )


def _create_bag(values: Mapping[str, Any]) -> BagFile:
    """Create the bag that the node's parameters ask for."""
    started = datetime.now(UTC)
    attached = [path for path in values["attach"] if path] or sorted(map(str, Path("config").glob("*.yaml")))
    return BagFile(
        values["output"] or Path("runs") / started.strftime("%Y%m%dT%H%M%SZ") / "bag",
        recording_information(started, values["control_rate"]),
        [Attachment.from_file(path) for path in attached],
        Compression(values["compression"]),
        start_ns=time.time_ns(),
        split_size=round(values["split_size"] * _MEGABYTE),
        split_duration=round(values["split_duration"] * NANOSECONDS),
    )


def _answer(action: Callable[[], str]) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    def answer(request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = True, action()
        return response

    return answer


def main() -> int:
    """Run the recorder until SIGINT or SIGTERM."""
    # A priority given to all nodes of the graph is not for this one: the control loop comes first.
    return run_nodes(lambda: [Recorder()], realtime=False)


if __name__ == "__main__":
    raise SystemExit(main())
