"""Messages of a topic as numpy arrays: one row for each message.

Messages of one constant layout, as those of the control loop have, are viewed where they lie and never decoded one
by one. Messages of other layouts among them are decoded by the definition in the bag and put into the same
rows.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspr_msgs_py.bag.message_block import MessageBlock
from cspr_msgs_py.wire.cdr import NANOSECONDS, Frame
from cspr_msgs_py.wire.joint_state import FIELDS, JointStateCodec
from cspr_msgs_py.wire.message_values import nanoseconds, quaternion, vector
from cspr_msgs_py.wire.reference import VECTORS, ReferenceCodec
from cspr_msgs_py.wire.stamped_doubles import INERTIA, POSE, StampedDoublesCodec

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

    def __init__(self, blocks: Iterable[MessageBlock], capacity: int, codec_of: Callable[[bytes], Frame]):
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

    def _begin(self, block: MessageBlock, capacity: int, codec_of: Callable[[bytes], Frame]) -> None:
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
            stamps[row] = nanoseconds(message.header.stamp)
        return stamps

    def doubles(self, widths: Mapping[str, int], others: Mapping[int, Sequence[float]]) -> list[Floats]:
        """Return columns of doubles (n, width) by name.

        Parameters
        ----------
        widths
            Their names in the layout, and how many doubles each has.
        others
            Of the messages of other layouts, by their row: all these doubles one after the other.
        """
        number = len(self.log_time_ns)
        columns = [self.columns.get(name, np.empty((number, width))) for name, width in widths.items()]
        ends = np.cumsum(list(widths.values()))[:-1]
        for row, values in others.items():
            for column, part in zip(columns, np.split(np.array(values), ends), strict=True):
                column[row] = part
        return columns


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
        time_from_start[row] = nanoseconds(message.points[0].time_from_start) / NANOSECONDS
    motion = collected.doubles(VECTORS, {row: _motion(message.points[0]) for row, message in others.items()})
    return References(start_ns, collected.stamps(others), collected.log_time_ns, time_from_start, *motion)


def poses(blocks: Iterable[MessageBlock], capacity: int, start_ns: int, decode: Decode) -> Poses:
    """Return PoseStamped messages as columns."""
    collected = Collected(blocks, capacity, lambda data: StampedDoublesCodec.of(data, POSE))
    others = collected.decoded(decode)
    columns = collected.doubles(POSE, {row: _pose(message.pose) for row, message in others.items()})
    return Poses(start_ns, collected.stamps(others), collected.log_time_ns, *columns)


def inertias(blocks: Iterable[MessageBlock], capacity: int, start_ns: int, decode: Decode) -> Inertias:
    """Return InertiaStamped messages as columns."""
    collected = Collected(blocks, capacity, lambda data: StampedDoublesCodec.of(data, INERTIA))
    others = collected.decoded(decode)
    mass, center, _ = collected.doubles(
        INERTIA, {row: _inertia(message.inertia) for row, message in others.items()}
    )
    return Inertias(start_ns, collected.stamps(others), collected.log_time_ns, mass[:, 0], center)


def messages(blocks: Iterable[MessageBlock], capacity: int, start_ns: int, decode: Decode) -> Messages:
    """Return messages of any type, decoded one by one."""
    log_times: list[int] = []
    decoded: list[Any] = []
    for block in blocks:
        log_times += block.log_times.tolist()
        decoded += map(decode, block)
    times = np.array(log_times, dtype=np.int64)
    if decoded and hasattr(decoded[0], "header"):
        stamps = np.array([nanoseconds(message.header.stamp) for message in decoded], dtype=np.int64)
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


def _pose(pose: Any) -> list[float]:
    return vector(pose.position) + quaternion(pose.orientation)


def _motion(point: Any) -> list[float]:
    transform = point.transforms[0]
    motion = vector(transform.translation) + quaternion(transform.rotation)
    for twists in (point.velocities, point.accelerations):  # which a point need not have
        motion += vector(twists[0].linear) + vector(twists[0].angular) if twists else [np.nan] * 6
    return motion


def _inertia(inertia: Any) -> list[float]:
    moments = [inertia.ixx, inertia.ixy, inertia.ixz, inertia.iyy, inertia.iyz, inertia.izz]
    return [inertia.m, *vector(inertia.com), *moments]
