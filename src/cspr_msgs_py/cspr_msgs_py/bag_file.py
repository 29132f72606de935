"""A bag on disk: an MCAP file of raw messages with ``metadata.yaml`` beside it, laid out as rosbag2 does.

Everything here waits for the disk; :mod:`cspr_msgs_py.bag_writer` keeps that away from who receives messages.
"""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Final

from mcap.writer import CompressionType, Writer

from cspr_msgs_py.bag_metadata import METADATA_FILE, RecordedTopic, bag_information, dump
from cspr_msgs_py.errors import BagError

RECORDING: Final = "recording"  # name of the metadata record about the recording itself

_CHUNK_SIZE: Final = 1024 * 1024
_MEDIA_TYPES: Final = {".yaml": "application/yaml", ".json": "application/json"}


class Compression(Enum):
    """Compression of the chunks of a bag."""

    NONE = "none"
    LZ4 = "lz4"
    ZSTD = "zstd"


_COMPRESSION: Final = {
    Compression.NONE: CompressionType.NONE,
    Compression.LZ4: CompressionType.LZ4,
    Compression.ZSTD: CompressionType.ZSTD,
}


@dataclass(frozen=True)
class Attachment:
    """A file that travels inside a bag."""

    name: str
    data: bytes

    @classmethod
    def from_file(cls, path: str | os.PathLike[str]) -> "Attachment":
        """Read the file at `path`; the attachment bears the path as its name.

        Raises
        ------
        BagError
            If the file cannot be read.
        """
        try:
            return cls(os.fspath(path), Path(path).read_bytes())
        except OSError as error:
            raise BagError(f"cannot attach {os.fspath(path)}: {error.strerror}") from error


class BagFile:
    """A bag being written.

    Parameters
    ----------
    directory : path
        The bag: a directory that does not exist yet. Its file is ``<name of the directory>_0.mcap``.
    information : mapping of str to str
        What is worth knowing about the recording; kept as the metadata record ``recording`` and as
        ``custom_data`` of ``metadata.yaml``.
    attachments : sequence of Attachment
        Written first, so that they survive whatever happens later.
    compression : Compression
    start_ns : int
        Time that the attachments bear.

    Raises
    ------
    BagError
        If the directory exists already or cannot be written.
    """

    def __init__(
        self,
        directory: str | os.PathLike[str],
        information: Mapping[str, str],
        attachments: Sequence[Attachment] = (),
        compression: Compression = Compression.ZSTD,
        start_ns: int = 0,
    ) -> None:
        self.directory = Path(directory)
        self.path = self.directory / f"{self.directory.resolve().name}_0.mcap"
        self.counts: Counter[str] = Counter()
        self._information = dict(information)
        self._topics: list[RecordedTopic] = []
        self._channels: list[int] = []
        self._schemas: dict[str, int] = {}
        self._first: int | None = None
        self._last: int | None = None
        try:
            self.directory.mkdir(parents=True)
            self._stream = self.path.open("xb")
        except FileExistsError as error:
            raise BagError(
                f"bag {self.directory} exists already and is not overwritten: name another one"
            ) from error
        except OSError as error:
            raise BagError(f"cannot create bag {self.directory}: {error.strerror}") from error
        self._writer = Writer(self._stream, chunk_size=_CHUNK_SIZE, compression=_COMPRESSION[compression])
        try:
            self._writer.start(profile="ros2")
            self._writer.add_metadata(RECORDING, self._information)
            for attachment in attachments:
                media_type = _MEDIA_TYPES.get(Path(attachment.name).suffix, "application/octet-stream")
                self._writer.add_attachment(0, start_ns, attachment.name, media_type, attachment.data)
            self.sync()
        except OSError as error:
            self.abandon()
            raise BagError(f"cannot write {self.path}: {error.strerror}") from error

    def add_topic(self, topic: RecordedTopic) -> int:
        """Add a topic and return its index for :meth:`add_message`."""
        schema = self._schemas.get(topic.type)
        if schema is None:
            schema = self._writer.register_schema(topic.type, "ros2msg", topic.definition.encode())
            self._schemas[topic.type] = schema
        channel = self._writer.register_channel(topic.name, "cdr", schema, topic.channel_metadata)
        self._topics.append(topic)
        self._channels.append(channel)
        return len(self._topics) - 1

    def add_message(self, topic: int, log_time_ns: int, publish_time_ns: int, data: bytes) -> None:
        """Add a message of the topic with this index.

        Raises
        ------
        OSError
            If a chunk is full and cannot be written.
        """
        self._writer.add_message(self._channels[topic], log_time_ns, data, publish_time_ns)
        self.counts[self._topics[topic].name] += 1
        self._first = log_time_ns if self._first is None else min(self._first, log_time_ns)
        self._last = log_time_ns if self._last is None else max(self._last, log_time_ns)

    def sync(self) -> None:
        """Close the chunk in progress and wait until everything is on the disk.

        Raises
        ------
        OSError
            If that fails.
        """
        self._writer.flush()
        os.fdatasync(self._stream.fileno())

    def close(self) -> None:
        """Finish the file and write ``metadata.yaml``.

        Raises
        ------
        BagError
            If either cannot be written. What has been written before stays readable.
        """
        metadata = bag_information(
            self.path.name, self._topics, self.counts, self._first, self._last, self._information
        )
        try:
            self._writer.add_metadata("rosbag2", {"serialized_metadata": dump(metadata)})
            self._writer.finish()
            self._stream.flush()
            os.fdatasync(self._stream.fileno())
            self._stream.close()
            temporary = self.directory / f".{METADATA_FILE}"
            temporary.write_text(dump({"rosbag2_bagfile_information": metadata}))
            temporary.replace(self.directory / METADATA_FILE)
        except OSError as error:
            self.abandon()
            raise BagError(f"cannot finish bag {self.directory}: {error.strerror}") from error

    def abandon(self) -> None:
        """Let go of the file without finishing it: it stays readable up to its last whole chunk."""
        with suppress(OSError):  # what is buffered cannot be written either, which is known by now
            self._stream.close()
