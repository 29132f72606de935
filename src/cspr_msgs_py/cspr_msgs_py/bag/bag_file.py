"""A bag on disk: MCAP files of raw messages with ``metadata.yaml`` beside them, laid out as rosbag2 does.

Everything here may block on the disk; :mod:`cspr_msgs_py.bag.writer` shields the receivers of messages from that.
"""

import errno
import os
import shutil
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from io import FileIO
from pathlib import Path
from typing import Final

from cspr_msgs_py.bag.mcap_writer import Compression, McapWriter
from cspr_msgs_py.bag.metadata import METADATA_FILE, FileSummary, RecordedTopic, bag_information, dump
from cspr_msgs_py.errors import BagError

RECORDING: Final = "recording"  # name of the metadata record about the recording itself
DROPPED: Final = "dropped"  # ... of messages that came and could not be written, by topic
LOST: Final = "lost"  # ... of messages that did not come, by topic

_MEDIA_TYPES: Final = {".yaml": "application/yaml", ".json": "application/json"}
_RESERVE: Final = 4 * 1024 * 1024  # bytes: for the summary of a bag of several hours


@dataclass(frozen=True)
class Attachment:
    """A file that is kept inside a bag."""

    name: str
    data: bytes

    @classmethod
    def from_file(cls, path: str | os.PathLike[str]) -> "Attachment":
        """Read the file at `path`; the path becomes the name of the attachment.

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
    """A bag being written; every method that writes raises OSError where that fails.

    Parameters
    ----------
    directory : path
        The bag: a directory that does not exist yet. Its files are ``<name of the directory>_0.mcap`` and so on.
    information : mapping of str to str
        Facts about the recording, kept as the metadata record ``recording`` and as
        ``custom_data`` of ``metadata.yaml``.
    attachments : sequence of Attachment
        Written first into every file, so that they survive whatever happens later.
    compression : Compression
    start_ns : int
        Time stamp of the attachments.
    split_size, split_duration : int
        Size (bytes) and duration (ns) of a file at which to continue in a new one; checked whenever a chunk ends. 0 for
        never.

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
        split_size: int = 0,
        split_duration: int = 0,
    ) -> None:
        self.directory = Path(directory)
        self._information = dict(information)
        self._attachments = tuple(attachments)
        self._compression = compression
        self._start_ns = start_ns
        self._split_size, self._split_duration = split_size, split_duration
        self._topics: list[RecordedTopic] = []
        self._files: list[FileSummary] = []
        self._counts: Counter[int] = Counter()  # messages by channel in the files that are finished
        self._reserve = self.directory / ".reserve"
        try:
            self.directory.mkdir(parents=True)
        except FileExistsError as error:
            raise BagError(
                f"bag {self.directory} exists already and is not overwritten: name another one"
            ) from error
        except OSError as error:
            raise BagError(f"cannot create bag {self.directory}: {error.strerror}") from error
        self._stream: FileIO | None = None
        try:
            with self._reserve.open("wb") as reserve:
                os.posix_fallocate(reserve.fileno(), 0, _RESERVE)
            self._open()
            self.write_metadata()
        except OSError as error:
            self.abandon()
            shutil.rmtree(self.directory, ignore_errors=True)  # it is empty, and would be in the way
            needed = f"; at least {_RESERVE // 2**20} MB are needed" if error.errno == errno.ENOSPC else ""
            raise BagError(f"cannot write bag {self.directory}: {error.strerror}{needed}") from error

    @property
    def path(self) -> Path:
        """The file that is being written."""
        return self.directory / self._files[-1].name

    @property
    def files(self) -> int:
        """Number of files so far."""
        return len(self._files)

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages of each topic on the disk; those of the chunk in progress are not."""
        finished, present = self._counts, self._writer.counts
        return {
            topic.name: finished[index] + present[index]
            for index, topic in enumerate(list(self._topics), start=1)
        }

    def add_topic(self, topic: RecordedTopic) -> int:
        """Add a topic and return its index for :meth:`add_message`."""
        self._declare(topic)
        self._topics.append(topic)
        return len(self._topics) - 1

    def add_message(
        self, topic: int, log_time_ns: int, publish_time_ns: int, data: bytes, sequence: int = 0
    ) -> None:
        """Add a message of the topic with this index; what fills a chunk also writes it."""
        self._writer.add_message(topic + 1, sequence, log_time_ns, publish_time_ns, data)

    def sync(self) -> None:
        """Close the chunk in progress and wait until everything is on the disk; start a new file if it is time."""
        assert self._stream is not None
        self._writer.end_chunk()
        os.fdatasync(self._stream.fileno())
        size, duration, writer = self._split_size, self._split_duration, self._writer
        lasted = writer.end - writer.start if writer.end is not None and writer.start is not None else 0
        if (size and writer.size >= size) or (duration and lasted >= duration):
            self.split()

    def split(self) -> None:
        """Finish the current file and continue in a new one."""
        self._finish({})
        finished = self._counts + self._writer.counts
        self._open()
        self._counts = finished
        for topic in self._topics:
            self._declare(topic)
        self.write_metadata()

    def close(self, notes: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Finish the file and write ``metadata.yaml``; where that fails, what was written before stays readable.

        Parameters
        ----------
        notes
            More metadata records by name. What is in them also becomes ``custom_data``, the name in front.
        """
        for name, values in (notes or {}).items():
            self._information |= {f"{name} {key}": value for key, value in values.items()}
        if self._stream is not None:
            self._finish(notes or {})
        self.write_metadata()
        self._reserve.unlink(missing_ok=True)

    def give_up_chunk(self) -> Counter[int]:
        """Discard the messages that are not on the disk; return their number by the topic's index."""
        return Counter({channel - 1: number for channel, number in self._writer.drop_chunk().items()})

    def close_full(self, notes: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Finish the bag on a disk that has no room for more.

        What was written last may be there in part: it is cut off, and the space that was set aside at the start
        is used for the end of the file. If that fails too, the file stays readable up to its last whole chunk.
        """
        self.give_up_chunk()
        with suppress(OSError):
            self._reserve.unlink(missing_ok=True)
            if self._stream is not None:
                self._stream.seek(self._writer.size)
                self._stream.truncate()
            self.close(notes)
        self.abandon()

    def abandon(self) -> None:
        """Close the file without finishing it: it stays readable up to its last whole chunk."""
        with suppress(OSError):  # what is buffered cannot be written either, which is known by now
            self._reserve.unlink(missing_ok=True)
            if self._stream is not None:
                self._stream.close()

    def _open(self) -> None:
        path = self.directory / f"{self.directory.resolve().name}_{len(self._files)}.mcap"
        stream = FileIO(path, "xb")
        try:
            writer = McapWriter(stream, f"cspr_msgs_py {version('cspr_msgs_py')}", self._compression)
            writer.add_metadata(RECORDING, self._information)
            for attachment in self._attachments:
                media_type = _MEDIA_TYPES.get(Path(attachment.name).suffix, "application/octet-stream")
                writer.add_attachment(attachment.name, media_type, attachment.data, self._start_ns)
        except OSError:
            stream.close()
            path.unlink()
            raise
        self._files.append(FileSummary(path.name))
        self._stream, self._writer = stream, writer

    def _declare(self, topic: RecordedTopic) -> None:
        schema = self._writer.add_schema(topic.type, topic.definition_language, topic.definition.encode())
        self._writer.add_channel(topic.name, "cdr", schema, topic.channel_metadata)

    def _finish(self, notes: Mapping[str, Mapping[str, str]]) -> None:
        assert self._stream is not None
        self._writer.end_chunk()
        for name, values in notes.items():
            self._writer.add_metadata(name, values)
        self._writer.add_metadata("rosbag2", {"serialized_metadata": dump(self._metadata())})
        self._writer.finish()
        os.fdatasync(self._stream.fileno())
        self._stream.close()
        self._stream = None

    def _metadata(self) -> dict[str, object]:
        file, writer = self._files[-1], self._writer
        file.start, file.end, file.count = writer.start, writer.end, writer.counts.total()
        return bag_information(self._files, self._topics, self.counts, self._information)

    def write_metadata(self) -> None:
        """Write ``metadata.yaml`` as the bag is now, for readers of a recording that is still running or was killed."""
        temporary = self.directory / f".{METADATA_FILE}"
        temporary.write_text(dump({"rosbag2_bagfile_information": self._metadata()}))
        temporary.replace(self.directory / METADATA_FILE)
