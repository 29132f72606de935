"""Reads bags into numpy arrays: whole bags and damaged ones, ours and those of other tools.

::

    with Bag("runs/latest/bag") as bag:
        states = bag["/motor_states"]
        speed = states.velocity[:, 0]  # of motor 1, at states.time
        later = bag.read("/motor_states", start=10.0)  # s since the start of the bag
"""

import heapq
import math
import os
import struct
import warnings
from collections import Counter
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, TypeVar

import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel
from mcap_ros2.decoder import DecoderFactory

from cspr_msgs_py.bag import collecting
from cspr_msgs_py.bag.collecting import Decode
from cspr_msgs_py.bag.columns import Inertias, JointStates, Poses, References, Samples
from cspr_msgs_py.bag.mcap_file import McapFile
from cspr_msgs_py.bag.message_block import MessageBlock
from cspr_msgs_py.bag.metadata import OfferedQos, find_files, parse_offered_qos
from cspr_msgs_py.errors import BagError, BagWarning
from cspr_msgs_py.topics import INERTIA_STAMPED, JOINT_STATE, MULTI_DOF_TRAJECTORY, POSE_STAMPED, REFERENCE
from cspr_msgs_py.wire.cdr import NANOSECONDS

_Columns = TypeVar("_Columns", bound=Samples)

_READERS = {
    JOINT_STATE: collecting.joint_states,
    MULTI_DOF_TRAJECTORY: collecting.references,
    POSE_STAMPED: collecting.poses,
    INERTIA_STAMPED: collecting.inertias,
}


class Message(NamedTuple):
    """One recorded message: log time in ns, topic, CDR bytes."""

    log_time_ns: int
    topic: str
    data: bytes


def find_bag(path: str | os.PathLike[str]) -> Path:
    """Return the bag that a path stands for: a bag itself, or the one inside the directory of a run."""
    given = Path(path)
    inside = given / "bag"
    return inside if inside.is_dir() and not any(given.glob("*.mcap")) else given


class Bag:
    """A bag open for reading.

    Parameters
    ----------
    path : path
        Directory of a bag, one of its files, or the directory of a run that has the bag inside.

    Attributes
    ----------
    path : Path
        Of the bag.
    announced_counts : dict of str to int
        Messages of each topic by ``metadata.yaml``: more than there are in a damaged bag, fewer in one whose
        recorder was killed or still runs; empty without that file.
    files : list of McapFile
        Those that can be read, in the order in which they were written.
    complete : bool
        Whether the recording was finished properly and all of its files are there.

    Raises
    ------
    BagError
        If there is no bag, or nothing in it can be read. A bag that is not whole only gives a
        :class:`BagWarning`, now or when it is read.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = find_bag(path)
        self.files: list[McapFile] = []
        paths, self._each_compressed, self.announced_counts = find_files(self.path)
        problems: list[BagError] = []
        for file in paths:
            try:
                self.files.append(McapFile(file))
            except BagError as error:
                problems.append(error)
        if not self.files:
            raise problems[0] if problems else BagError(f"{self.path} has no files")
        for text in (*map(str, problems), *(file.damage for file in self.files if file.damage)):
            warnings.warn(text, BagWarning, stacklevel=2)
        self.complete = not problems and not any(file.damage for file in self.files)

    def __enter__(self) -> "Bag":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files."""
        for file in self.files:
            file.close()

    @property
    def topics(self) -> dict[str, str]:
        """Message type of each topic."""
        return {
            channel.topic: file.schemas[channel.schema_id].name if channel.schema_id in file.schemas else ""
            for file in self.files
            for channel in file.channels.values()
        }

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages of each topic."""
        counts = Counter(dict.fromkeys(self.topics, 0))
        for file in self.files:
            for channel, number in file.counts.items():
                if channel in file.channels:
                    counts[file.channels[channel].topic] += number
        return dict(counts)

    @property
    def start_ns(self) -> int:
        """Log time of the first message, ns; 0 for a bag without any."""
        return min((region.start for file in self.files for region in file.regions), default=0)

    @property
    def end_ns(self) -> int:
        """Log time of the last message, ns; 0 for a bag without any."""
        return max((region.end for file in self.files for region in file.regions), default=0)

    @property
    def attachments(self) -> dict[str, bytes]:
        """The files inside the bag by name, such as the configuration that was in use."""
        return {name: data for file in self.files for name, data in file.attachments.items()}

    @property
    def metadata(self) -> dict[str, dict[str, str]]:
        """The metadata records by name; ``recording`` says how the bag was made."""
        return {name: record for file in self.files for name, record in file.metadata.items()}

    def offered_qos(self, topic: str) -> tuple[OfferedQos, ...]:
        """Return what the publishers of a topic offered; empty if the bag does not say."""
        self._require(topic)
        texts = (channel.metadata.get("offered_qos_profiles", "") for _, channel in self._channels(topic))
        return parse_offered_qos(next(filter(None, texts), ""))

    def __getitem__(self, topic: str) -> Any:
        """Return all messages of a topic as numpy arrays, see `read`."""
        return self.read(topic)

    def read(self, topic: str, start: float | None = None, end: float | None = None) -> Any:
        """Return the messages of a topic as numpy arrays.

        Parameters
        ----------
        topic
            Its name.
        start, end
            Only messages that were received from `start` up to and not including `end`, seconds since the start
            of the bag.

        Returns
        -------
        JointStates, References, Poses, Inertias or Messages
            By the type of the topic; the last one, of decoded messages, for all others.

        Raises
        ------
        BagError
            If the bag does not have the topic or no message of it, or its type cannot be decoded.
        """
        self._require(topic)
        kind = self.topics[topic]
        reader = _READERS.get(kind, collecting.messages)
        blocks = self._blocks(topic, self._absolute(start, -math.inf), self._absolute(end, math.inf))
        try:
            samples: Samples = reader(blocks, self.counts[topic], self.start_ns, self._decoder(topic))
        except (ValueError, IndexError, AttributeError, struct.error, McapError) as error:
            raise BagError(f"{self.path}: a message on {topic} is not a {kind}: {error}") from error
        if not len(samples):
            span = "" if start is None and end is None else " in this range of time"
            raise BagError(f"{self.path} has no message on {topic}{span}")
        return samples

    def joint_states(self, topic: str) -> JointStates:
        """Return a JointState topic as columns; raises as `read`, and for a topic of another type."""
        return self._typed(topic, JOINT_STATE, JointStates)

    def references(self, topic: str = REFERENCE.name) -> References:
        """Return the reference as columns; raises as `joint_states` does."""
        return self._typed(topic, MULTI_DOF_TRAJECTORY, References)

    def poses(self, topic: str) -> Poses:
        """Return a PoseStamped topic as columns; raises as `joint_states` does."""
        return self._typed(topic, POSE_STAMPED, Poses)

    def inertias(self, topic: str) -> Inertias:
        """Return an InertiaStamped topic as columns; raises as `joint_states` does."""
        return self._typed(topic, INERTIA_STAMPED, Inertias)

    def messages(self, topic: str) -> Iterator[tuple[int, int, bytes]]:
        """Yield log time (ns), publish time (ns) and CDR bytes of each message, as recorded.

        Raises
        ------
        BagError
            If the bag does not have the topic.
        """
        self._require(topic)
        for block in self._blocks(topic):
            yield from (message[2:] for message in block.messages())

    def in_order(
        self, topics: Collection[str] | None = None, start_ns: float = -math.inf, end_ns: float = math.inf
    ) -> Iterator[Message]:
        """Yield the messages of some topics, or all, by log time.

        Parameters
        ----------
        topics
            Names; all of the bag by default.
        start_ns, end_ns
            Range of log times, the end not included, ns.

        Raises
        ------
        BagError
            If the bag does not have one of the topics.
        """
        wanted = set(self.topics if topics is None else topics)
        for topic in wanted:
            self._require(topic)
        regions = [(file, region) for file in self.files for region in file.regions]
        waiting: list[tuple[int, int, Message]] = []
        counter = 0
        for file, region in sorted(regions, key=lambda entry: entry[1].start):
            while waiting and waiting[0][0] < region.start:  # nothing earlier can come any more
                yield heapq.heappop(waiting)[2]
            names = {key: channel.topic for key, channel in file.channels.items() if channel.topic in wanted}
            block = self.uncompressed(file.block(region, names, start_ns, end_ns))
            for channel, _, log_time, _, data in block.messages():
                heapq.heappush(waiting, (log_time, counter, Message(log_time, names[channel], data)))
                counter += 1
        while waiting:
            yield heapq.heappop(waiting)[2]

    def _typed(self, topic: str, kind: str, _: type[_Columns]) -> _Columns:
        self._require(topic)
        if self.topics[topic] != kind:
            raise BagError(f"{self.path}: {topic} is of type {self.topics[topic]}, not {kind}")
        columns: _Columns = self.read(topic)
        return columns

    def _absolute(self, seconds: float | None, otherwise: float) -> float:
        return otherwise if seconds is None else self.start_ns + round(seconds * NANOSECONDS)

    def _blocks(
        self, topic: str, start_ns: float = -math.inf, end_ns: float = math.inf
    ) -> Iterator[MessageBlock]:
        for file in self.files:
            channels = {channel.id for channel in file.channels.values() if channel.topic == topic}
            for block in file.blocks(channels, start_ns, end_ns):
                yield self.uncompressed(block)

    def uncompressed(self, block: MessageBlock) -> MessageBlock:
        """Return a block of messages as they were published: some bags compress each message separately."""
        if not self._each_compressed:
            return block
        decompressor = zstandard.ZstdDecompressor()
        try:
            return block.mapped(lambda data: decompressor.decompressobj().decompress(data))
        except zstandard.ZstdError as error:
            raise BagError(f"{self.path}: a message cannot be decompressed: {error}") from error

    def _decoder(self, topic: str) -> Decode:
        """Return a decoder of a topic's messages, which reads the definition in the bag on its first use."""
        file, channel = next(self._channels(topic))
        schema = file.schemas.get(channel.schema_id)

        @cache
        def decoder() -> Decode:
            found: Decode | None = DecoderFactory().decoder_for(channel.message_encoding, schema)
            if found is None or schema is None or not schema.data:
                raise BagError(
                    f"{self.path}: messages on {topic} cannot be decoded, their definition is "
                    + (f"in {schema.encoding!r}" if schema and schema.data else "missing")
                    + "; Bag.messages() gives their bytes"
                )
            return found

        return lambda data: decoder()(data)

    def _channels(self, topic: str) -> Iterator[tuple[McapFile, Channel]]:
        for file in self.files:
            yield from ((file, channel) for channel in file.channels.values() if channel.topic == topic)

    def _require(self, topic: str) -> None:
        topics = self.topics
        if topic not in topics:
            raise BagError(
                f"{self.path} has no topic {topic}; it has {', '.join(sorted(topics)) or 'none at all'}"
            )
