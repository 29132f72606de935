"""The codec of each topic of the graph: bytes of a message to a plain record and back, without ROS."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspr_msgs_py import topics
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.topics import Topic
from cspr_msgs_py.wire.cdr import Bytes, Scanner, Writer
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.log import decode_log, encode_log
from cspr_msgs_py.wire.reference import ReferenceCodec
from cspr_msgs_py.wire.samples import InertiaSample, PoseSample, SignOfLife, WrenchSample
from cspr_msgs_py.wire.stamped_doubles import INERTIA, POSE, WRENCH, StampedDoublesCodec
from cspr_msgs_py.wire.status import decode_status, decode_status_array, encode_status, encode_status_array


@dataclass(frozen=True)
class TopicCodec:
    """How one topic's samples become messages and back.

    Attributes
    ----------
    encode
        Returns the message of a sample, as CDR.
    decode
        Returns the sample of a message. Raises MessageError if it is not of the topic's type; also if it has
        another layout than the graph's own nodes give it, where the layout is constant.
    layout
        The codec of constant layout behind it, as `conversion` needs it; None where there is none.
    """

    encode: Callable[[Any], bytes]
    decode: Callable[[Bytes], Any]
    layout: Any = None


def topic_codec(topic: Topic, number_of_motors: int) -> TopicCodec:
    """Return the codec of a topic of a robot with this number of motors.

    Samples are `ReferenceSample`, `JointStateSample` (of one motor's command: `JointSample`), `PoseSample`,
    `InertiaSample`, `WrenchSample`, `SignOfLife`, `Status`, `StatusArray` and `LogLine`.

    Raises
    ------
    MessageError
        If messages of the topic's type have no codec here.
    """
    if topic.type == topics.JOINT_STATE:
        return _joint_state(topic, number_of_motors)
    if topic.type == topics.MULTI_DOF_TRAJECTORY:
        codec = ReferenceCodec()
        return TopicCodec(codec.encode, _checked(topic, codec.decode), codec)
    if topic.type == topics.DIAGNOSTIC_STATUS:
        return TopicCodec(encode_status, _checked(topic, decode_status))
    if topic.type == topics.DIAGNOSTIC_ARRAY:
        return TopicCodec(encode_status_array, _checked(topic, decode_status_array))
    if topic.type == topics.LOG:
        return TopicCodec(encode_log, _checked(topic, decode_log))
    if topic.type == topics.POSE_STAMPED:
        return _stamped_doubles(
            topic,
            StampedDoublesCodec(topics.BASE_FRAME, POSE),
            lambda sample: [*sample.position, *sample.quaternion_xyzw],
            lambda stamp, values: PoseSample(stamp, values[:3], values[3:]),
        )
    if topic.type == topics.INERTIA_STAMPED:
        return _stamped_doubles(
            topic,
            StampedDoublesCodec(topics.PLATFORM_FRAME, INERTIA),
            lambda sample: [sample.mass, *sample.center_of_mass, 0, 0, 0, 0, 0, 0],
            lambda stamp, values: InertiaSample(stamp, float(values[0]), values[1:4]),
        )
    if topic.type == topics.WRENCH_STAMPED:
        return _stamped_doubles(
            topic,
            StampedDoublesCodec(topics.BASE_FRAME, WRENCH),
            lambda sample: [*sample.force, *sample.moment],
            lambda stamp, values: WrenchSample(stamp, values[:3], values[3:]),
        )
    if topic.type == topics.HEADER:
        return TopicCodec(_encode_header, _checked(topic, _decode_header))
    raise MessageError(f"{topic.name}: messages of type {topic.type} have no codec")


def _joint_state(topic: Topic, number_of_motors: int) -> TopicCodec:
    command = re.fullmatch(r"/(motor_\d+)/command", topic.name)
    if command is not None:
        one = JointStateCodec((command[1],), position=False, velocity=False)
        return TopicCodec(one.encode_joint, _checked(topic, one.decode_joint), one)
    if topic == topics.CABLE_TENSIONS:
        codec = JointStateCodec(topics.cable_names(number_of_motors), position=False, velocity=False)
    else:
        codec = JointStateCodec(topics.motor_names(number_of_motors))
    return TopicCodec(codec.encode_sample, _checked(topic, codec.decode), codec)


def _checked(topic: Topic, decode: Callable[[Bytes], Any]) -> Callable[[Bytes], Any]:
    def decode_or_raise(buffer: Bytes) -> Any:
        try:
            sample = decode(buffer)
        except ValueError as error:
            raise MessageError(f"{topic.name}: not a {topic.type}: {error}") from error
        if sample is None:
            raise MessageError(f"{topic.name}: {len(buffer)} bytes have another layout than the topic's")
        return sample

    return decode_or_raise


def _encode_header(sign: SignOfLife) -> bytes:
    writer = Writer()
    writer.time(sign.stamp_ns)
    writer.string("")
    return writer.finish()


def _decode_header(buffer: Bytes) -> SignOfLife:
    scanner = Scanner(buffer)
    sign = SignOfLife(scanner.time())
    scanner.string()
    return sign


def _stamped_doubles(
    topic: Topic,
    layout: StampedDoublesCodec,
    values: Callable[[Any], list[float]],
    sample: Callable[[int, NDArray[np.float64]], Any],
) -> TopicCodec:
    """Return the codec of a header and doubles; the ``frame_id`` of what it decodes may be any."""

    def decode(buffer: Bytes) -> Any:
        scanner = Scanner(buffer)
        stamp = scanner.time()
        scanner.string()
        return sample(stamp, np.array([scanner.double() for _ in range(layout.count)]))

    return TopicCodec(lambda record: layout.encode(record.stamp_ns, values(record)), _checked(topic, decode))
