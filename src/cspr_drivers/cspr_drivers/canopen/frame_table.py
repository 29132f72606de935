"""The one table of what stands in which frame, read by the driver and by the emulated devices alike.

Sources: CiA 301 (COB-IDs of the predefined connection set, section 7.3.5; PDO mapping parameter, section
7.5.2.36; numbers are little-endian, section 7.1.4), CiA 402-2 / IEC 61800-7-201 (objects 6040h, 6041h, 6064h,
606Ch, 6071h, 6077h, 60FDh, 60FEh), CiA 404 (objects 6150h, 9130h).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import IntEnum

from cspr_drivers.errors import FrameError


class FunctionCode(IntEnum):
    """Base COB-IDs of the predefined connection set, to which the node id is added."""

    EMERGENCY = 0x080
    TPDO1 = 0x180
    RPDO1 = 0x200
    TPDO2 = 0x280
    RPDO2 = 0x300
    TPDO3 = 0x380
    SDO_RESPONSE = 0x580
    SDO_REQUEST = 0x600
    HEARTBEAT = 0x700


NMT_COB_ID = 0x000
SYNC_COB_ID = 0x080


class TransmissionType(IntEnum):
    """PDO transmission types in use (CiA 301, sections 7.5.2.35 and 7.5.2.37)."""

    EVERY_SYNC = 1  # TPDO: sampled at, and sent after, each SYNC
    EVENT_DRIVEN = 255  # RPDO: applied at once, without waiting for the next SYNC; TPDO: sent on a change


def cob_id(function: FunctionCode, node_id: int) -> int:
    """Return the COB-ID of a node's frame in the predefined connection set.

    Raises
    ------
    ValueError
        If `node_id` is not in 1..127.
    """
    if not 1 <= node_id <= 127:
        raise ValueError(f"node id {node_id} is not in 1..127")
    return int(function) + node_id


@dataclass(frozen=True)
class MappedObject:
    """An object of an object dictionary that can be mapped into a PDO.

    Attributes
    ----------
    name
        Name by which `can.yaml` refers to it.
    index, subindex
        Its place in the object dictionary.
    bits
        Its length: 8, 16 or 32.
    signed
        Whether it is a two's complement number.
    """

    name: str
    index: int
    subindex: int
    bits: int
    signed: bool

    @property
    def mapping(self) -> int:
        """Value of the PDO mapping entry: index, subindex, length in bits (CiA 301, section 7.5.2.36)."""
        return self.index << 16 | self.subindex << 8 | self.bits

    @property
    def format(self) -> str:
        """Format character of the `struct` module."""
        letter = {8: "b", 16: "h", 32: "i"}[self.bits]
        return letter if self.signed else letter.upper()


CONTROL_WORD = MappedObject("control_word", 0x6040, 0x00, 16, signed=False)
STATUS_WORD = MappedObject("status_word", 0x6041, 0x00, 16, signed=False)
POSITION_ACTUAL = MappedObject("position_actual", 0x6064, 0x00, 32, signed=True)
VELOCITY_ACTUAL = MappedObject("velocity_actual", 0x606C, 0x00, 32, signed=True)
TARGET_TORQUE = MappedObject("target_torque", 0x6071, 0x00, 16, signed=True)
TORQUE_ACTUAL = MappedObject("torque_actual", 0x6077, 0x00, 16, signed=True)
DIGITAL_INPUTS = MappedObject("digital_inputs", 0x60FD, 0x00, 32, signed=False)
DIGITAL_OUTPUTS = MappedObject("digital_outputs", 0x60FE, 0x01, 32, signed=False)
PROCESS_VALUE = MappedObject("process_value", 0x9130, 0x01, 32, signed=True)
INPUT_STATUS = MappedObject("input_status", 0x6150, 0x01, 8, signed=False)


@dataclass(frozen=True)
class PdoLayout:
    """The objects of one PDO, in the order in which they stand in the frame.

    Attributes
    ----------
    objects
        The mapped objects, at most 64 bits together.
    values
        The same objects in the order in which values are encoded and decoded, when that is not the frame's.
    length
        Bytes of the frame.
    """

    objects: tuple[MappedObject, ...]
    values: tuple[MappedObject, ...] = ()
    length: int = field(init=False)
    _struct: struct.Struct = field(init=False, repr=False, compare=False)
    _places: Sequence[int] = field(init=False, repr=False, compare=False)  # in the frame, of each value

    def __post_init__(self) -> None:
        codec = struct.Struct("<" + "".join(entry.format for entry in self.objects))
        if codec.size > 8:
            names = ", ".join(entry.name for entry in self.objects)
            raise ValueError(f"{names} take {codec.size} bytes, a PDO holds 8")
        object.__setattr__(self, "_struct", codec)
        object.__setattr__(self, "length", codec.size)
        places = [self.objects.index(entry) for entry in self.values] or range(len(self.objects))
        object.__setattr__(self, "_places", places)

    @property
    def mapping(self) -> tuple[int, ...]:
        """Values of the PDO mapping parameter, subindex 1 first."""
        return tuple(entry.mapping for entry in self.objects)

    def encode(self, *values: int) -> bytes:
        """Return the frame's data for one raw value per object, in the order of `values`.

        Raises
        ------
        FrameError
            If a value does not fit its object, or their number is another.
        """
        frame = [0] * len(self.objects)
        try:
            for place, value in zip(self._places, values, strict=True):
                frame[place] = value
            return self._struct.pack(*frame)
        except (struct.error, ValueError) as error:
            names = ", ".join(entry.name for entry in self.objects)
            raise FrameError(f"values {values} do not fit the frame of {names}: {error}") from None

    def decode(self, data: bytes | bytearray) -> tuple[int, ...]:
        """Return the raw values of a frame, in the order of `values`.

        Raises
        ------
        FrameError
            If the frame is cut short or too long.
        """
        if len(data) != self.length:
            raise FrameError(f"frame of {len(data)} bytes where {self.length} were expected")
        frame = self._struct.unpack(data)
        return tuple([frame[place] for place in self._places])


DRIVE_RPDO1 = PdoLayout((CONTROL_WORD, TARGET_TORQUE))
DRIVE_RPDO2 = PdoLayout((DIGITAL_OUTPUTS,))
DRIVE_TPDO1 = PdoLayout((STATUS_WORD, POSITION_ACTUAL, TORQUE_ACTUAL))
DRIVE_TPDO2 = PdoLayout((VELOCITY_ACTUAL,))
DRIVE_TPDO3 = PdoLayout((DIGITAL_INPUTS,))
LOAD_CELL_TPDO1 = PdoLayout((PROCESS_VALUE, INPUT_STATUS))
