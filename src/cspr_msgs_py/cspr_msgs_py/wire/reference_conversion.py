"""Decoding of reference messages from publishers with another layout.

A foreign publisher may give a trajectory in another frame, of several joints or without derivatives. What a
reference needs is deserialised the ordinary way; what is missing or ambiguous is an error, never a guess.
"""

import numpy as np
from geometry_msgs.msg import Vector3
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import MultiDOFJointTrajectory

from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.topics import BASE_FRAME, PLATFORM_FRAME
from cspr_msgs_py.wire.cdr import NANOSECONDS, Bytes
from cspr_msgs_py.wire.reference import ReferenceCodec, ReferenceSample


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
    try:
        message = deserialize_message(bytes(buffer), MultiDOFJointTrajectory)
    except Exception as error:  # rmw reports every malformed frame with its own kind of RuntimeError
        raise MessageError(
            f"{len(buffer)} bytes are not a trajectory_msgs/MultiDOFJointTrajectory: {error}"
        ) from error
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
    transform = point.transforms[joint]
    velocity = point.velocities[joint]
    acceleration = point.accelerations[joint]
    rotation = transform.rotation
    stamp = message.header.stamp
    duration = point.time_from_start
    return ReferenceSample(
        stamp.sec * NANOSECONDS + stamp.nanosec,
        duration.sec + duration.nanosec / NANOSECONDS,
        _vector(transform.translation),
        _read_only(rotation.x, rotation.y, rotation.z, rotation.w),
        _vector(velocity.linear),
        _vector(velocity.angular),
        _vector(acceleration.linear),
        _vector(acceleration.angular),
    )


def _vector(vector: Vector3) -> NDArray[np.float64]:
    return _read_only(vector.x, vector.y, vector.z)


def _read_only(*values: float) -> NDArray[np.float64]:
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array
