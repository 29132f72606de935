"""Writing what a re-run gave as a bag: the same inputs give the same bytes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cspr_msgs_py import topics
from cspr_msgs_py.bag.bag_file import Attachment, BagFile
from cspr_msgs_py.bag.metadata import OfferedQos, RecordedTopic
from cspr_msgs_py.bag.reader import Inertias, JointStates
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import InertiaSample
from cspr_msgs_py.wire.topic_codecs import topic_codec

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
    payloads: Inertias | None,
    setpoints: JointStates | None,
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
        encode = topic_codec(topics.PAYLOAD, 0).encode
        columns = (payloads.time_ns.tolist(), payloads.mass.tolist(), payloads.center_of_mass)
        messages += [
            (time, topics.PAYLOAD, encode(InertiaSample(*values)))
            for time, *values in zip(payloads.log_time_ns.tolist(), *columns, strict=True)
        ]
    if setpoints is not None:
        encode = topic_codec(topics.SETPOINT, len(setpoints.names)).encode
        fields = (setpoints.position, setpoints.velocity, setpoints.effort)
        messages += [
            (time, topics.SETPOINT, encode(JointStateSample(*values)))
            for time, *values in zip(
                setpoints.log_time_ns.tolist(), setpoints.time_ns.tolist(), *fields, strict=True
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
