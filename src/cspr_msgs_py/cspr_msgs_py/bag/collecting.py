"""Messages of a topic, brought from the blocks of a bag into columns.

Messages of one constant layout, as those of the control loop have, are viewed where they lie and never decoded one
by one. Messages of other layouts among them are decoded by the definition in the bag and put into the same
rows.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspr_msgs_py.bag.columns import Floats, Inertias, JointStates, Messages, Poses, References, Times
from cspr_msgs_py.bag.message_block import MessageBlock
from cspr_msgs_py.wire.cdr import NANOSECONDS, Frame
from cspr_msgs_py.wire.joint_state import FIELDS, JointStateCodec
from cspr_msgs_py.wire.message_values import motion, nanoseconds, quaternion, vector
from cspr_msgs_py.wire.reference import VECTORS, ReferenceCodec
from cspr_msgs_py.wire.stamped_doubles import INERTIA, POSE, StampedDoublesCodec

Decode = Callable[[bytes], Any]

_BATCH: Final = 4096  # messages


class Collected:
    """The messages of some blocks: times, the columns of one layout, and what does not have it.

    Attributes
    ----------
    log_time_ns : ndarray, shape (n,)
    columns : dict of str to ndarray, shape (n, ...)
        By the names of the layout's dtype; undefined for the messages in `others`.
    others : dict of int to object
        Messages of other layouts by their row, decoded.
    """

    def __init__(
        self,
        blocks: Iterable[MessageBlock],
        capacity: int,
        codec_of: Callable[[bytes], Frame],
        decode: Decode,
    ) -> None:
        self.codec: Any = None
        self.columns: dict[str, NDArray[Any]] = {}
        self._foreign: dict[int, bytes] = {}
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
        self.others = {row: decode(data) for row, data in self._foreign.items()}

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
            self._foreign.update(enumerate(block, start=row))
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
        self._foreign.update((row + index, block.data(index)) for index in np.flatnonzero(~fitting).tolist())

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
                self._foreign[int(numbers[index])] = raw[index].tobytes()

    @property
    def stamps(self) -> Times:
        """The stamp of each message, ns."""
        stamps = np.empty(len(self.log_time_ns), dtype=np.int64)
        if self.columns:
            stamps[:] = self.columns["seconds"]
            stamps *= NANOSECONDS
            stamps += self.columns["nanoseconds"]
        for row, message in self.others.items():
            stamps[row] = nanoseconds(message.header.stamp)
        return stamps

    def doubles(self, widths: Mapping[str, int], vectors: Callable[[Any], list[list[float]]]) -> list[Floats]:
        """Return columns of doubles (n, width) by name.

        Parameters
        ----------
        widths
            Their names in the layout, and how many doubles each has.
        vectors
            Returns those of a decoded message, in the same order.
        """
        number = len(self.log_time_ns)
        columns = [self.columns.get(name, np.empty((number, width))) for name, width in widths.items()]
        for row, message in self.others.items():
            for column, part in zip(columns, vectors(message), strict=True):
                column[row] = part
        return columns


def joint_states(blocks: Iterable[MessageBlock], capacity: int, start_ns: int, decode: Decode) -> JointStates:
    """Return JointState messages as columns; `decode` is for messages of other layouts than the first."""
    collected = Collected(blocks, capacity, JointStateCodec.of, decode)
    others = collected.others
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
    return JointStates(start_ns, collected.stamps, collected.log_time_ns, names, **fields)


def references(blocks: Iterable[MessageBlock], capacity: int, start_ns: int, decode: Decode) -> References:
    """Return reference messages as columns: of messages with several points the first one."""
    collected = Collected(blocks, capacity, _reference_codec, decode)
    number = len(collected.log_time_ns)
    time_from_start = np.empty(number)
    if collected.columns:
        time_from_start[:] = collected.columns["duration_nanoseconds"]
        time_from_start /= NANOSECONDS
        time_from_start += collected.columns["duration_seconds"]
    for row, message in collected.others.items():
        time_from_start[row] = nanoseconds(message.points[0].time_from_start) / NANOSECONDS
    columns = collected.doubles(VECTORS, lambda message: motion(message.points[0], 0))
    return References(start_ns, collected.stamps, collected.log_time_ns, time_from_start, *columns)


def poses(blocks: Iterable[MessageBlock], capacity: int, start_ns: int, decode: Decode) -> Poses:
    """Return PoseStamped messages as columns."""
    collected = Collected(blocks, capacity, lambda data: StampedDoublesCodec.of(data, POSE), decode)
    columns = collected.doubles(
        POSE, lambda message: [vector(message.pose.position), quaternion(message.pose.orientation)]
    )
    return Poses(start_ns, collected.stamps, collected.log_time_ns, *columns)


def inertias(blocks: Iterable[MessageBlock], capacity: int, start_ns: int, decode: Decode) -> Inertias:
    """Return InertiaStamped messages as columns."""
    collected = Collected(blocks, capacity, lambda data: StampedDoublesCodec.of(data, INERTIA), decode)
    mass, center, _ = collected.doubles(INERTIA, lambda message: _inertia(message.inertia))
    return Inertias(start_ns, collected.stamps, collected.log_time_ns, mass[:, 0], center)


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


def _inertia(inertia: Any) -> list[list[float]]:
    moments = [inertia.ixx, inertia.ixy, inertia.ixz, inertia.iyy, inertia.iyz, inertia.izz]
    return [[inertia.m], vector(inertia.com), moments]
