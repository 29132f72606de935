"""Decoding of JointState messages from publishers with another layout.

:class:`cspr_msgs_py.wire.joint_state.JointStateCodec` reads the layout that the nodes of this workspace write.
Any other ROS 2 publisher may order the joints differently, set a ``frame_id`` or leave fields out: its
messages are deserialised the ordinary way and brought into the order that the codec has.
"""

import math

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState

from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.wire.cdr import NANOSECONDS, Bytes
from cspr_msgs_py.wire.joint_state import FIELDS, JointSample, JointStateCodec, JointStateSample


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
    try:
        message = deserialize_message(bytes(buffer), JointState)
    except Exception as error:  # rmw reports every malformed frame with its own kind of RuntimeError
        raise MessageError(f"{len(buffer)} bytes are not a sensor_msgs/JointState: {error}") from error
    names = list(message.name)
    if missing := [name for name in codec.names if name not in names]:
        raise MessageError(f"JointState lacks {', '.join(missing)}; it names {', '.join(names) or 'nothing'}")
    if twice := sorted({name for name in codec.names if names.count(name) > 1}):
        raise MessageError(f"JointState names {', '.join(twice)} more than once")
    order = [names.index(name) for name in codec.names]
    fields = {field: _empty() for field in FIELDS}
    for field in codec.fields:
        values = np.asarray(getattr(message, field), dtype=float)
        if values.shape != (len(names),):
            raise MessageError(
                f"JointState has {len(names)} names but {values.size} values in {field}: one for each name is needed"
            )
        fields[field] = values[order]
        fields[field].flags.writeable = False
    stamp = message.header.stamp
    return JointStateSample(stamp.sec * NANOSECONDS + stamp.nanosec, **fields)


def decode_joint(codec: JointStateCodec, buffer: Bytes, index: int) -> JointSample:
    """Decode one joint, by its index in `codec`, of a JointState of any layout.

    Raises
    ------
    MessageError
        As `decode_joint_state`.
    """
    joint = codec.decode_joint(buffer, index)
    if joint is not None:
        return joint
    sample = decode_joint_state(codec, buffer)
    fields = (sample.position, sample.velocity, sample.effort)
    return JointSample(sample.stamp_ns, *(float(f[index]) if f.size else math.nan for f in fields))


def _empty() -> NDArray[np.float64]:
    array = np.empty(0)
    array.flags.writeable = False
    return array
