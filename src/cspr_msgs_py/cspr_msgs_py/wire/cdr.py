"""Constant byte templates of messages in CDR, the wire format of ROS 2.

A message whose names and sequence lengths never change is, on the wire, a constant :class:`Frame` in which only the
stamp and some blocks of numbers change, always at the same offsets. :class:`Template` lays such a message out
by the rules of plain CDR, little-endian (OMG DDSI-RTPS 2.5, section 10, and CORBA 3.3 part 2, section 9.3):
four bytes of encapsulation header, then each primitive aligned to its own size, counted from the end of
that header.

Bytes that only fill up to an alignment have no meaning. Encoding writes zeros there; other writers leave
stale memory, so decoding does not look at them.
"""

import struct
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspr_msgs_py.errors import MessageError

ENCAPSULATION: Final = b"\x00\x01\x00\x00"  # plain CDR, little-endian, no options
NANOSECONDS: Final = 1_000_000_000
LATEST_TIME: Final = 2**31 * NANOSECONDS - 1
"""Latest time that fits a message, ns: its seconds have 32 bits."""

Bytes = bytes | bytearray | memoryview

_STAMP: Final = struct.Struct("<iI")


def pack_time(nanoseconds: int) -> bytes:
    """Return a ``builtin_interfaces`` Time or Duration.

    Raises
    ------
    ValueError
        If the seconds do not fit the 32 bits that the message has for them.
    """
    seconds, rest = divmod(nanoseconds, NANOSECONDS)
    try:
        return _STAMP.pack(seconds, rest)
    except struct.error:
        raise ValueError(f"{nanoseconds} ns does not fit a message: its seconds have 32 bits") from None


def unpack_time(buffer: Bytes, offset: int) -> int:
    """Return the nanoseconds of the Time or Duration at `offset` of `buffer`.

    Raises
    ------
    MessageError
        If it has a second's worth of nanoseconds or more beside its seconds.
    """
    seconds, rest = _STAMP.unpack_from(buffer, offset)
    return whole_time(seconds, rest)


def whole_time(seconds: int, rest: int) -> int:
    """Return seconds and nanoseconds of a message as nanoseconds; raises MessageError as `unpack_time` does."""
    if rest >= NANOSECONDS:
        raise MessageError(
            f"a time has {rest} nanoseconds beside its seconds; {NANOSECONDS - 1} are the most"
        )
    return int(seconds) * NANOSECONDS + int(rest)


class Writer:
    """Writes a message piece by piece."""

    def __init__(self) -> None:
        self._data = bytearray(ENCAPSULATION)

    def _append(self, data: bytes, alignment: int) -> None:
        self._data += bytes(-(len(self._data) - len(ENCAPSULATION)) % alignment) + data

    def byte(self, number: int) -> None:
        """Append an unsigned integer of 8 bits."""
        self._append(bytes([number]), 1)

    def count(self, number: int) -> None:
        """Append an unsigned integer of 32 bits: the length of a sequence."""
        self._append(struct.pack("<I", number), 4)

    def string(self, text: str) -> None:
        """Append a string: its length with the final zero, its bytes, the zero."""
        data = text.encode() + b"\x00"
        self._append(struct.pack("<I", len(data)) + data, 4)

    def time(self, nanoseconds: int) -> None:
        """Append a Time or Duration; raises ValueError where it does not fit."""
        self._append(pack_time(nanoseconds), 4)

    def finish(self) -> bytes:
        """Return the message."""
        return bytes(self._data)


class Template(Writer):
    """The constants of a layout as they are written, and between them places for numbers that change.

    Attributes
    ----------
    constants : list of (int, int)
        Where they begin and end; those that touch one another joined, none of the padding.
    places : list of (int, int)
        Where the numbers begin and end.
    fields : dict of str to (type, int)
        numpy's type and the offset of the numbers, by name.
    """

    def __init__(self) -> None:
        super().__init__()
        self.constants = [(0, len(ENCAPSULATION))]
        self.places: list[tuple[int, int]] = []
        self.fields: dict[str, tuple[Any, int]] = {}

    def _append(self, data: bytes, alignment: int) -> None:
        before = len(self._data)
        super()._append(data, alignment)
        start, end = len(self._data) - len(data), len(self._data)
        if start == before == self.constants[-1][1]:
            start = self.constants.pop()[0]
        self.constants.append((start, end))

    def _place(self, size: int, alignment: int) -> int:
        super()._append(bytes(size), alignment)
        self.places.append((len(self._data) - size, len(self._data)))
        return self.places[-1][0]

    def place_time(self, prefix: str = "") -> int:
        """Append the place of a Time or Duration, fields ``seconds`` and ``nanoseconds``; return its offset."""
        offset = self._place(8, alignment=4)
        self.fields |= {f"{prefix}seconds": ("<i4", offset), f"{prefix}nanoseconds": ("<u4", offset + 4)}
        return offset

    def place_doubles(self, name: str, count: int) -> int:
        """Append the place of some doubles; return the offset of the first."""
        offset = self._place(8 * count, alignment=8)
        self.fields[name] = (("<f8", (count,)), offset)
        return offset


class Frame:
    """Messages of one constant layout: joins blocks of numbers into one, and recognises them.

    Attributes
    ----------
    size : int
        Bytes of every message.
    dtype : numpy.dtype
        Structured type of one message, to view many joined ones as columns; its fields are those of the template.
    """

    def __init__(self, template: Template) -> None:
        data = template.finish()
        self.size = len(data)
        ends = [0, *(end for _, end in template.places)]
        starts = [*(start for start, _ in template.places), self.size]
        self._parts = [b""] * (2 * len(ends) - 1)  # constants with their padding, and between them the blocks
        self._parts[::2] = [data[end:start] for end, start in zip(ends, starts, strict=True)]
        self._constants = tuple(data[start:end] for start, end in template.constants)
        self._places = [
            (start, np.frombuffer(data[start:end], np.uint8)) for start, end in template.constants
        ]
        check, before = "<", 0
        for start, end in template.constants:
            check += f"{start - before}x{end - start}s"
            before = end
        self._check = struct.Struct(f"{check}{self.size - before}x")
        formats, offsets = zip(*template.fields.values(), strict=True)
        self.dtype: np.dtype[np.void] = np.dtype(
            {"names": list(template.fields), "formats": formats, "offsets": offsets, "itemsize": self.size}
        )

    def join(self, *blocks: bytes) -> bytes:
        """Return the message with these blocks of numbers, in the order of their places."""
        parts = self._parts.copy()
        parts[1 : 2 * len(blocks) : 2] = blocks
        return b"".join(parts)

    def matches(self, buffer: Bytes) -> bool:
        """Return whether `buffer` has the length and the constants of this layout."""
        return len(buffer) == self.size and self._check.unpack(buffer) == self._constants

    def matches_each(self, records: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return for each of many messages of this size, shape (n, size), whether it has the constants."""
        matching = np.ones(len(records), dtype=bool)
        for offset, constant in self._places:
            equal = records[:, offset : offset + len(constant)] == constant
            if not equal.all():  # which is rare, and much faster to check for all than for each
                matching &= equal.all(axis=1)
        return matching


class Scanner:
    """Walks through a message of unknown layout, to find the constants for its template.

    All methods raise ValueError where the bytes end early or cannot be what they are read as.
    """

    def __init__(self, buffer: Bytes) -> None:
        self._buffer = bytes(buffer)
        self._offset = len(ENCAPSULATION)
        if not self._buffer.startswith(ENCAPSULATION):
            raise ValueError(f"{len(self._buffer)} bytes are not little-endian CDR")

    def _take(self, size: int, alignment: int) -> bytes:
        start = self._offset + -(self._offset - len(ENCAPSULATION)) % alignment
        if start + size > len(self._buffer):
            raise ValueError(f"message of {len(self._buffer)} bytes ends early")
        self._offset = start + size
        return self._buffer[start : self._offset]

    def count(self) -> int:
        """Read the length of a sequence."""
        return int.from_bytes(self._take(4, alignment=4), "little")

    def string(self) -> str:
        """Read a string."""
        data = self._take(self.count(), alignment=1)
        if not data.endswith(b"\x00"):
            raise ValueError("a string in the message has no end")
        return data[:-1].decode()

    def byte(self) -> int:
        """Read an unsigned integer of 8 bits, or a bool."""
        return self._take(1, alignment=1)[0]

    def integer(self) -> int:
        """Read a signed integer of 64 bits."""
        return int.from_bytes(self._take(8, alignment=8), "little", signed=True)

    def double(self) -> float:
        """Read a double."""
        value: float = struct.unpack("<d", self._take(8, alignment=8))[0]
        return value

    def time(self) -> int:
        """Read a Time or Duration, ns."""
        return unpack_time(self._take(8, alignment=4), 0)

    def skip_doubles(self) -> int:
        """Pass over a sequence of doubles and return its length."""
        count = self.count()
        if count:
            self._take(8 * count, alignment=8)
        return count
