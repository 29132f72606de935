"""Messages of one chunk of an MCAP file, viewed where they lie among its records."""

from collections.abc import Callable, Collection, Iterator
from typing import Any, Final

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

# The record of a message as it stands in the file, up to its data. MCAP specification, "Message".
_HEAD: Final = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),  # of what follows this number
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
_LENGTH_END: Final = 9  # bytes of a record up to the end of its length
_BEGIN: Final = _LENGTH_END + 2  # ... up to the end of its channel
_OVERHEAD: Final = _HEAD.itemsize - _LENGTH_END
_MESSAGE: Final = int(Opcode.MESSAGE)


class MessageBlock:
    """Some messages of one chunk, in the order in which they were written.

    Parameters
    ----------
    records : ndarray of uint8
        The chunk without compression.
    offsets : ndarray of int, shape (n,)
        Where the records of the messages begin.

    Attributes
    ----------
    uniform_size : int or None
        Bytes of data of every message, if they are all of one channel and size.

    Raises
    ------
    ValueError
        If there is no whole message at one of the offsets.
    """

    def __init__(self, records: NDArray[np.uint8], offsets: NDArray[np.int64]) -> None:
        self._records = records
        self._offsets = offsets
        self.uniform_size: int | None = None
        self._step = 0  # bytes between two messages that follow one another without anything between
        chain = self._chain() if len(offsets) > 1 else None
        self._heads: NDArray[np.void] = _take(records, offsets, _HEAD) if chain is None else chain
        if chain is not None or not len(offsets):
            return
        heads = self._heads
        # Nearly always all messages are of one topic and size: then one comparison checks all of them.
        if _alike(heads.view(np.uint8).reshape(len(heads), _HEAD.itemsize)):
            opcode, length = int(heads["opcode"][0]), int(heads["length"][0])
            right = opcode == _MESSAGE and length >= _OVERHEAD
            inside = int(offsets.max()) + _LENGTH_END + length <= len(records)
            self.uniform_size = length - _OVERHEAD
        else:
            right = bool((heads["opcode"] == _MESSAGE).all() and (self.sizes >= 0).all())
            inside = bool((offsets + _HEAD.itemsize + self.sizes <= len(records)).all())
        if not (right and inside):
            raise ValueError("the index of a chunk does not point to a message")

    def _chain(self) -> NDArray[np.void] | None:
        """Return the heads, viewed and not copied, if the messages are alike and follow one another directly."""
        offsets, number = self._offsets, len(self._offsets)
        first, step = int(offsets[0]), int(offsets[1]) - int(offsets[0])
        if (
            first < 0
            or step < _HEAD.itemsize
            or int(offsets[-1]) != first + (number - 1) * step
            or first + number * step > len(self._records)
        ):
            return None
        heads: NDArray[np.void] = np.ndarray((number,), _HEAD, self._records, first, (step,))
        opcode, length, *_ = heads[0].item()
        # a head equal to the first one leads to the next message: the index need not be trusted
        if opcode != _MESSAGE or _LENGTH_END + length != step:
            return None
        if not _alike(np.ndarray((number, _BEGIN), np.uint8, self._records, first, (step, 1))):
            return None
        self._step, self.uniform_size = step, length - _OVERHEAD
        return heads

    @property
    def sizes(self) -> NDArray[np.int64]:
        """Bytes of data of each message, shape (n,)."""
        sizes: NDArray[np.int64] = self._heads["length"].astype(np.int64) - _OVERHEAD
        return sizes

    @property
    def log_times(self) -> NDArray[np.int64]:
        """When each message was received, ns, shape (n,)."""
        return self._heads["log_time"].astype(np.int64)

    def only_of(self, channels: Collection[int]) -> bool:
        """Return whether all messages are of these channels."""
        if self.uniform_size is not None:
            return int(self._heads["channel"][0]) in channels
        return bool(np.isin(self._heads["channel"], list(channels)).all())

    def __len__(self) -> int:
        return len(self._offsets)

    def __iter__(self) -> Iterator[bytes]:
        """Yield the data of each message."""
        view = memoryview(self._records)
        starts = (self._offsets + _HEAD.itemsize).tolist()
        for start, size in zip(starts, self.sizes.tolist(), strict=True):
            yield bytes(view[start : start + size])

    def messages(self) -> Iterator[tuple[int, int, int, int, bytes]]:
        """Return channel, sequence number, log time (ns), publish time (ns) and data of each message."""
        fields = (self._heads[name].tolist() for name in ("channel", "sequence", "log_time", "publish_time"))
        return zip(*fields, self, strict=True)

    def data(self, index: int) -> bytes:
        """Return the data of one message."""
        start = int(self._offsets[index]) + _HEAD.itemsize
        return self._records[start : start + int(self.sizes[index])].tobytes()

    def rows(self, selected: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
        """Return the data of the selected messages, all of the size of `dtype`, as an array of it."""
        return _take(self._records, self._offsets[selected] + _HEAD.itemsize, dtype)

    def copy_to(self, rows: NDArray[np.void]) -> None:
        """Copy the data of all messages into `rows`, shape (n,), whose items are of their uniform size."""
        if self._step:
            start = int(self._offsets[0]) + _HEAD.itemsize
            rows[:] = np.ndarray((len(self),), rows.dtype, self._records, start, (self._step,))
        else:
            rows[:] = _windows(self._records, rows.dtype)[self._offsets + _HEAD.itemsize]

    def selected(self, mask: NDArray[np.bool_]) -> "MessageBlock":
        """Return the block of those messages for which `mask` is true."""
        return self if mask.all() else MessageBlock(self._records, self._offsets[mask])

    def mapped(self, change: Callable[[bytes], bytes]) -> "MessageBlock":
        """Return the block with each message's data put through `change`."""
        parts, offsets, end = [], [], 0
        for *head, data in self.messages():
            changed = change(data)
            row = np.array((_MESSAGE, _OVERHEAD + len(changed), *head), _HEAD)
            parts += [row.tobytes(), changed]
            offsets.append(end)
            end += _HEAD.itemsize + len(changed)
        return MessageBlock(np.frombuffer(b"".join(parts), np.uint8), np.array(offsets, dtype=np.int64))


def message_offsets(records: NDArray[np.uint8], channels: Collection[int]) -> NDArray[np.int64]:
    """Return where the messages of some channels begin, by walking through all records."""
    offsets = []
    for opcode, start, content in walk(records):
        if opcode == _MESSAGE and int.from_bytes(content[:2], "little") in channels:
            offsets.append(start)
    return np.array(offsets, dtype=np.int64)


def walk(records: NDArray[np.uint8]) -> Iterator[tuple[int, int, memoryview]]:
    """Yield opcode, offset and content of the records that follow one another."""
    view = memoryview(records)
    offset = 0
    while offset + _LENGTH_END <= len(view):
        length = int.from_bytes(view[offset + 1 : offset + _LENGTH_END], "little")
        end = offset + _LENGTH_END + length
        if end > len(view):
            raise ValueError("a record is longer than its chunk")
        yield view[offset], offset, view[offset + _LENGTH_END : end]
        offset = end


def _take(records: NDArray[np.uint8], offsets: NDArray[np.int64], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Copy items of `dtype` from any byte offsets.

    Raises
    ------
    ValueError
        If one of them lies outside.
    """
    if not len(offsets):
        return np.empty(0, dtype)
    raw = np.dtype((np.void, dtype.itemsize))  # copied as a whole, not field by field
    try:
        return _windows(records, raw)[offsets].view(dtype)
    except IndexError as error:
        raise ValueError("a message lies outside its chunk") from error


def _alike(heads: NDArray[np.uint8]) -> bool:
    """Return whether opcode, length and channel, at the beginning of each row, are the same in all rows."""
    begins = heads[:, :_BEGIN]
    return bool((begins == begins[0]).all())


def _windows(records: NDArray[np.uint8], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return a view of the items of `dtype` that begin at each byte."""
    return np.ndarray((max(len(records) - dtype.itemsize + 1, 0),), dtype, records, strides=(1,))
