"""PDO parameters of an emulated device: what a master may write to them, and the PDOs that result.

Sources: CiA 301, sections 7.5.2.35 to 7.5.2.38 (communication and mapping parameters, and the order in which
a mapping is changed: PDO invalid, number of objects zero, the objects, their number, PDO valid).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from canopen import ObjectDictionary
from canopen.objectdictionary import SIGNED_TYPES, ODVariable
from canopen.sdo import SdoAbortedError

from cspr_drivers.canopen.frame_table import MappedObject, PdoLayout, TransmissionType
from cspr_drivers.simulation.devices.canopen_codes import SdoAbort

_INVALID = 1 << 31
_EXTENDED = 1 << 29
_CAN_ID = 0x7FF

# CAN-IDs that no PDO may take (CiA 301, section 7.3.5), as closed intervals.
_RESTRICTED_IDS = (
    (0x000, 0x0FF),
    (0x101, 0x180),
    (0x581, 0x5FF),
    (0x601, 0x67F),
    (0x6E0, 0x6FF),
    (0x701, 0x7FF),
)


class Direction(Enum):
    """Direction of a PDO as the device sees it; the value: bases of its communication and mapping parameters."""

    RECEIVE = (0x1400, 0x1600)
    TRANSMIT = (0x1800, 0x1A00)


# What these devices offer of what CiA 301 allows.
_TRANSMISSION_TYPES = {
    Direction.RECEIVE: (TransmissionType.EVENT_DRIVEN,),
    Direction.TRANSMIT: (TransmissionType.EVERY_SYNC, TransmissionType.EVENT_DRIVEN),
}


@dataclass(frozen=True)
class ActivePdo:
    """A valid PDO with at least one object.

    Attributes
    ----------
    cob_id
        CAN-ID of its frames.
    synchronous
        Whether each SYNC triggers it, not an event.
    event_timer
        Longest time between two frames, s; 0 when there is none.
    layout
        Its objects.
    """

    cob_id: int
    synchronous: bool
    event_timer: float
    layout: PdoLayout


class PdoConfiguration:
    """The PDO parameters in the object dictionary of one device.

    Parameters
    ----------
    dictionary
        Object dictionary of the device.
    read
        Returns the present value of an object, by index and subindex.
    """

    def __init__(self, dictionary: ObjectDictionary, read: Callable[[int, int], int]) -> None:
        self._dictionary = dictionary
        self._read = read

    @staticmethod
    def covers(index: int) -> bool:
        """Return whether an object is a PDO parameter."""
        return _place(index) is not None

    def check(self, index: int, subindex: int, value: int, locked: bool) -> None:
        """Check a value that is about to be written to a PDO parameter.

        Parameters
        ----------
        index, subindex, value
            What is to be written.
        locked
            Whether the device is in a state in which no mapping may change.

        Raises
        ------
        SdoAbortedError
            With the abort code that the device answers.
        """
        place = _place(index)
        if place is None:
            return
        direction, is_mapping, number = place
        valid = not self._read(direction.value[0] + number, 1) & _INVALID
        if is_mapping:
            if valid or locked:
                raise SdoAbortedError(SdoAbort.DEVICE_STATE)
            if subindex == 0:
                self._layout(direction, number, value)
            elif self._read(index, 0):
                raise SdoAbortedError(SdoAbort.DEVICE_STATE)
            elif value:
                self._mapped_object(direction, value)
        elif subindex == 1:
            self._check_cob_id(index, value, valid)
        elif subindex == 2 and value not in _TRANSMISSION_TYPES[direction]:
            raise SdoAbortedError(SdoAbort.INVALID_VALUE)

    def active(self, direction: Direction) -> list[ActivePdo]:
        """Return the PDOs of a direction that are valid and hold objects."""
        communication, mapping = direction.value
        pdos = []
        for number in range(0x200):
            if communication + number not in self._dictionary:
                break
            cob_id = self._read(communication + number, 1)
            count = self._read(mapping + number, 0)
            if cob_id & _INVALID or not count:
                continue
            pdos.append(
                ActivePdo(
                    cob_id & _CAN_ID,
                    self._read(communication + number, 2) == TransmissionType.EVERY_SYNC,
                    self._read(communication + number, 5) * 1e-3,
                    self._layout(direction, number, count),
                )
            )
        return pdos

    def _check_cob_id(self, index: int, value: int, valid: bool) -> None:
        if value & _INVALID:
            return
        can_id = value & _CAN_ID
        if value & _EXTENDED or any(first <= can_id <= last for first, last in _RESTRICTED_IDS):
            raise SdoAbortedError(SdoAbort.INVALID_VALUE)
        if valid and can_id != self._read(index, 1) & _CAN_ID:
            raise SdoAbortedError(SdoAbort.DEVICE_STATE)

    def _layout(self, direction: Direction, number: int, count: int) -> PdoLayout:
        """Return the layout of the first `count` mapping entries of a PDO."""
        mapping = direction.value[1] + number
        if count not in range(len(self._dictionary[mapping])):
            raise SdoAbortedError(SdoAbort.PDO_LENGTH_EXCEEDED)
        objects = tuple(
            self._mapped_object(direction, self._read(mapping, subindex)) for subindex in range(1, count + 1)
        )
        if sum(entry.bits for entry in objects) > 64:
            raise SdoAbortedError(SdoAbort.PDO_LENGTH_EXCEEDED)
        return PdoLayout(objects)

    def _mapped_object(self, direction: Direction, mapping: int) -> MappedObject:
        """Return the object of a mapping entry: index, subindex, length in bits."""
        index, subindex, bits = mapping >> 16, mapping >> 8 & 0xFF, mapping & 0xFF
        entry = find_object(self._dictionary, index, subindex)
        allowed = entry.writable if direction is Direction.RECEIVE else entry.readable
        if not entry.pdo_mappable or not allowed or bits != len(entry):
            raise SdoAbortedError(SdoAbort.NOT_MAPPABLE)
        return MappedObject(entry.name, index, subindex, bits, entry.data_type in SIGNED_TYPES)


def find_object(dictionary: ObjectDictionary, index: int, subindex: int) -> ODVariable:
    """Return an entry of an object dictionary.

    Raises
    ------
    SdoAbortedError
        If there is no such object, or no such subindex of it.
    """
    if index not in dictionary:
        raise SdoAbortedError(SdoAbort.NO_OBJECT)
    entry = dictionary[index]
    # Not by canopen's own look-up: it grants an array any subindex, and ignores that of a variable.
    subindices = {0: entry} if isinstance(entry, ODVariable) else entry.subindices
    if subindex not in subindices:
        raise SdoAbortedError(SdoAbort.NO_SUBINDEX)
    return subindices[subindex]


def _place(index: int) -> tuple[Direction, bool, int] | None:
    """Return of a PDO parameter the direction, whether it is a mapping, and the number; None for other objects."""
    base, number = index & ~0x1FF, index & 0x1FF
    for direction in Direction:
        if base in direction.value:
            return direction, base == direction.value[1], number
    return None
