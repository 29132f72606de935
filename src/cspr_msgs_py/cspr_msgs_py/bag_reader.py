"""Reads bags into numpy arrays: whole bags, and those that a power failure cut off.

::

    with Bag("runs/latest/bag") as bag:
        states = bag.joint_states("/motor_states")
        speed = states.velocity[:, 0]  # of motor 1

A topic whose messages all have one layout, as those of the control loop have, becomes columns without any
message being decoded on its own.
"""

import os
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
import yaml
from numpy.typing import NDArray

from cspr_msgs_py.bag_metadata import METADATA_FILE
from cspr_msgs_py.cdr import NANOSECONDS
from cspr_msgs_py.errors import BagError
from cspr_msgs_py.joint_state import FIELDS, JointStateCodec
from cspr_msgs_py.mcap_file import McapFile
from cspr_msgs_py.reference import ReferenceCodec
from cspr_msgs_py.stamped_doubles import StampedDoublesCodec
from cspr_msgs_py.topics import INERTIA_STAMPED, JOINT_STATE, MULTI_DOF_TRAJECTORY, POSE_STAMPED, REFERENCE

Floats = NDArray[np.float64]
Times = NDArray[np.int64]


class BagWarning(UserWarning):
    """A bag can be read, but not all of it is there."""


@dataclass(frozen=True)
class JointStates:
    """All messages of a JointState topic: n messages of m joints.

    Attributes
    ----------
    names : tuple of str
    time_ns, log_time_ns : ndarray, shape (n,)
        Stamp in the message, and when the recorder received it.
    position, velocity, effort : ndarray, shape (n, m)
        Of shape (n, 0) where the messages do not carry the field.
    """

    names: tuple[str, ...]
    time_ns: Times
    log_time_ns: Times
    position: Floats
    velocity: Floats
    effort: Floats


@dataclass(frozen=True)
class References:
    """All messages of the reference topic; vectors in base.

    Attributes
    ----------
    time_ns, log_time_ns : ndarray, shape (n,)
        Stamp in the message, and when the recorder received it.
    time_from_start : ndarray, shape (n,)
        Seconds since the trajectory began.
    position, linear_velocity, angular_velocity, linear_acceleration, angular_acceleration : ndarray, shape
    (n, 3) quaternion_xyzw : ndarray, shape (n, 4)
    """

    time_ns: Times
    log_time_ns: Times
    time_from_start: Floats
    position: Floats
    quaternion_xyzw: Floats
    linear_velocity: Floats
    angular_velocity: Floats
    linear_acceleration: Floats
    angular_acceleration: Floats


@dataclass(frozen=True)
class Poses:
    """All messages of a PoseStamped topic: stamps (n,), position (n, 3), quaternion_xyzw (n, 4)."""

    time_ns: Times
    log_time_ns: Times
    position: Floats
    quaternion_xyzw: Floats


@dataclass(frozen=True)
class Inertias:
    """All messages of an InertiaStamped topic: stamps (n,), mass (n,), center_of_mass (n, 3)."""

    time_ns: Times
    log_time_ns: Times
    mass: Floats
    center_of_mass: Floats


class Bag:
    """A bag open for reading.

    Parameters
    ----------
    path : path
        Directory of a bag, or one of its ``.mcap`` files.

    Raises
    ------
    BagError
        If there is no bag, or nothing in it can be read. A bag that was cut off only gives a
        :class:`BagWarning`.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        self._files: list[McapFile] = []
        try:
            for file in _files(self.path):
                self._files.append(McapFile(file))
        except BagError:
            self.close()
            raise
        for opened in self._files:
            if opened.damage is not None:
                warnings.warn(opened.damage, BagWarning, stacklevel=2)

    def __enter__(self) -> "Bag":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        for file in self._files:
            file.close()

    @property
    def complete(self) -> bool:
        """Whether the recording was finished properly."""
        return all(file.damage is None for file in self._files)

    @property
    def topics(self) -> dict[str, str]:
        """Message type of each topic."""
        return {
            channel.topic: file.schemas[channel.schema_id].name
            for file in self._files
            for channel in file.channels.values()
        }

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages of each topic."""
        counts = Counter(dict.fromkeys(self.topics, 0))
        for file in self._files:
            for channel, number in file.counts.items():
                counts[file.channels[channel].topic] += number
        return dict(counts)

    @property
    def attachments(self) -> dict[str, bytes]:
        """The files inside the bag by name, such as the configuration that was in use."""
        return {name: data for file in self._files for name, data in file.attachments.items()}

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata records by name; ``recording`` says how the bag was made."""
        return {name: record for file in self._files for name, record in file.metadata.items()}

    def messages(self, topic: str) -> Iterator[tuple[int, int, bytes]]:
        """Yield log time (ns), publish time (ns) and CDR bytes of each message, in recorded order.

        Raises
        ------
        BagError
            If the bag does not have the topic, or a chunk is damaged.
        """
        self._require(topic)
        for file in self._files:
            channels = {channel.id for channel in file.channels.values() if channel.topic == topic}
            yield from file.messages(channels)

    def joint_states(self, topic: str) -> JointStates:
        """Return a JointState topic as columns.

        The joints stand in the order of the first message; messages of another layout are brought into it.

        Raises
        ------
        BagError
            If the bag does not have the topic or no message of it, the topic has another type, or a message
            does not carry the joints and fields of the first.
        """
        log_times, messages = self._collect(topic, JOINT_STATE)
        try:
            codec = JointStateCodec.of(messages[0])
            frames = [data if codec.matches(data) else _reordered(codec, data) for data in messages]
        except ValueError as error:
            raise BagError(f"{self.path}: a message on {topic} cannot be read: {error}") from error
        columns = np.frombuffer(b"".join(frames), codec.dtype)
        nothing = np.empty((len(frames), 0))
        fields = {name: columns[name].copy() if name in codec.fields else nothing for name in FIELDS}
        return JointStates(codec.names, _stamps(columns), log_times, **fields)

    def references(self, topic: str = REFERENCE.name) -> References:
        """Return the reference as columns.

        Raises
        ------
        BagError
            As in :meth:`joint_states`; also if a message has not the layout of
            :class:`cspr_msgs_py.reference.ReferenceCodec`.
        """
        log_times, messages = self._collect(topic, MULTI_DOF_TRAJECTORY)
        codec = ReferenceCodec()
        columns = self._columns(topic, messages, codec)
        seconds = columns["duration_seconds"].astype(np.int64)
        return References(
            _stamps(columns),
            log_times,
            seconds + columns["duration_nanoseconds"] / NANOSECONDS,
            columns["pose"][:, :3].copy(),
            columns["pose"][:, 3:].copy(),
            columns["twist"][:, :3].copy(),
            columns["twist"][:, 3:].copy(),
            columns["acceleration"][:, :3].copy(),
            columns["acceleration"][:, 3:].copy(),
        )

    def poses(self, topic: str) -> Poses:
        """Return a PoseStamped topic as columns; raises BagError as :meth:`joint_states` does."""
        times, log_times, values = self._stamped(topic, POSE_STAMPED, 7)
        return Poses(times, log_times, values[:, :3].copy(), values[:, 3:].copy())

    def inertias(self, topic: str) -> Inertias:
        """Return an InertiaStamped topic as columns; raises BagError as :meth:`joint_states` does."""
        times, log_times, values = self._stamped(topic, INERTIA_STAMPED, 10)
        return Inertias(times, log_times, values[:, 0].copy(), values[:, 1:4].copy())

    def _stamped(self, topic: str, type_name: str, number: int) -> tuple[Times, Times, Floats]:
        log_times, messages = self._collect(topic, type_name)
        try:
            codec = StampedDoublesCodec.of(messages[0], number)
        except ValueError as error:
            raise BagError(f"{self.path}: a message on {topic} cannot be read: {error}") from error
        columns = self._columns(topic, messages, codec)
        return _stamps(columns), log_times, columns["values"]

    def _columns(
        self, topic: str, messages: list[bytes], codec: ReferenceCodec | StampedDoublesCodec
    ) -> NDArray[np.void]:
        for index, data in enumerate(messages):
            if not codec.matches(data):
                raise BagError(f"{self.path}: message {index} on {topic} has another layout than the others")
        return np.frombuffer(b"".join(messages), codec.dtype)

    def _collect(self, topic: str, type_name: str) -> tuple[Times, list[bytes]]:
        self._require(topic)
        if self.topics[topic] != type_name:
            raise BagError(f"{self.path}: {topic} is of type {self.topics[topic]}, not {type_name}")
        log_times: list[int] = []
        messages: list[bytes] = []
        for log_time, _, data in self.messages(topic):
            log_times.append(log_time)
            messages.append(data)
        if not messages:
            raise BagError(f"{self.path} has no message on {topic}")
        return np.array(log_times, dtype=np.int64), messages

    def _require(self, topic: str) -> None:
        topics = self.topics
        if topic not in topics:
            raise BagError(
                f"{self.path} has no topic {topic}; it has {', '.join(sorted(topics)) or 'none at all'}"
            )


def _files(path: Path) -> list[Path]:
    """Return the MCAP files of the bag at `path` in the order of time."""
    if not path.exists():
        raise BagError(f"there is no bag {path}")
    if not path.is_dir():
        return [path]
    try:
        content = yaml.safe_load((path / METADATA_FILE).read_text())
        names = content["rosbag2_bagfile_information"]["relative_file_paths"]
        return [path / Path(name).name for name in names]
    except FileNotFoundError:  # a recording that was cut off has no metadata
        pass
    except (OSError, yaml.YAMLError, KeyError, TypeError) as error:
        raise BagError(f"{path / METADATA_FILE} is not the metadata of a bag: {error}") from error
    files = sorted(path.glob("*.mcap"))
    if not files:
        raise BagError(f"{path} is not a bag: it has neither {METADATA_FILE} nor an .mcap file")
    return files


def _reordered(codec: JointStateCodec, data: bytes) -> bytes:
    """Return a JointState of another layout in that of `codec`."""
    other = JointStateCodec.of(data)
    sample = other.decode(data)
    if sample is None or sorted(other.names) != sorted(codec.names) or other.fields != codec.fields:
        raise ValueError(
            f"it names {', '.join(other.names)} with {', '.join(other.fields)}, "
            f"the first one {', '.join(codec.names)} with {', '.join(codec.fields)}"
        )
    order = [other.names.index(name) for name in codec.names]
    return codec.encode(sample.stamp_ns, **{field: getattr(sample, field)[order] for field in codec.fields})


def _stamps(columns: NDArray[np.void]) -> Times:
    stamps: Times = columns["seconds"].astype(np.int64) * NANOSECONDS + columns["nanoseconds"]
    return stamps
