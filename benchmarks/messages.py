"""Cost of a hot message: the fixed CDR template against message objects and rclpy's serialisation."""

from __future__ import annotations

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time
from sensor_msgs.msg import JointState

from benchmarks.timing import microseconds
from cspr_msgs_py.topics import motor_names
from cspr_msgs_py.wire.joint_state import JointStateCodec


def main() -> None:
    """Print the table."""
    names = motor_names(8)
    codec = JointStateCodec(names)
    values = np.linspace(0.0, 1.0, 8)
    buffer = codec.encode(1, values, values, values)

    def with_objects() -> bytes:
        message = JointState(name=list(names))
        message.header.stamp = Time(nanoseconds=1).to_msg()
        message.position = message.velocity = message.effort = values.tolist()
        buffer: bytes = serialize_message(message)
        return buffer

    rows = [
        ("encode, template", microseconds(lambda: codec.encode(1, values, values, values), 5000)),
        ("encode, JointState objects", microseconds(with_objects, 2000)),
        ("decode, template", microseconds(lambda: codec.decode(buffer), 5000)),
        ("decode, JointState objects", microseconds(lambda: deserialize_message(buffer, JointState), 2000)),
    ]
    print(f"{'/motor_states of 8 motors':50}{'us':>10}{'ratio':>10}")
    for name, time in rows:
        print(f"{name:50}{time:>10.2f}{time / rows[0][1]:>10.2f}")
