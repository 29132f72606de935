"""Reading of one MCAP file, whole or cut off.

An index at the end of an MCAP file makes reading quick, and is missing from a file that a power failure cut
off. Here the records are walked from the front instead, passing over the contents of the chunks: that takes
little longer, and reads both kinds of file the same way. Source: the MCAP specification, "File Structure" and
"Records".
"""

import os
import struct
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Final

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream

from cspr_msgs_py.errors import BagError

MAGIC: Final = b"\x89MCAP0\r\n"

_RECORD: Final = struct.Struct("<BQ")  # opcode and length in front of every record
_INDEX: Final = struct.Struct("<HI")  # channel and size in bytes of the list of a message index
_INDEX_ENTRY: Final = 16  # bytes of a message in that list
_MESSAGE: Final = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time in front of the data


@dataclass
class _Region:
    """A part of the file that holds messages: a chunk, or a run of messages outside any chunk."""

    offset: int
    length: int
    chunked: bool
    counts: Counter[int] = field(default_factory=Counter)  # messages by channel


class McapFile:
    """An MCAP file open for reading.

    Attributes
    ----------
    path : Path
    channels : dict of int to Channel
    schemas : dict of int to Schema
    attachments : dict of str to bytes
    metadata : dict of str to dict
        Metadata records by their name.
    damage : str or None
        What is missing from the file, or None when it was finished properly.

    Raises
    ------
    BagError
        If the file cannot be opened or is no MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: dict[int, Channel] = {}
        self.schemas: dict[int, Schema] = {}
        self.attachments: dict[str, bytes] = {}
        self.metadata: dict[str, dict[str, str]] = {}
        self.damage: str | None = None
        self._regions: list[_Region] = []
        try:
            self._stream = path.open("rb")
        except OSError as error:
            raise BagError(f"cannot open {path}: {error.strerror}") from error
        try:
            self._size = os.fstat(self._stream.fileno()).st_size
            if self._size == 0:
                raise BagError(f"{path} is empty: nothing was recorded")
            if self._stream.read(len(MAGIC)) != MAGIC:
                raise BagError(f"{path} is not an MCAP file")
            end = self._index()
            if end is not None:
                self._index_contents()
                self.damage = (
                    f"{path} was cut off: the last {self._size - end} of its {self._size} bytes are lost, "
                    f"{sum(self.counts.values())} messages can be read"
                )
        except BaseException:
            self._stream.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._stream.close()

    @property
    def counts(self) -> Counter[int]:
        """Number of messages of each channel."""
        return sum((region.counts for region in self._regions), Counter())

    def messages(self, channels: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        """Yield log time (ns), publish time (ns) and data of the messages of some channels, in file order.

        Raises
        ------
        BagError
            If a chunk is damaged.
        """
        for region in self._regions:
            if any(region.counts[channel] for channel in channels):
                for opcode, content in _records(self._contents(region)):
                    if opcode == Opcode.MESSAGE:
                        channel, _, log_time, publish_time = _MESSAGE.unpack_from(content)
                        if channel in channels:
                            yield log_time, publish_time, bytes(content[_MESSAGE.size :])

    def _index(self) -> int | None:
        """Walk the records; return None, or where the last whole one ends if the file has no footer."""
        offset = len(MAGIC)
        run: _Region | None = None  # of messages outside chunks
        while True:
            self._stream.seek(offset)
            head = self._stream.read(_RECORD.size)
            if len(head) < _RECORD.size:
                return offset
            opcode, length = _RECORD.unpack(head)
            end = offset + _RECORD.size + length
            if end > self._size or opcode == 0:
                return offset
            if opcode == Opcode.FOOTER:
                return None
            if opcode == Opcode.CHUNK:
                self._regions.append(_Region(offset + _RECORD.size, length, chunked=True))
            elif opcode == Opcode.MESSAGE:
                if run is None or run.offset + run.length != offset:
                    run = _Region(offset, 0, chunked=False)
                    self._regions.append(run)
                run.length = end - run.offset
                run.counts[_MESSAGE.unpack(self._stream.read(_MESSAGE.size))[0]] += 1
            elif opcode == Opcode.MESSAGE_INDEX:
                channel, size = _INDEX.unpack(self._stream.read(_INDEX.size))
                self._regions[-1].counts[channel] += size // _INDEX_ENTRY
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.ATTACHMENT, Opcode.METADATA):
                self._take(opcode, self._stream.read(length))
            elif opcode == Opcode.DATA_END:
                self._count_unindexed()
            offset = end

    def _take(self, opcode: int, content: bytes | memoryview) -> None:
        stream = ReadDataStream(BytesIO(content))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream)
            self.channels[channel.id] = channel
        elif opcode == Opcode.ATTACHMENT:
            attachment = Attachment.read(stream)
            self.attachments[attachment.name] = attachment.data
        elif opcode == Opcode.METADATA:
            metadata = Metadata.read(stream)
            self.metadata[metadata.name] = metadata.metadata

    def _count_unindexed(self) -> None:
        """Count the messages of chunks that were written without an index."""
        for region in self._regions:
            if not region.counts:
                self._count(region)

    def _index_contents(self) -> None:
        """Count messages and collect channels by reading every chunk: the file's lists are missing."""
        whole = []
        for region in self._regions:
            try:
                self._count(region)
            except BagError:  # the last chunk may have the right length and not yet its contents
                continue
            whole.append(region)
        self._regions = whole

    def _count(self, region: _Region) -> None:
        region.counts.clear()
        for opcode, content in _records(self._contents(region)):
            if opcode == Opcode.MESSAGE:
                region.counts[_MESSAGE.unpack_from(content)[0]] += 1
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._take(opcode, content)

    def _contents(self, region: _Region) -> bytes:
        """Return the records inside a region."""
        self._stream.seek(region.offset)
        data = self._stream.read(region.length)
        if not region.chunked:
            return data
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(data)))
            stream, size = get_chunk_data_stream(chunk, validate_crc=True)
            records: bytes = stream.read(size)
        except Exception as error:  # each decompressor reports damage with a class of its own
            raise BagError(f"{self.path}: the chunk at byte {region.offset} is damaged: {error}") from error
        return records


def _records(data: bytes) -> Iterator[tuple[int, memoryview]]:
    """Yield opcode and content of the records that follow one another in `data`."""
    view = memoryview(data)
    offset = 0
    while offset < len(data):
        opcode, length = _RECORD.unpack_from(data, offset)
        offset += _RECORD.size
        yield opcode, view[offset : offset + length]
        offset += length
