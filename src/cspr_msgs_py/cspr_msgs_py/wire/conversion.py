"""Decoding of messages from publishers with another layout than the nodes of this workspace.

Any other ROS 2 publisher may order the joints differently, set a ``frame_id``, leave fields out, or give a trajectory
of several joints. Its messages are deserialised the ordinary way and brought into the order and with the fields that
the codec has; what is missing or ambiguous is an error, never a guess.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import MultiDOFJointTrajectory

from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.topics import BASE_FRAME, JOINT_STATE, MULTI_DOF_TRAJECTORY, PLATFORM_FRAME, Topic
from cspr_msgs_py.wire.cdr import NANOSECONDS, Bytes, whole_time
from cspr_msgs_py.wire.joint_state import FIELDS, JointSample, JointStateCodec, JointStateSample
from cspr_msgs_py.wire.message_values import motion
from cspr_msgs_py.wire.reference import ReferenceCodec, ReferenceSample
from cspr_msgs_py.wire.topic_codecs import topic_codec


def decoder(topic: Topic, number_of_motors: int) -> Callable[[Bytes], Any]:
    """Return what decodes the messages of a topic to its samples (`topic_codec`), in a foreign layout as well."""
    codec = topic_codec(topic, number_of_motors)
    any_layout: Any = _ANY_LAYOUT.get(topic.type)
    return codec.decode if any_layout is None else partial(any_layout, codec.layout)


def decode_joint_state(codec: JointStateCodec, buffer: Bytes) -> JointStateSample:
    """Decode a JointState of any layout into the order and with the fields of `codec`.

    Joints that the codec does not know are left out; so are fields that it does not carry.

    Raises
    ------
    MessageError
        If the bytes are not a JointState, a joint of the codec is missing or named twice, or a field of the
        codec does not have one value for each name.
    """
    sample = codec.decode(buffer)
    if sample is not None:
        return sample
    message = _deserialized(buffer, JointState, "sensor_msgs/JointState")
    names = list(message.name)
    if missing := [name for name in codec.names if name not in names]:
        raise MessageError(f"JointState lacks {', '.join(missing)}; it names {', '.join(names) or 'nothing'}")
    if twice := sorted({name for name in codec.names if names.count(name) > 1}):
        raise MessageError(f"JointState names {', '.join(twice)} more than once")
    order = [names.index(name) for name in codec.names]
    fields = {field: _read_only([]) for field in FIELDS}
    for field in codec.fields:
        values = np.asarray(getattr(message, field), dtype=float)
        if values.shape != (len(names),):
            raise MessageError(
                f"JointState has {len(names)} names but {values.size} values in {field}: one for each name is needed"
            )
        fields[field] = _read_only(values[order])
    return JointStateSample(_time(message.header.stamp), **fields)


def decode_joint(codec: JointStateCodec, buffer: Bytes) -> JointSample:
    """Decode the first joint of `codec` of a JointState of any layout; raises as `decode_joint_state` does."""
    joint = codec.decode_joint(buffer)
    if joint is not None:
        return joint
    stamp_ns, *fields = decode_joint_state(codec, buffer)
    return JointSample(stamp_ns, *(float(f[0]) if f.size else math.nan for f in fields))


def decode_reference(codec: ReferenceCodec, buffer: Bytes) -> ReferenceSample:
    """Decode a reference of any layout.

    Raises
    ------
    MessageError
        If the bytes are not a MultiDOFJointTrajectory, its frame is not ``base``, or it has not exactly one
        point with transform, velocity and acceleration for the joint ``platform``.
    """
    sample = codec.decode(buffer)
    if sample is not None:
        return sample
    message = _deserialized(buffer, MultiDOFJointTrajectory, "trajectory_msgs/MultiDOFJointTrajectory")
    if message.header.frame_id != BASE_FRAME:
        raise MessageError(f"reference is given in frame {message.header.frame_id!r}, not in {BASE_FRAME!r}")
    if PLATFORM_FRAME not in message.joint_names:
        raise MessageError(f"reference has no joint {PLATFORM_FRAME!r}; it names {list(message.joint_names)}")
    if len(message.points) != 1:
        raise MessageError(f"reference has {len(message.points)} points, one is needed")
    joint = message.joint_names.index(PLATFORM_FRAME)
    point = message.points[0]
    for field in ("transforms", "velocities", "accelerations"):
        if len(getattr(point, field)) != len(message.joint_names):
            raise MessageError(
                f"reference has {len(getattr(point, field))} {field} for {len(message.joint_names)} joints"
            )
    return ReferenceSample(
        _time(message.header.stamp),
        _time(point.time_from_start) / NANOSECONDS,
        *map(_read_only, motion(point, joint)),
    )


_ANY_LAYOUT = {JOINT_STATE: decode_joint_state, MULTI_DOF_TRAJECTORY: decode_reference}
"""What decodes messages whose layout is constant in the graph, by their type."""


def _deserialized(buffer: Bytes, kind: type, name: str) -> Any:
    try:
        return deserialize_message(bytes(buffer), kind)
    except Exception as error:  # rmw reports every malformed frame with its own kind of RuntimeError
        raise MessageError(f"{len(buffer)} bytes are not a {name}: {error}") from error


def _time(time: Any) -> int:
    return whole_time(time.sec, time.nanosec)


def _read_only(values: ArrayLike) -> NDArray[np.float64]:
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array
