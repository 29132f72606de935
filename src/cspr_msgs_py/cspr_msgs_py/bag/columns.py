"""Messages of a topic as numpy arrays: one row for each message.

Messages of one constant layout, as those of the control loop have, are viewed where they lie and never decoded one
by one. Messages of other layouts among them are decoded by the definition in the bag and put into the same
rows.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from cspr_msgs_py.bag.message_block import MessageBlock
from cspr_msgs_py.wire.cdr import NANOSECONDS
from cspr_msgs_py.wire.joint_state import FIELDS, JointStateCodec
from cspr_msgs_py.wire.reference import ReferenceCodec
from cspr_msgs_py.wire.stamped_doubles import StampedDoublesCodec

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
Decode = Callable[[bytes], Any]

_BATCH: Final = 4096  # messages


@dataclass(frozen=True)
class Samples:
    """All messages of a topic, or those of a range of time.

    Attributes
    ----------
    start_ns : int
        Log time of the first message of the bag, on any topic.
    time_ns, log_time_ns : ndarray, shape (n,)
        Stamp in the message, and when the recorder received it. A message without a header counts as stamped
        when it was received.
    """

    start_ns: int
    time_ns: Times
    log_time_ns: Times

    def __len__(self) -> int:
        return len(self.time_ns)

    @property
    def time(self) -> Floats:
        """Stamps in seconds since the start of the bag, shape (n,): comparable between topics."""
        seconds: Floats = (self.time_ns - self.start_ns) / NANOSECONDS
        return seconds


@dataclass(frozen=True)
class JointStates(Samples):
    """All messages of a JointState topic: n messages of m joints.

    Attributes
    ----------
    names : tuple of str
        In the order of the first message; joints that appear only in later messages come last.
    position, velocity, effort : ndarray, shape (n, m)
        Of shape (n, 0) where no message carries the field; NaN where one does not carry the joint.
    """

    names: tuple[str, ...]
    position: Floats
    velocity: Floats
    effort: Floats


@dataclass(frozen=True)
class References(Samples):
    """All messages of the reference topic; vectors in base.

    Attributes
    ----------
    time_from_start : ndarray, shape (n,)
        Seconds since the trajectory began.
    position, linear_velocity, angular_velocity, linear_acceleration, angular_acceleration : ndarray, shape (n, 3)
    quaternion_xyzw : ndarray, shape (n, 4)
    """

    time_from_start: Floats
    position: Floats
    quaternion_xyzw: Floats
    linear_velocity: Floats
    angular_velocity: Floats
    linear_acceleration: Floats
    angular_acceleration: Floats


@dataclass(frozen=True)
class Poses(Samples):
    """All messages of a PoseStamped topic: position (n, 3), quaternion_xyzw (n, 4)."""

    position: Floats
    quaternion_xyzw: Floats


@dataclass(frozen=True)
class Inertias(Samples):
    """All messages of an InertiaStamped topic: mass (n,), center_of_mass (n, 3)."""

    mass: Floats
    center_of_mass: Floats


@dataclass(frozen=True)
class Messages(Samples):
    """All messages of a topic of any other type, decoded.

    Attributes
    ----------
    messages : list
        Objects with the message's fields as attributes.
    """

    messages: list[Any]

    def column(self, field: str) -> NDArray[Any]:
        """Return a field of every message, such as ``column("status.level")``, as an array of length n.

        Raises
        ------
        AttributeError
            If the messages do not have it.
        """
        return np.array([attrgetter(field)(message) for message in self.messages])


class _Codec(Protocol):
    """A constant layout of messages."""

    @property
    def dtype(self) -> np.dtype[np.void]: ...

    def matches_each(self, records: NDArray[np.uint8]) -> NDArray[np.bool_]: ...


class Collected:
    """The messages of some blocks: times, the columns of one layout, and what does not have it.

    Attributes
    ----------
    log_time_ns : ndarray, shape (n,)
    columns : dict of str to ndarray, shape (n, ...)
        By the names of the layout's dtype; undefined for the messages in `others`.
    others : dict of int to bytes
        Messages of other layouts by their row.
    """

    def __init__(self, blocks: Iterable[MessageBlock], capacity: int, codec_of: Callable[[bytes], _Codec]):
        self.codec: Any = None
        self.columns: dict[str, NDArray[Any]] = {}
        self.others: dict[int, bytes] = {}
        self._waiting = 0  # messages that were copied and not yet examined
        log_times = np.empty(capacity, dtype=np.int64)
        count = 0
        for block in blocks:
            if not count:
                self._begin(block, capacity, codec_of)
            log_times[count : count + len(block)] = block.log_times
            self._add(block, count)
            count += len(block)
        self._flush()
        self.log_time_ns = _shortened(log_times, count)
        self.columns = {name: _shortened(column, count) for name, column in self.columns.items()}

    def _begin(self, block: MessageBlock, capacity: int, codec_of: Callable[[bytes], _Codec]) -> None:
        self._dtype = np.dtype([])
        try:
            self.codec = codec_of(block.data(0))
        except ValueError:  # not of a constant layout at all
            return
        self._dtype = self.codec.dtype
        self.columns = {
            name: np.empty((capacity, *kind.shape), kind.base)
            for name, (kind, *_) in (self._dtype.fields or {}).items()
        }
        # Chunks hold few messages of a topic; many are examined at once.
        self._pending = np.empty(_BATCH, np.dtype((np.void, self._dtype.itemsize)))

    def _add(self, block: MessageBlock, row: int) -> None:
        if self.codec is None:
            self.others.update(enumerate(block, start=row))
            return
        if block.uniform_size == self._dtype.itemsize and len(block) <= _BATCH:
            if self._waiting + len(block) > _BATCH:
                self._flush()
            if not self._waiting:
                self._row = row
            block.copy_to(self._pending[self._waiting : self._waiting + len(block)])
            self._waiting += len(block)
            return
        self._flush()
        fitting = block.sizes == self._dtype.itemsize
        self._put(block.rows(fitting, self._dtype), row + np.flatnonzero(fitting))
        self.others.update((row + index, block.data(index)) for index in np.flatnonzero(~fitting).tolist())

    def _flush(self) -> None:
        if self._waiting:
            rows = self._pending[: self._waiting].view(self._dtype)
            self._put(rows, slice(self._row, self._row + self._waiting))
            self._waiting = 0

    def _put(self, rows: NDArray[Any], where: slice | NDArray[np.int64]) -> None:
        """Put messages of the layout's size into the columns; those of other constants are other layouts."""
        for name, column in self.columns.items():
            column[where] = rows[name]
        raw = rows.view(np.uint8).reshape(len(rows), self._dtype.itemsize)
        matching = self.codec.matches_each(raw)
        if not matching.all():
            numbers = np.arange(where.start, where.stop) if isinstance(where, slice) else where
            for index in np.flatnonzero(~matching).tolist():
                self.others[int(numbers[index])] = raw[index].tobytes()

    def decoded(self, decode: Decode) -> dict[int, Any]:
        """Return the messages of other layouts, decoded."""
        return {row: decode(data) for row, data in self.others.items()}

    def stamps(self, others: dict[int, Any]) -> Times:
        """Return the stamp of each message, ns."""
        stamps = np.empty(len(self.log_time_ns), dtype=np.int64)
        if self.columns:
            stamps[:] = self.columns["seconds"]
            stamps *= NANOSECONDS
            stamps += self.columns["nanoseconds"]
        for row, message in others.items():
            stamps[row] = _nanoseconds(message.header.stamp)
        return stamps

    def doubles(self, name: str, width: int, others: dict[int, Any], values: Callable[[Any], Any]) -> Floats:
        """Return a column of doubles, those of other layouts by `values` of the message; shape (n, width)."""
        column: Floats = self.columns.get(name, np.empty((len(self.log_time_ns), width)))
        for row, message in others.items():
            column[row] = values(message)
        return column


def joint_states(blocks: Iterable[MessageBlock], capacity: int, start_ns: int, decode: Decode) -> JointStates:
    """Return JointState messages as columns; `decode` is for messages of other layouts than the first."""
    collected = Collected(blocks, capacity, JointStateCodec.of)
    others = collected.decoded(decode)
    codec: JointStateCodec | None = collected.codec
    first = codec.names if codec else ()
    names = tuple(dict.fromkeys((*first, *(name for message in others.values() for name in message.name))))
    number = len(collected.log_time_ns)
    places = {name: place for place, name in enumerate(names)}
    fields: dict[str, Floats] = {}
    for field in FIELDS:
        column = collected.columns.get(field, np.empty((number, 0)))
        if any(len(getattr(message, field)) for message in others.values()):
            whole = np.full((number, len(names)), np.nan)
            whole[:, : column.shape[1]] = column
            for row, message in others.items():
                whole[row] = np.nan
                for name, value in zip(message.name, getattr(message, field), strict=False):
                    whole[row, places[name]] = value
            column = whole
        fields[field] = column
    return JointStates(start_ns, collected.stamps(others), collected.log_time_ns, names, **fields)


def references(blocks: Iterable[MessageBlock], capacity: int, start_ns: int, decode: Decode) -> References:
    """Return reference messages as columns: of messages with several points the first one."""
    collected = Collected(blocks, capacity, _reference_codec)
    others = collected.decoded(decode)
    number = len(collected.log_time_ns)
    time_from_start = np.empty(number)
    if collected.columns:
        time_from_start[:] = collected.columns["duration_nanoseconds"]
        time_from_start /= NANOSECONDS
        time_from_start += collected.columns["duration_seconds"]
    for row, message in others.items():
        time_from_start[row] = _nanoseconds(message.points[0].time_from_start) / NANOSECONDS
    pose = collected.doubles("pose", 7, others, lambda message: _transform(message.points[0].transforms[0]))
    twist = collected.doubles("twist", 6, others, lambda message: _twist(message.points[0].velocities))
    acceleration = collected.doubles(
        "acceleration", 6, others, lambda message: _twist(message.points[0].accelerations)
    )
    return References(
        start_ns,
        collected.stamps(others),
        collected.log_time_ns,
        time_from_start,
        pose[:, :3].copy(),
        pose[:, 3:].copy(),
        twist[:, :3].copy(),
        twist[:, 3:].copy(),
        acceleration[:, :3].copy(),
        acceleration[:, 3:].copy(),
    )


def poses(blocks: Iterable[MessageBlock], capacity: int, start_ns: int, decode: Decode) -> Poses:
    """Return PoseStamped messages as columns."""
    collected = Collected(blocks, capacity, lambda data: StampedDoublesCodec.of(data, 7))
    others = collected.decoded(decode)
    values = collected.doubles("values", 7, others, lambda message: _pose(message.pose))
    stamps = collected.stamps(others)
    return Poses(start_ns, stamps, collected.log_time_ns, values[:, :3].copy(), values[:, 3:].copy())


def inertias(blocks: Iterable[MessageBlock], capacity: int, start_ns: int, decode: Decode) -> Inertias:
    """Return InertiaStamped messages as columns."""
    collected = Collected(blocks, capacity, lambda data: StampedDoublesCodec.of(data, 10))
    others = collected.decoded(decode)
    values = collected.doubles("values", 10, others, lambda message: _inertia(message.inertia))
    stamps = collected.stamps(others)
    return Inertias(start_ns, stamps, collected.log_time_ns, values[:, 0].copy(), values[:, 1:4].copy())


def messages(blocks: Iterable[MessageBlock], capacity: int, start_ns: int, decode: Decode) -> Messages:
    """Return messages of any type, decoded one by one."""
    log_times: list[int] = []
    decoded: list[Any] = []
    for block in blocks:
        log_times += block.log_times.tolist()
        decoded += map(decode, block)
    times = np.array(log_times, dtype=np.int64)
    if decoded and hasattr(decoded[0], "header"):
        stamps = np.array([_nanoseconds(message.header.stamp) for message in decoded], dtype=np.int64)
    else:
        stamps = times
    return Messages(start_ns, stamps, times, decoded)


def _reference_codec(data: bytes) -> ReferenceCodec:
    codec = ReferenceCodec()
    if not codec.matches(data):
        raise ValueError("another layout")
    return codec


def _shortened(column: NDArray[Any], count: int) -> NDArray[Any]:
    """Return the first rows of a column, without keeping many more in memory."""
    return column if count == len(column) else column[:count].copy()


def _nanoseconds(stamp: Any) -> int:
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def _vector(vector: Any) -> list[float]:
    return [vector.x, vector.y, vector.z]


def _quaternion(quaternion: Any) -> list[float]:
    return [quaternion.x, quaternion.y, quaternion.z, quaternion.w]


def _pose(pose: Any) -> list[float]:
    return _vector(pose.position) + _quaternion(pose.orientation)


def _transform(transform: Any) -> list[float]:
    return _vector(transform.translation) + _quaternion(transform.rotation)


def _twist(twists: Any) -> list[float]:
    if not twists:  # which a point need not have
        return [np.nan] * 6
    return _vector(twists[0].linear) + _vector(twists[0].angular)


def _inertia(inertia: Any) -> list[float]:
    moments = [inertia.ixx, inertia.ixy, inertia.ixz, inertia.iyy, inertia.iyz, inertia.izz]
    return [inertia.m, *_vector(inertia.com), *moments]
