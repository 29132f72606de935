"""A bag of a run in simulated time, like the recorder's of a live one: same topics, bytes and definitions."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cspr_control.closed_loop.loop import ClosedLoop
from cspr_control.closed_loop.scenario import Scenario
from cspr_msgs_py.bag.bag_file import BagFile
from cspr_msgs_py.bag.metadata import OfferedQos, RecordedTopic
from cspr_msgs_py.bag.recording_information import recording_information
from cspr_msgs_py.message_definitions import message_definition
from cspr_msgs_py.topics import Topic
from cspr_msgs_py.wire.topic_codecs import TopicCodec, topic_codec


class LoopBag:
    """Writes what is published in a closed loop; a context manager, at whose end the bag is complete.

    The bag bears simulated time, and the same run gives the same bytes.

    Parameters
    ----------
    directory
        The bag, which must not exist yet.
    scenario
        The run; its configuration travels in the bag as it was used.
    loop
        The closed loop.

    Raises
    ------
    BagError
        If the bag exists already or cannot be written.
    """

    def __init__(self, directory: Path, scenario: Scenario, loop: ClosedLoop[Any]) -> None:
        self._time = loop.time
        self._m = loop.robot.number_of_cables
        self._topics: dict[str, tuple[int, TopicCodec]] = {}
        start = loop.time.system_ns()
        started = datetime.fromtimestamp(start * 1e-9, UTC)
        self._bag = BagFile(
            directory,
            recording_information(started, 1.0 / loop.settings.period) | {"simulated": scenario.label},
            scenario.attachments(),
            start_ns=start,
        )
        loop.listeners.append(self._write)

    def __enter__(self) -> LoopBag:
        return self

    def __exit__(self, *error: object) -> None:
        self._bag.close()

    def _write(self, topic: Topic, sample: Any) -> None:
        known = self._topics.get(topic.name)
        if known is None:
            qos = OfferedQos("keep_last", topic.depth, topic.reliability.value, topic.durability.value)
            recorded = RecordedTopic(topic.name, topic.type, message_definition(topic.type), (qos,))
            known = self._bag.add_topic(recorded), topic_codec(topic, self._m)
            self._topics[topic.name] = known
        number, codec = known
        now = self._time.system_ns()
        self._bag.add_message(number, now, now, codec.encode(sample))
