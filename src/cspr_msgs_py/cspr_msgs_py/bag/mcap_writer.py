"""Writing of one MCAP file.

The records are those of the package ``mcap``; only the messages, thousands a second, are packed here: that takes
a fifth of the time. Schemas and channels stand outside the chunks, where no damaged chunk can take them with it.
Source: the MCAP specification, "File Structure" and "Records".
"""

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Mapping
from enum import Enum
from io import RawIOBase
from typing import Any, Final

import lz4.frame
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC: Final = b"\x89MCAP0\r\n"

_CHUNK_SIZE: Final = 1024 * 1024
_MESSAGE: Final = struct.Struct("<BQHIQQ")  # opcode, length, channel, sequence, log time, publish time
_MESSAGE_OPCODE: Final = int(Opcode.MESSAGE)
_MESSAGE_FIELDS: Final = 22  # bytes of a message's record besides its data
_FOOTER: Final = struct.Struct("<BQQQ")


class Compression(Enum):
    """Compression of the chunks of a file."""

    NONE = "none"
    LZ4 = "lz4"
    ZSTD = "zstd"


class McapWriter:
    """An MCAP file being written to an unbuffered stream.

    Every method that writes raises OSError when the stream does. The records of such a call may then be on the
    stream in part, behind the first :attr:`size` bytes, and are forgotten, except for the chunk in progress.

    Attributes
    ----------
    counts : Counter of int
        Number of messages by channel, those of the chunk in progress not included.
    start, end : int or None
        Log time of the first and the last of these messages.
    """

    def __init__(self, stream: RawIOBase, library: str, compression: Compression = Compression.ZSTD) -> None:
        self.counts: Counter[int] = Counter()
        self.start: int | None = None
        self.end: int | None = None
        self._stream = stream
        self._offset = 0
        self._name = "" if compression is Compression.NONE else compression.value
        compressors: dict[Compression, Callable[[bytes], bytes]] = {
            Compression.NONE: bytes,
            Compression.LZ4: lz4.frame.compress,
            Compression.ZSTD: zstandard.ZstdCompressor().compress,
        }
        self._compress = compressors[compression]
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunk_indexes = bytearray()  # as they will stand in the summary: many, so packed
        self._chunk_count = 0
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._parts: list[bytes] = []  # of the chunk in progress
        self._size = 0
        self._indexes: dict[int, list[int]] = {}  # by channel: log time and offset of each message
        self._write(MAGIC + _bytes(Header(profile="ros2", library=library)))

    @property
    def size(self) -> int:
        """Bytes of whole records written, the chunk in progress not included."""
        return self._offset

    def add_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Return the id of the schema of this name; write it unless the file has it already."""
        names = [schema.name for schema in self._schemas]
        if name in names:
            return names.index(name) + 1
        schema = Schema(id=len(self._schemas) + 1, name=name, encoding=encoding, data=data)
        self._write(_bytes(schema))
        self._schemas.append(schema)
        return len(self._schemas)

    def add_channel(self, topic: str, encoding: str, schema: int, metadata: Mapping[str, str]) -> int:
        """Write a channel and return its id."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            schema_id=schema,
            metadata=dict(metadata),
        )
        self._write(_bytes(channel))
        self._channels.append(channel)
        return len(self._channels)

    def add_message(self, channel: int, sequence: int, log_time: int, publish_time: int, data: bytes) -> None:
        """Put a message into the chunk in progress."""
        length = _MESSAGE_FIELDS + len(data)
        self._parts.append(
            _MESSAGE.pack(_MESSAGE_OPCODE, length, channel, sequence & 0xFFFFFFFF, log_time, publish_time)
        )
        self._parts.append(data)
        index = self._indexes.get(channel)
        if index is None:
            index = self._indexes[channel] = []
        index.append(log_time)
        index.append(self._size)
        self._size += 9 + length
        if self._size >= _CHUNK_SIZE:
            self.end_chunk()

    def add_attachment(self, name: str, media_type: str, data: bytes, time: int) -> None:
        """Write a file with its name, type, content and time (ns)."""
        given: dict[str, Any] = {"create_time": 0, "log_time": time, "name": name, "media_type": media_type}
        record = _bytes(Attachment(data=data, **given))
        index = AttachmentIndex(offset=self._offset, length=len(record), data_size=len(data), **given)
        self._write(record)
        self._attachments.append(index)

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Write a record of strings by name."""
        data = _bytes(Metadata(name=name, metadata=dict(values)))
        index = MetadataIndex(offset=self._offset, length=len(data), name=name)
        self._write(data)
        self._metadata.append(index)

    def end_chunk(self) -> None:
        """Write the chunk in progress, unless it is empty."""
        if not self._indexes:
            return
        records = b"".join(self._parts)
        times = [index[::2] for index in self._indexes.values()]
        start, end = min(map(min, times)), max(map(max, times))
        data = self._compress(records)
        chunk = _bytes(
            Chunk(
                message_start_time=start,
                message_end_time=end,
                uncompressed_size=len(records),
                uncompressed_crc=zlib.crc32(records),
                compression=self._name,
                data=data,
            )
        )
        indexes, offsets = [], {}
        position = self._offset + len(chunk)
        for channel, index in self._indexes.items():
            offsets[channel] = position
            size = 8 * len(index)
            indexes.append(
                struct.pack(f"<BQHI{len(index)}Q", Opcode.MESSAGE_INDEX, 6 + size, channel, size, *index)
            )
            position += len(indexes[-1])
        entry = ChunkIndex(
            message_start_time=start,
            message_end_time=end,
            chunk_start_offset=self._offset,
            chunk_length=len(chunk),
            message_index_offsets=offsets,
            message_index_length=position - self._offset - len(chunk),
            compression=self._name,
            compressed_size=len(data),
            uncompressed_size=len(records),
        )
        self._write(b"".join([chunk, *indexes]))
        self._chunk_indexes += _bytes(entry)
        self._chunk_count += 1
        for channel, index in self._indexes.items():
            self.counts[channel] += len(index) // 2
        self.start = start if self.start is None else min(self.start, start)
        self.end = end if self.end is None else max(self.end, end)
        self.drop_chunk()

    def drop_chunk(self) -> Counter[int]:
        """Forget the chunk in progress; return the number of messages in it by channel."""
        dropped = Counter({channel: len(index) // 2 for channel, index in self._indexes.items()})
        self._parts, self._size, self._indexes = [], 0, {}
        return dropped

    def finish(self) -> None:
        """Write the chunk in progress and the summary that ends a file."""
        self.end_chunk()
        end = _bytes(DataEnd(data_section_crc=0))
        start = self._offset + len(end)
        groups = {
            Opcode.SCHEMA: b"".join(map(_bytes, self._schemas)),
            Opcode.CHANNEL: b"".join(map(_bytes, self._channels)),
            Opcode.STATISTICS: _bytes(self._statistics()),
            Opcode.CHUNK_INDEX: bytes(self._chunk_indexes),
            Opcode.ATTACHMENT_INDEX: b"".join(map(_bytes, self._attachments)),
            Opcode.METADATA_INDEX: b"".join(map(_bytes, self._metadata)),
        }
        summary, offsets = b"", b""
        for opcode, group in groups.items():
            if group:
                offset = SummaryOffset(
                    group_opcode=opcode, group_start=start + len(summary), group_length=len(group)
                )
                offsets += _bytes(offset)
                summary += group
        offset_start = start + len(summary)
        checked = summary + offsets + _FOOTER.pack(Opcode.FOOTER, 20, start, offset_start)
        footer = Footer(
            summary_start=start, summary_offset_start=offset_start, summary_crc=zlib.crc32(checked)
        )
        # in one piece: what cannot be written whole is cut off, and tried again when there is room
        self._write(end + summary + offsets + _bytes(footer) + MAGIC)

    def _statistics(self) -> Statistics:
        return Statistics(
            message_count=self.counts.total(),
            schema_count=len(self._schemas),
            channel_count=len(self._channels),
            attachment_count=len(self._attachments),
            metadata_count=len(self._metadata),
            chunk_count=self._chunk_count,
            message_start_time=self.start or 0,
            message_end_time=self.end or 0,
            channel_message_counts=dict(self.counts),
        )

    def _write(self, data: bytes) -> None:
        """Write records; the size grows when all of them are written."""
        rest = memoryview(data)
        while rest:
            rest = rest[self._stream.write(rest) or 0 :]
        self._offset += len(data)


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data
