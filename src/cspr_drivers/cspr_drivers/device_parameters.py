"""What a device must have in its object dictionary to take part: objects to check and objects to write.

Sources: CiA 301 (1000h, 1016h, 1017h, 1400h, 1600h, 1800h, 1A00h), CiA 402-2 / IEC 61800-7-201 (6007h to
6502h), CiA 404 (6125h, 6131h, 6132h).
"""

from __future__ import annotations

from dataclasses import dataclass

from cspr_drivers import cia402, cia404
from cspr_drivers.can_config import CanConfig, DriveConfig, LoadCellConfig
from cspr_drivers.frame_table import FunctionCode, PdoLayout, TransmissionType, cob_id

PDO_NOT_VALID = 1 << 31  # bit of the COB-ID entry (CiA 301, section 7.5.2.35)

CLOSE_BRAKE_ON_SLOW_DOWN_RAMP = 1  # disable operation option code, object 605Ch


@dataclass(frozen=True)
class Parameter:
    """A value of an object: to be written, or to be found.

    Attributes
    ----------
    index, subindex, bits, signed
        Place and type of the object.
    value
        The value.
    meaning
        Name of the object, for messages.
    mask
        Bits of the object that must agree with `value` when it is checked.
    """

    index: int
    subindex: int
    bits: int
    value: int
    meaning: str
    signed: bool = False
    mask: int = -1

    @property
    def data(self) -> bytes:
        """The value as it is transferred."""
        return self.value.to_bytes(self.bits // 8, "little", signed=self.signed)

    def agrees(self, data: bytes) -> bool:
        """Return whether the object's content agrees with the value."""
        return int.from_bytes(data, "little", signed=self.signed) & self.mask == self.value & self.mask

    def __str__(self) -> str:
        return f"{self.index:04X}h:{self.subindex:02X} ({self.meaning})"


def drive_identity(drive: DriveConfig) -> tuple[Parameter, ...]:
    """Return what must be found in a drive: a wrong scale would be a wrong torque."""
    units = drive.units
    torque_mode = cia402.SUPPORTS_CYCLIC_SYNCHRONOUS_TORQUE
    return (
        Parameter(0x1000, 0, 32, cia402.DEVICE_PROFILE, "device type", mask=0xFFFF),
        Parameter(0x6502, 0, 32, torque_mode, "supported drive modes", mask=torque_mode),
        Parameter(0x6076, 0, 32, round(1000.0 * units.rated_torque), "motor rated torque, mN m"),
        Parameter(0x608F, 1, 32, units.encoder_increments, "encoder increments"),
        Parameter(0x608F, 2, 32, 1, "motor revolutions of the encoder increments"),
    )


def drive_parameters(config: CanConfig, drive: DriveConfig) -> tuple[Parameter, ...]:
    """Return what is written to a drive, in this order, in NMT pre-operational."""
    times = config.timeouts
    heartbeat = config.master_node_id << 16 | milliseconds(times.heartbeat_consumer)
    return (
        Parameter(0x6060, 0, 8, cia402.CYCLIC_SYNCHRONOUS_TORQUE, "modes of operation", signed=True),
        Parameter(0x6072, 0, 16, drive.units.max_torque, "max torque, thousandths of the rated torque"),
        Parameter(0x605A, 0, 16, cia402.QUICK_STOP_THEN_SWITCH_ON_DISABLED, "quick stop option", signed=True),
        Parameter(0x605C, 0, 16, CLOSE_BRAKE_ON_SLOW_DOWN_RAMP, "disable operation option", signed=True),
        Parameter(
            0x6007, 0, 16, cia402.QUICK_STOP_ON_LOST_CONNECTION, "abort connection option", signed=True
        ),
        Parameter(0x1016, 1, 32, heartbeat, "consumer heartbeat time"),
        Parameter(0x1017, 0, 16, milliseconds(times.heartbeat_producer), "producer heartbeat time, ms"),
        *_pdo(
            0x1400,
            cob_id(FunctionCode.RPDO1, drive.node_id),
            TransmissionType.EVENT_DRIVEN,
            config.pdo.drive_rpdo,
            event_timer=milliseconds(times.rpdo),
        ),
        *_pdo(
            0x1800,
            cob_id(FunctionCode.TPDO1, drive.node_id),
            TransmissionType.EVERY_SYNC,
            config.pdo.drive_tpdo,
        ),
    )


def drive_mode() -> Parameter:
    """Return what modes of operation display must show once the mode is active."""
    return Parameter(
        0x6061, 0, 8, cia402.CYCLIC_SYNCHRONOUS_TORQUE, "modes of operation display", signed=True
    )


def load_cell_identity() -> tuple[Parameter, ...]:
    """Return what must be found in a load-cell amplifier."""
    return (Parameter(0x1000, 0, 32, cia404.DEVICE_PROFILE, "device type", mask=0xFFFF),)


def load_cell_parameters(config: CanConfig, cell: LoadCellConfig) -> tuple[Parameter, ...]:
    """Return what is written to an amplifier, in this order, in NMT pre-operational."""
    return (
        Parameter(0x6131, 1, 32, cia404.NEWTON, "AI physical unit PV"),
        Parameter(0x6132, 1, 8, cell.units.decimal_digits, "AI decimal digits PV"),
        Parameter(
            0x1017, 0, 16, milliseconds(config.timeouts.heartbeat_producer), "producer heartbeat time, ms"
        ),
        *_pdo(
            0x1800,
            cob_id(FunctionCode.TPDO1, cell.node_id),
            TransmissionType.EVERY_SYNC,
            config.pdo.load_cell_tpdo,
        ),
    )


def load_cell_tare() -> Parameter:
    """Return what makes an amplifier take its present value as zero."""
    return Parameter(0x6125, 1, 32, cia404.AUTOZERO_SIGNATURE, "AI autozero")


def milliseconds(time: float) -> int:
    """Return a time, s, in whole milliseconds, at least one."""
    return max(1, round(1000.0 * time))


def _pdo(
    communication: int,
    identifier: int,
    transmission: TransmissionType,
    layout: PdoLayout,
    event_timer: int | None = None,
) -> tuple[Parameter, ...]:
    """Return the writes that set up a PDO.

    It is taken out of use while its mapping changes (CiA 301, section 7.5.2.36).
    """
    mapping = communication + 0x200
    timer = () if event_timer is None else (Parameter(communication, 5, 16, event_timer, "event timer, ms"),)
    return (
        Parameter(communication, 1, 32, PDO_NOT_VALID | identifier, "COB-ID of the PDO, not valid"),
        Parameter(communication, 2, 8, transmission, "transmission type"),
        *timer,
        Parameter(mapping, 0, 8, 0, "number of mapped objects"),
        *(
            Parameter(mapping, place, 32, value, f"mapped object {place}")
            for place, value in enumerate(layout.mapping, start=1)
        ),
        Parameter(mapping, 0, 8, len(layout.objects), "number of mapped objects"),
        Parameter(communication, 1, 32, identifier, "COB-ID of the PDO"),
    )
