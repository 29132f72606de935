"""Fixtures for the message tests: the middleware, and bags with known content."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor

from cspr_msgs_py.bag.bag_file import Attachment, BagFile
from cspr_msgs_py.bag.metadata import OfferedQos, RecordedTopic
from cspr_msgs_py.message_definitions import message_definition
from cspr_msgs_py.topics import MOTOR_STATES, PLATFORM_POSE, REFERENCE, Topic, motor_names
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.reference import VECTORS, ReferenceCodec, ReferenceSample


@pytest.fixture
def context() -> Iterator[Context]:
    context = Context()
    rclpy.init(args=[], context=context)
    yield context
    context.try_shutdown()


@pytest.fixture
def executor(context: Context) -> Iterator[EventsExecutor]:
    executor = EventsExecutor(context=context)
    yield executor
    for node in executor.get_nodes():
        executor.remove_node(node)
        node.destroy_node()
    executor.shutdown()


def recorded(topic: Topic) -> RecordedTopic:
    return RecordedTopic(
        topic.name,
        topic.type,
        message_definition(topic.type),
        (
            OfferedQos(
                "keep_last",
                topic.depth,
                "reliable" if topic.reliable else "best_effort",
                "transient_local" if topic.latched else "volatile",
            ),
        ),
    )


class Recording:
    """A recording with known content: one state a cycle of 4 ms, a reference every tenth, a silent topic."""

    number = 2000
    start = 1_700_000_000_000_000_000
    codec = JointStateCodec(motor_names(8))

    def __init__(self, directory: Path) -> None:
        self.directory = directory

    def state(self, index: int) -> bytes:
        motors = np.arange(8.0)
        return self.codec.encode(self.start + index, index + motors, 2.0 * motors, -motors)

    def reference(self, index: int) -> ReferenceSample:
        rng = np.random.default_rng(index)
        vectors = (rng.normal(size=size) for size in VECTORS.values())
        return ReferenceSample(self.start + index, index * 0.004, *vectors)

    def write(self, name: str = "bag", close: bool = True, split: bool = False) -> Path:
        """Write it as a bag of several chunks; unless it is closed, leave it as a power failure would.

        Split, it has three files.
        """
        bag = BagFile(
            self.directory / name, {"host": "here"}, [Attachment("config/robot.yaml", b"name: x\n")]
        )
        states, references, _ = (
            bag.add_topic(recorded(topic)) for topic in (MOTOR_STATES, REFERENCE, PLATFORM_POSE)
        )
        reference_codec = ReferenceCodec()
        for index in range(self.number):
            time_ns = self.start + index * 4_000_000
            bag.add_message(states, time_ns, time_ns, self.state(index))
            if index % 10 == 0:
                bag.add_message(references, time_ns, time_ns, reference_codec.encode(self.reference(index)))
            if index % 250 == 249:
                bag.sync()
            if split and index in (700, 1400):
                bag.split()
        if close:
            bag.close()
        else:
            bag.abandon()
        return bag.directory


@pytest.fixture
def recording(tmp_path: Path) -> Recording:
    return Recording(tmp_path)
