"""Writing what a re-run gave as a bag: the same inputs give the same bytes."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cspr_msgs_py import topics
from cspr_msgs_py.bag.bag_file import Attachment, BagFile
from cspr_msgs_py.bag.columns import Inertias, JointStates
from cspr_msgs_py.bag.sample_bag import SampleBag
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import InertiaSample

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
    samples: list[tuple[int, topics.Topic, InertiaSample | JointStateSample]] = []
    m = 0
    if payloads is not None:
        columns = (payloads.time_ns.tolist(), payloads.mass.tolist(), payloads.center_of_mass)
        samples += [
            (time, topics.PAYLOAD, InertiaSample(*values))
            for time, *values in zip(payloads.log_time_ns.tolist(), *columns, strict=True)
        ]
    if setpoints is not None:
        m = len(setpoints.names)
        fields = (setpoints.time_ns.tolist(), setpoints.position, setpoints.velocity, setpoints.effort)
        samples += [
            (time, topics.SETPOINT, JointStateSample(*values))
            for time, *values in zip(setpoints.log_time_ns.tolist(), *fields, strict=True)
        ]
    samples.sort(key=lambda sample: sample[0])
    start = samples[0][0] if samples else 0
    attachments = [Attachment(name, data) for name, data in sorted(files.items())]
    file = BagFile(directory, information, attachments, start_ns=start)
    bag = SampleBag(file, m, DEFINITIONS.__getitem__)
    for time, topic, sample in samples:
        bag.write(topic, time, sample)
    bag.close()
