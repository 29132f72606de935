"""Reading of one MCAP file, whole or cut off.

An index at the end of an MCAP file makes reading quick, and is missing from a file that a power failure cut
off. Here the records are walked from the front instead, passing over the contents of the chunks: that takes
little longer, and reads both kinds of file the same way. Source: the MCAP specification, "File Structure" and
"Records".
"""

import math
import mmap
import struct
import tempfile
import warnings
import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Final

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, ChunkIndex, Metadata, Schema
from numpy.typing import NDArray

from cspr_msgs_py.bag.mcap_writer import MAGIC
from cspr_msgs_py.bag.message_block import MessageBlock, message_offsets, walk
from cspr_msgs_py.bag.metadata import COMPRESSED_SUFFIX
from cspr_msgs_py.errors import BagError, BagWarning

_RECORD: Final = struct.Struct("<BQ")  # opcode and length in front of every record
_INDEX: Final = struct.Struct("<HI")  # channel and size in bytes of the list of a message index
_ENTRY_SIZE: Final = 16  # bytes of a message in that list: log time and offset
_MESSAGE: Final = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time in front of the data
_CHUNK: Final = struct.Struct(
    "<QQQII"
)  # first and last log time, size, CRC, length of the compression's name
_FOOTER: Final = struct.Struct("<QQI")  # start of the summary, of its offsets, CRC


_NOTHING: Final = MessageBlock(np.empty(0, dtype=np.uint8), np.empty(0, dtype=np.int64))


@dataclass
class Region:
    """A part of the file that holds messages: a chunk, or a run of messages outside any chunk.

    Attributes
    ----------
    offset, length : int
        Where its content lies.
    chunked : bool
    start, end : int
        First and last log time, ns.
    counts : Counter of int
        Messages by channel.
    """

    offset: int
    length: int
    chunked: bool
    start: int
    end: int
    counts: Counter[int] = field(default_factory=Counter)
    indexes: dict[int, list[tuple[int, int]]] = field(default_factory=dict)  # offset and length by channel
    damaged: bool = False


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
    regions : list of Region
        Where the messages lie, in the order in which they were written.
    damage : str or None
        What is missing from the file, or None when it was finished properly.
    missing : Counter of int
        Messages by channel that were found to be missing while reading.

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
        self.regions: list[Region] = []
        self.damage: str | None = None
        self.missing: Counter[int] = Counter()
        self._zstd = zstandard.ZstdDecompressor()  # making one costs as much as a small chunk
        self._map = _open(path)
        self._data = memoryview(self._map)
        try:
            if bytes(self._data[: len(MAGIC)]) != MAGIC:
                raise BagError(f"{path} is not an MCAP file")
            gaps, end = self._index()
            if gaps or end is not None:
                self._index_contents()
                self.damage = self._describe(gaps, end)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Close the file."""
        self._data.release()
        with suppress(BufferError):  # arrays that view it are still in use
            self._map.close()

    @property
    def counts(self) -> Counter[int]:
        """Number of messages of each channel."""
        counts: Counter[int] = Counter()
        for region in self.regions:
            counts.update(region.counts)
        return counts

    def blocks(
        self, channels: Collection[int], start_ns: float = -math.inf, end_ns: float = math.inf
    ) -> Iterator[MessageBlock]:
        """Yield what `block` finds in each region, in file order."""
        for region in self.regions:
            block = self.block(region, channels, start_ns, end_ns)
            if len(block):
                yield block

    def block(
        self,
        region: Region,
        channels: Collection[int],
        start_ns: float = -math.inf,
        end_ns: float = math.inf,
    ) -> MessageBlock:
        """Return the messages of some channels in a region whose log time t is start_ns <= t < end_ns.

        None, with a warning, if the region is damaged.
        """
        outside = region.start >= end_ns or region.end < start_ns
        if outside or region.damaged or not any(region.counts[channel] for channel in channels):
            return _NOTHING
        try:
            records = self.contents(region)
            indexed = self._indexed(region, records, channels)
            block = indexed or MessageBlock(records, message_offsets(records, channels))
        except ValueError as error:
            self._miss(region, error)
            return _NOTHING
        if start_ns == -math.inf and end_ns == math.inf:  # as nearly always
            return block
        times = block.log_times
        return block.selected((times >= start_ns) & (times < end_ns))

    def _indexed(
        self, region: Region, records: NDArray[np.uint8], channels: Collection[int]
    ) -> MessageBlock | None:
        """Return the messages by the chunk's index; None if it has no valid one."""
        lists = [
            np.frombuffer(self._data, "<i8", length // 8, offset)[1::2]
            for channel in channels
            for offset, length in region.indexes.get(channel, ())
        ]
        if not lists:
            return None
        offsets = lists[0] if len(lists) == 1 else np.sort(np.concatenate(lists))
        try:
            block = MessageBlock(records, offsets)
        except ValueError:
            return None
        return block if block.only_of(channels) else None

    def _miss(self, region: Region, error: Exception) -> None:
        region.damaged = True
        self.missing += region.counts
        parts = ", ".join(
            f"{number} of {self.channels[channel].topic}" if channel in self.channels else f"{number}"
            for channel, number in sorted(region.counts.items())
        )
        warnings.warn(
            f"{self.path}: the chunk at byte {region.offset} is damaged ({error}); missing are the messages of "
            f"{(region.end - region.start) * 1e-9:.2f} s: {parts or 'an unknown number'}",
            BagWarning,
            stacklevel=4,
        )

    def _index(self) -> tuple[list[tuple[int, int]], int | None]:
        """Walk the records; return damaged stretches, and where the last whole record ends without a footer."""
        data, size = self._data, len(self._data)
        offset = len(MAGIC)
        gaps: list[tuple[int, int]] = []
        run: Region | None = None  # of messages outside chunks
        while True:
            opcode, length = _RECORD.unpack_from(data, offset) if offset + _RECORD.size <= size else (0, 0)
            content = offset + _RECORD.size
            end = content + length
            if opcode == Opcode.FOOTER and end + len(MAGIC) == size:
                return gaps, None
            if end > size or not Opcode.HEADER <= opcode <= Opcode.DATA_END:
                further = self._next_chunk(offset)
                if further is None:
                    return gaps, offset
                gaps.append((offset, further))
                offset = further
                continue
            if opcode == Opcode.CHUNK:
                start, last, *_ = _CHUNK.unpack_from(data, content)
                self.regions.append(Region(content, length, True, start, last))
            elif opcode == Opcode.MESSAGE:
                channel, _, time, _ = _MESSAGE.unpack_from(data, content)
                if run is None or run.offset + run.length != offset:
                    run = Region(offset, 0, False, time, time)
                    self.regions.append(run)
                run.length = end - run.offset
                run.start, run.end = min(run.start, time), max(run.end, time)
                run.counts[channel] += 1
            elif opcode == Opcode.MESSAGE_INDEX and self.regions:
                channel, listed = _INDEX.unpack_from(data, content)
                region = self.regions[-1]
                region.counts[channel] += listed // _ENTRY_SIZE
                region.indexes.setdefault(channel, []).append((content + _INDEX.size, listed))
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.ATTACHMENT, Opcode.METADATA):
                with suppress(Exception):  # a damaged one; who needs it will miss it by name
                    self._take(opcode, data[content:end])
            elif opcode == Opcode.DATA_END:
                for region in self.regions:  # chunks that were written without an index
                    if not region.counts:
                        self._count(region)
            offset = end

    def _next_chunk(self, offset: int) -> int | None:
        """Return where the next chunk behind `offset` begins by the summary at the end of the file, if it is there."""
        footer = len(self._data) - len(MAGIC) - _FOOTER.size
        if footer < offset or bytes(self._data[-len(MAGIC) :]) != MAGIC:
            return None
        place, _, _ = _FOOTER.unpack_from(self._data, footer)
        starts = []
        try:
            for opcode, _, content in walk(
                np.frombuffer(self._data, np.uint8)[place : footer - _RECORD.size]
            ):
                if opcode == Opcode.CHUNK_INDEX:
                    starts.append(ChunkIndex.read(ReadDataStream(BytesIO(content))).chunk_start_offset)
        except Exception:  # the summary is damaged as well
            return None
        return min((start for start in starts if start > offset), default=None)

    def _take(self, opcode: int, content: memoryview) -> None:
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

    def _index_contents(self) -> None:
        """Collect channels and counts from inside the chunks where the file's own lists are missing."""
        for region in self.regions:
            unknown = any(channel not in self.channels for channel in region.counts)
            if region is self.regions[-1] or unknown or not region.counts:
                self._count(region)
        self.regions = [region for region in self.regions if region.counts or not region.damaged]

    def _count(self, region: Region) -> None:
        region.counts.clear()
        region.indexes.clear()
        try:
            for opcode, _, content in walk(self.contents(region)):
                if opcode == Opcode.MESSAGE:
                    region.counts[_MESSAGE.unpack_from(content)[0]] += 1
                elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._take(opcode, content)
        except ValueError:  # the last chunk may have the right length and not yet its contents
            region.damaged = True

    def contents(self, region: Region) -> NDArray[np.uint8]:
        """Return the records inside a region.

        Raises
        ------
        ValueError
            If they are not what was written.
        """
        content = self._data[region.offset : region.offset + region.length]
        if not region.chunked:
            return np.frombuffer(content, np.uint8)
        try:
            _, _, size, checksum, named = _CHUNK.unpack_from(content)
            name = bytes(content[_CHUNK.size : _CHUNK.size + named]).decode("ascii")
            data = content[_CHUNK.size + named + 8 :]
            records = self._decompress(name, data, size)
        except Exception as error:  # each decompressor reports damage with a class of its own
            raise ValueError(str(error)) from error
        if len(records) != size or (checksum and zlib.crc32(records) != checksum):
            raise ValueError("its checksum is wrong")
        return np.frombuffer(records, np.uint8)

    def _decompress(self, name: str, data: memoryview, size: int) -> bytes | memoryview:
        if name == "zstd":
            return self._zstd.decompress(data, max_output_size=size)
        if name == "lz4":
            records: bytes = lz4.frame.decompress(data)
            return records
        if name:
            raise ValueError(f"it is compressed by {name!r}, which is not known here")
        return data

    def _describe(self, gaps: list[tuple[int, int]], end: int | None) -> str:
        size, number = len(self._data), self.counts.total()
        parts = [f"bytes {first} to {last} are damaged" for first, last in gaps]
        if end is not None:
            lost = (
                f"the last {size - end} of its {size} bytes are lost" if end < size else "its end is missing"
            )
            parts.append(f"was cut off: {lost}")
        return f"{self.path} {'; '.join(parts)}; {number} messages can be read"


def _open(path: Path) -> mmap.mmap:
    try:
        with path.open("rb") as stream:
            if path.suffix != COMPRESSED_SUFFIX:
                return mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
            with tempfile.TemporaryFile() as whole:
                zstandard.ZstdDecompressor().copy_stream(stream, whole)
                whole.flush()
                return mmap.mmap(whole.fileno(), 0, access=mmap.ACCESS_READ)
    except zstandard.ZstdError as error:
        raise BagError(f"{path} cannot be decompressed: {error}") from error
    except OSError as error:
        raise BagError(f"cannot open {path}: {error.strerror}") from error
    except ValueError as error:  # an empty file cannot be mapped
        raise BagError(f"{path} is empty: nothing was recorded") from error
