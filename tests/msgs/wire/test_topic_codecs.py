"""The codecs of the graph's topics, against rclpy's serialisation."""

from __future__ import annotations

import numpy as np
import pytest
from rcl_interfaces.msg import Log
from rclpy.serialization import deserialize_message, serialize_message
from tests.messages import diagnostic_array, diagnostic_status, inertia_stamped, pose_stamped

from cspr_msgs_py import topics
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.message_definitions import message_class
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.joint_state import JointSample, JointStateCodec, JointStateSample
from cspr_msgs_py.wire.samples import InertiaSample, LogLine, PoseSample, Status, StatusArray
from cspr_msgs_py.wire.topic_codecs import topic_codec

STAMP = 1_700_000_000_123_456_789
POSITION, QUATERNION = np.array([0.1, -0.2, 1.5]), np.array([0.0, 0.6, 0.0, 0.8])
STATUS = Status("läufer", Level.WARN, "held", {"a": "1", "cause": "", "abc": "x y"}, "can0")
EMPTY = Status("", Level.OK, "")


def status_message(status):
    return diagnostic_status(*status[:4], status.hardware_id)


CASES = [
    (
        topics.PLATFORM_POSE,
        PoseSample(STAMP, POSITION, QUATERNION),
        pose_stamped(STAMP, POSITION, QUATERNION),
    ),
    (topics.PAYLOAD, InertiaSample(STAMP, 12.5, POSITION), inertia_stamped(STAMP, 12.5, POSITION)),
    (topics.ROBOT_STATE, STATUS, status_message(STATUS)),
    (topics.TRAJECTORY_STATE, EMPTY, status_message(EMPTY)),
    (topics.DIAGNOSTICS, StatusArray(STAMP, ()), diagnostic_array(STAMP, [])),
    (
        topics.DRIVE_STATES,
        StatusArray(STAMP, (STATUS, EMPTY, STATUS)),
        diagnostic_array(STAMP, map(status_message, (STATUS, EMPTY, STATUS))),
    ),
    (
        topics.ROSOUT,
        LogLine(STAMP, Level.WARN, "läufer", "held"),
        Log(
            stamp=pose_stamped(STAMP, POSITION, QUATERNION).header.stamp, level=30, name="läufer", msg="held"
        ),
    ),
]


@pytest.mark.parametrize(("topic", "sample", "message"), CASES, ids=lambda case: getattr(case, "name", ""))
def test_messages_are_those_of_rclpy(topic, sample, message):
    codec = topic_codec(topic, 8)
    assert deserialize_message(codec.encode(sample), message_class(topic.type)) == message
    assert len(codec.encode(sample)) == len(serialize_message(message))
    decoded = codec.decode(bytes(serialize_message(message)))
    assert type(decoded) is type(sample)
    for ours, theirs in zip(decoded, sample, strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(
    "topic",
    [topics.ROBOT_STATE, topics.DRIVE_STATES, topics.ROSOUT, topics.PLATFORM_POSE, topics.PAYLOAD],
    ids=lambda t: t.name,
)
def test_what_is_no_message_is_refused(topic):
    codec = topic_codec(topic, 8)
    cut_off = bytes(serialize_message(message_class(topic.type)()))[:-1]
    for data in (b"", b"no message at all", b"\x00\x01\x00\x00\x01", cut_off):
        with pytest.raises(MessageError):
            codec.decode(data)


def test_joint_states_of_the_topics():
    values = np.linspace(0.0, 1.0, 8)
    for topic, names, fields in (
        (topics.MOTOR_STATES, topics.motor_names(8), (values, values + 1.0, values + 2.0)),
        (topics.SETPOINT, topics.motor_names(8), (values, values + 1.0, values + 2.0)),
        (topics.CABLE_TENSIONS, topics.cable_names(8), (np.empty(0), np.empty(0), values)),
    ):
        codec = topic_codec(topic, 8)
        layout = JointStateCodec(names, position=fields[0].size > 0, velocity=fields[1].size > 0)
        given = dict(zip(layout.fields, fields[-len(layout.fields) :], strict=True))
        data = codec.encode(JointStateSample(STAMP, *fields))
        assert data == layout.encode(STAMP, **given)
        for ours, theirs in zip(codec.decode(data), (STAMP, *fields), strict=True):
            np.testing.assert_array_equal(ours, theirs)
        with pytest.raises(MessageError, match=topic.name):
            codec.decode(data[:-1])
    command = topic_codec(topics.motor_command(3), 8)
    sample = JointSample(STAMP, float("nan"), float("nan"), -0.75)
    layout = JointStateCodec(("motor_3",), position=False, velocity=False)
    assert command.encode(sample) == layout.encode(STAMP, effort=[-0.75])
    assert command.decode(command.encode(sample))[::3] == (STAMP, -0.75)
    with pytest.raises(ValueError, match="8 names"):
        JointStateCodec(topics.motor_names(8)).encode_joint(sample)


def test_a_topic_without_a_codec_is_refused_by_name():
    with pytest.raises(MessageError, match="/robot_markers"):
        topic_codec(topics.ROBOT_MARKERS, 8)
