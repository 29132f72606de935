"""Messages that are a header followed by doubles, as raw CDR.

PoseStamped has seven of them (position, quaternion), InertiaStamped ten (mass, centre, moments of inertia).
"""

from typing import Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_msgs_py.wire.cdr import Bytes, Scanner, Template, pack_time

_DOUBLE: Final = np.dtype("<f8")


class StampedDoublesCodec:
    """The constant layout of a header with this ``frame_id`` and `number` doubles behind it."""

    def __init__(self, frame_id: str, number: int) -> None:
        template = Template()
        self._stamp_offset = template.time()
        template.string(frame_id)
        self._values_offset = template.doubles(number)
        self._number = number
        self._frame = template.finish()

    @classmethod
    def of(cls, buffer: Bytes, number: int) -> "StampedDoublesCodec":
        """Return the codec for messages of the layout that `buffer` has.

        Raises
        ------
        ValueError
            If it is not a header and `number` doubles in little-endian CDR.
        """
        scanner = Scanner(buffer)
        scanner.time()
        codec = cls(scanner.string(), number)
        if not codec.matches(buffer):
            raise ValueError(f"{len(buffer)} bytes are not a header and {number} doubles")
        return codec

    def encode(self, stamp_ns: int, values: ArrayLike) -> bytes:
        """Return the message as CDR.

        Raises
        ------
        ValueError
            If there are not as many values as the layout has, or the stamp does not fit the message.
        """
        array = np.asarray(values, dtype=_DOUBLE)
        if array.shape != (self._number,):
            raise ValueError(f"the message has {self._number} doubles after its header, not {array.shape}")
        return self._frame.encode(pack_time(stamp_ns), array.tobytes())

    def matches(self, buffer: Bytes) -> bool:
        """Return whether `buffer` is a message of this layout."""
        return self._frame.matches(buffer)

    def matches_each(self, records: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return for each of many messages of this layout's size, shape (n, size), whether it has the layout."""
        return self._frame.matches_each(records)

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Structured type of one message: ``seconds``, ``nanoseconds`` and ``values``."""
        offset = self._stamp_offset
        return np.dtype(
            {
                "names": ["seconds", "nanoseconds", "values"],
                "formats": ["<i4", "<u4", (_DOUBLE, (self._number,))],
                "offsets": [offset, offset + 4, self._values_offset],
                "itemsize": self._frame.size,
            }
        )
