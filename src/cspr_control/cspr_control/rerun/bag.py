"""Writing what a re-run gave as a bag: the same inputs give the same bytes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from cspr_control.rerun.rerun import EstimatedPayloads, Setpoints
from cspr_msgs_py import topics
from cspr_msgs_py.bag.bag_file import Attachment, BagFile
from cspr_msgs_py.bag.metadata import OfferedQos, RecordedTopic
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.stamped_doubles import StampedDoublesCodec

_RULE = "=" * 80
_HEADER = f"{_RULE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
_TIME = f"{_RULE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
DEFINITIONS = {
    topics.JOINT_STATE: "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
    f"float64[] effort\n{_HEADER}{_TIME}",
    topics.INERTIA_STAMPED: "std_msgs/Header header\ngeometry_msgs/Inertia inertia\n"
    f"{_HEADER}{_RULE}\nMSG: geometry_msgs/Inertia\nfloat64 m\ngeometry_msgs/Vector3 com\nfloat64 ixx\nfloat64 ixy\n"
    f"float64 ixz\nfloat64 iyy\nfloat64 iyz\nfloat64 izz\n{_TIME}"
    f"{_RULE}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
}
"""Of the written messages: message packages, from which they could be taken, are not there without ROS."""


def write_rerun(
    directory: Path,
    payloads: EstimatedPayloads | None,
    setpoints: Setpoints | None,
    information: Mapping[str, str],
    files: Mapping[str, bytes],
) -> None:
    """Write the re-run topics as a bag.

    Parameters
    ----------
    directory
        Of the bag; must not exist yet.
    payloads, setpoints
        What was re-run.
    information
        What to note in the bag.
    files
        Contents of the configuration files in use, by name.

    Raises
    ------
    cspr_msgs_py.errors.BagError
        If it exists already or cannot be written.
    """
    messages: list[tuple[int, topics.Topic, bytes]] = []
    if payloads is not None:
        inertia = StampedDoublesCodec(topics.PLATFORM_FRAME, 10)
        moments = np.zeros(6)  # a point mass
        messages += [
            (time, topics.PAYLOAD, inertia.encode(stamp, [mass, *center, *moments]))
            for stamp, time, mass, center in zip(
                payloads.time_ns.tolist(),
                payloads.log_time_ns.tolist(),
                payloads.mass,
                payloads.center_of_mass,
                strict=True,
            )
        ]
    if setpoints is not None:
        joints = JointStateCodec(topics.motor_names(setpoints.position.shape[1]))
        messages += [
            (time, topics.SETPOINT, joints.encode(stamp, position, velocity, effort))
            for stamp, time, position, velocity, effort in zip(
                setpoints.time_ns.tolist(),
                setpoints.log_time_ns.tolist(),
                setpoints.position,
                setpoints.velocity,
                setpoints.effort,
                strict=True,
            )
        ]
    messages.sort(key=lambda message: message[0])
    start = messages[0][0] if messages else 0
    attachments = [Attachment(name, data) for name, data in sorted(files.items())]
    bag = BagFile(directory, information, attachments, start_ns=start)
    indices = {
        topic: bag.add_topic(
            RecordedTopic(
                topic.name,
                topic.type,
                DEFINITIONS[topic.type],
                (OfferedQos("keep_last", topic.depth, topic.reliability.value, topic.durability.value),),
            )
        )
        for topic, present in ((topics.PAYLOAD, payloads), (topics.SETPOINT, setpoints))
        if present is not None
    }
    for time, topic, data in messages:
        bag.add_message(indices[topic], time, time, data)
    bag.close()
