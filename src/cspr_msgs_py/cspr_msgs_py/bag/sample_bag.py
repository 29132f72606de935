"""Writing records of the graph's topics into a bag, without ROS running."""

from collections.abc import Callable
from typing import Any

from cspr_msgs_py.bag.bag_file import BagFile
from cspr_msgs_py.bag.metadata import OfferedQos, RecordedTopic
from cspr_msgs_py.message_definitions import message_definition, message_type_hash
from cspr_msgs_py.topics import Topic
from cspr_msgs_py.wire.topic_codecs import topic_codec


class SampleBag:
    """Encodes records and writes them as the recorder writes the messages of the live graph.

    Parameters
    ----------
    bag : BagFile
    number_of_motors : int
    definition : callable
        Returns the definition of a message type.
    """

    def __init__(
        self, bag: BagFile, number_of_motors: int, definition: Callable[[str], str] = message_definition
    ) -> None:
        self._bag = bag
        self._number_of_motors = number_of_motors
        self._definition = definition
        self._topics: dict[str, tuple[int, Callable[[Any], bytes]]] = {}
        self.close = bag.close

    def write(self, topic: Topic, time_ns: int, sample: Any) -> None:
        """Write a record, published and received at a time."""
        if topic.name not in self._topics:
            qos = OfferedQos(
                "keep_last",
                topic.depth,
                "reliable" if topic.reliable else "best_effort",
                "transient_local" if topic.latched else "volatile",
            )
            definition, type_hash = self._definition(topic.type), message_type_hash(topic.type)
            recorded = RecordedTopic(topic.name, topic.type, definition, (qos,), type_hash)
            encode = topic_codec(topic, self._number_of_motors).encode
            self._topics[topic.name] = self._bag.add_topic(recorded), encode
        number, encode = self._topics[topic.name]
        self._bag.add_message(number, time_ns, time_ns, encode(sample))
