"""sensor_msgs/JointState of constant names as raw CDR.

The hot topics of the graph carry one JointState a cycle. Building message objects costs more than the
control law; here a message is a constant frame with the stamp and the doubles at fixed offsets. The bytes
are those of an ordinary publisher, so any ROS 2 tool reads them. A message in another layout is not decoded
here but by :func:`cspr_msgs_py.wire.conversion.decode_joint_state`.
"""

import math
import struct
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_msgs_py.wire.cdr import Bytes, Frame, Scanner, Template, pack_time, unpack_time

FIELDS: Final = ("position", "velocity", "effort")

_DOUBLE: Final = np.dtype("<f8")
_ONE_DOUBLE: Final = struct.Struct("<d").unpack_from
_PACK_DOUBLE: Final = struct.Struct("<d").pack
_NONE: Final[NDArray[np.float64]] = np.empty(0)
_NONE.flags.writeable = False


class JointStateSample(NamedTuple):
    """One JointState without its names.

    Attributes
    ----------
    stamp_ns : int
        ``header.stamp`` in nanoseconds.
    position, velocity, effort : ndarray, shape (m,)
        Read-only; of shape (0,) when the message does not carry the field. Radians, rad/s and N m for motors,
        effort in N for cables.
    """

    stamp_ns: int
    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
    effort: NDArray[np.float64]


class JointSample(NamedTuple):
    """One joint of a JointState: stamp in ns, then rad, rad/s and N m; NaN for what it does not carry."""

    stamp_ns: int
    position: float
    velocity: float
    effort: float


class JointStateCodec(Frame):
    """Encodes and decodes JointState messages of one layout.

    Parameters
    ----------
    names : sequence of str
        ``name`` of every message; its length m is the length of every field.
    frame_id : str
        ``header.frame_id`` of every message.
    position, velocity, effort : bool
        Whether the message carries this field; a field that it does not carry is an empty sequence.
    """

    def __init__(
        self,
        names: Sequence[str],
        frame_id: str = "",
        position: bool = True,
        velocity: bool = True,
        effort: bool = True,
    ) -> None:
        if isinstance(names, str):
            raise TypeError(f"names must be a sequence of names, not the single string {names!r}")
        self.names = tuple(names)
        self.frame_id = frame_id
        self.fields = tuple(
            field for field, carried in zip(FIELDS, (position, velocity, effort), strict=True) if carried
        )
        self._shape = (len(self.names),)
        template = Template()
        self._stamp_offset = template.place_time()
        template.string(frame_id)
        template.count(len(self.names))
        for name in self.names:
            template.string(name)
        offsets: dict[str, int] = {}
        for field in FIELDS:
            carried = field in self.fields and bool(self.names)
            template.count(len(self.names) if carried else 0)
            if carried:
                offsets[field] = template.place_doubles(field, len(self.names))
        super().__init__(template)
        self._offsets = offsets
        self._field_offsets = tuple(offsets.get(field) for field in FIELDS)

    def encode(
        self,
        stamp_ns: int,
        position: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        effort: ArrayLike | None = None,
    ) -> bytes:
        """Return the message as CDR.

        Raises
        ------
        ValueError
            If a field is missing, is one that this layout does not carry, or has another length than the
            names; or if the stamp does not fit the message.
        """
        blocks = [pack_time(stamp_ns)]
        for field, values in (("position", position), ("velocity", velocity), ("effort", effort)):
            if values is not None:
                blocks.append(self._block(field, values))
            elif field in self._offsets:
                raise ValueError(f"a message of this layout carries {field}, and none is given")
        return self.join(*blocks)

    def encode_joint(self, joint: JointSample) -> bytes:
        """Return the message of the one joint that a layout with one name has; raises ValueError as `encode` does."""
        if self._shape != (1,):
            raise ValueError(f"the message has {len(self.names)} names: {', '.join(self.names)}")
        blocks = (_PACK_DOUBLE(getattr(joint, field)) for field in self._offsets)
        return self.join(pack_time(joint.stamp_ns), *blocks)

    def encode_sample(self, sample: JointStateSample) -> bytes:
        """Return the message as CDR; raises ValueError as `encode` does."""
        blocks = (self._block(field, getattr(sample, field)) for field in self._offsets)
        return self.join(pack_time(sample.stamp_ns), *blocks)

    def _block(self, field: str, values: ArrayLike) -> bytes:
        array = np.asarray(values, dtype=_DOUBLE)
        if field not in self.fields:
            raise ValueError(f"a message of this layout does not carry {field}")
        if array.shape != self._shape or not self.names:
            raise ValueError(
                f"{field} has shape {array.shape}, the message has {len(self.names)} names: {', '.join(self.names)}"
            )
        return array.tobytes()

    def decode(self, buffer: Bytes) -> JointStateSample | None:
        """Return what a message carries, or None when `buffer` has another layout.

        Another layout is: another length, other names, another ``frame_id``, another byte order, a frame cut
        short, or trailing bytes.
        """
        if not self.matches(buffer):
            return None
        data = buffer if isinstance(buffer, bytes) else bytes(buffer)  # arrays over bytes are read-only
        position, velocity, effort = self._field_offsets
        count = len(self.names)
        return JointStateSample(
            unpack_time(data, self._stamp_offset),
            _NONE if position is None else np.frombuffer(data, _DOUBLE, count, position),
            _NONE if velocity is None else np.frombuffer(data, _DOUBLE, count, velocity),
            _NONE if effort is None else np.frombuffer(data, _DOUBLE, count, effort),
        )

    def decode_joint(self, buffer: Bytes) -> JointSample | None:
        """Return the first joint of a message, NaN for fields that it does not carry, or None for another layout.

        It costs half of `decode`, and the commands of the motors are of one joint each.
        """
        if not self.matches(buffer):
            return None
        position, velocity, effort = self._field_offsets
        return JointSample(
            unpack_time(buffer, self._stamp_offset),
            math.nan if position is None else _ONE_DOUBLE(buffer, position)[0],
            math.nan if velocity is None else _ONE_DOUBLE(buffer, velocity)[0],
            math.nan if effort is None else _ONE_DOUBLE(buffer, effort)[0],
        )

    @classmethod
    def of(cls, buffer: Bytes) -> "JointStateCodec":
        """Return the codec for messages of the layout that `buffer` has.

        Raises
        ------
        ValueError
            If it is not a whole JointState in little-endian CDR with as many values as names.
        """
        scanner = Scanner(buffer)
        scanner.time()
        frame_id = scanner.string()
        names = [scanner.string() for _ in range(scanner.count())]
        lengths = [scanner.skip_doubles() for _ in FIELDS]
        codec = cls(names, frame_id, *(bool(length) for length in lengths))
        if not codec.matches(buffer):
            raise ValueError(
                f"{len(buffer)} bytes are not a JointState with one value for each name: {len(names)} names, "
                f"{', '.join(f'{length} x {field}' for field, length in zip(FIELDS, lengths, strict=True))}"
            )
        return codec
