"""Constant byte templates of messages in CDR, the wire format of ROS 2.

A message whose names and sequence lengths never change is, on the wire, a constant frame in which only the
stamp and some blocks of numbers change, always at the same offsets. :class:`Template` lays such a frame out
by the rules of plain CDR, little-endian (OMG DDSI-RTPS 2.5, section 10, and CORBA 3.3 part 2, section 9.3):
four bytes of encapsulation header, then each primitive aligned to its own size, counted from the end of
that header.

Bytes that only fill up to an alignment have no meaning. Encoding writes zeros there; other writers leave
stale memory, so decoding does not look at them.
"""

import re
import struct
from typing import Final

import numpy as np
from numpy.typing import NDArray

ENCAPSULATION: Final = b"\x00\x01\x00\x00"  # plain CDR, little-endian, no options
NANOSECONDS: Final = 1_000_000_000

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
    """Return the nanoseconds of the Time or Duration at `offset` of `buffer`."""
    seconds, rest = _STAMP.unpack_from(buffer, offset)
    return int(seconds) * NANOSECONDS + int(rest)


class Template:
    """A frame under construction: constants, blocks of numbers, and the alignment between them."""

    def __init__(self) -> None:
        self._pieces = [bytearray()]  # constants with their padding; between two pieces lies a block
        self._constants: list[bytes] = []  # those that touch one another joined
        self._check = "<"  # of the message, up to the constant that may still grow
        self._touching = False
        self._size = 0
        self._append(ENCAPSULATION)

    def _align(self, alignment: int) -> None:
        padding = -(self._size - len(ENCAPSULATION)) % alignment
        if padding:
            self._pieces[-1] += bytes(padding)
            self._pass_over(padding)

    def _append(self, data: bytes) -> None:
        self._pieces[-1] += data
        if self._touching:
            self._constants[-1] += data
        else:
            self._constants.append(data)
        self._touching = True
        self._size += len(data)

    def _pass_over(self, size: int) -> None:
        if self._touching:
            self._check += f"{len(self._constants[-1])}s"
        self._touching = False
        self._check += f"{size}x"
        self._size += size

    def count(self, number: int) -> None:
        """Append a constant unsigned integer of 32 bits: the length of a sequence."""
        self._align(4)
        self._append(struct.pack("<I", number))

    def string(self, text: str) -> None:
        """Append a constant string: its length with the final zero, its bytes, the zero."""
        data = text.encode() + b"\x00"
        self.count(len(data))
        self._append(data)

    def time(self) -> int:
        """Append the place of a Time or Duration; return its offset."""
        return self._block(8, alignment=4)

    def doubles(self, count: int) -> int:
        """Append the place of `count` doubles; return the offset of the first."""
        return self._block(8 * count, alignment=8)

    def _block(self, size: int, alignment: int) -> int:
        self._align(alignment)
        offset = self._size
        self._pieces.append(bytearray())
        self._pass_over(size)
        return offset

    def finish(self) -> "Frame":
        """Return the finished frame."""
        self._pass_over(0)
        return Frame(tuple(bytes(piece) for piece in self._pieces), self._check, tuple(self._constants))


class Frame:
    """A finished template: joins blocks of numbers into a message and recognises its own messages."""

    __slots__ = ("_check", "_constants", "_pieces", "_places", "size")

    def __init__(self, pieces: tuple[bytes, ...], check: str, constants: tuple[bytes, ...]) -> None:
        self._pieces = pieces
        self._check = struct.Struct(check)
        self._constants = constants
        self._places = _places(check, constants)
        self.size = self._check.size

    def encode(self, *blocks: bytes) -> bytes:
        """Return the message with these blocks of numbers, in the order in which they were announced."""
        parts = list(self._pieces)
        for index, block in enumerate(blocks):
            parts[index] += block
        return b"".join(parts)

    def matches(self, buffer: Bytes) -> bool:
        """Return whether `buffer` has the length and the constants of this frame."""
        return len(buffer) == self.size and self._check.unpack(buffer) == self._constants

    def matches_each(self, records: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return for each of many messages of this size, shape (n, size), whether it has the constants."""
        matching = np.ones(len(records), dtype=bool)
        for offset, constant in self._places:
            equal = records[:, offset : offset + len(constant)] == constant
            if not equal.all():  # which is rare, and much quicker asked of all than of each
                matching &= equal.all(axis=1)
        return matching


def _places(check: str, constants: tuple[bytes, ...]) -> list[tuple[int, NDArray[np.uint8]]]:
    """Return the constants and where they stand."""
    places: list[tuple[int, NDArray[np.uint8]]] = []
    remaining = iter(constants)
    offset = 0
    for size, kind in re.findall(r"(\d+)([sx])", check):
        if kind == "s":
            places.append((offset, np.frombuffer(next(remaining), np.uint8)))
        offset += int(size)
    return places


class Writer:
    """Writes a message of varying length, piece by piece."""

    def __init__(self) -> None:
        self._data = bytearray(ENCAPSULATION)

    def _append(self, data: bytes, alignment: int) -> None:
        self._data += bytes(-(len(self._data) - len(ENCAPSULATION)) % alignment) + data

    def byte(self, number: int) -> None:
        """Append an unsigned integer of 8 bits."""
        self._append(bytes([number]), 1)

    def count(self, number: int) -> None:
        """Append the length of a sequence."""
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
