"""What a device needs in its object dictionary to take part: objects to check and objects to set.

Sources: CiA 301 (1000h, 1016h, 1017h, 1018h, 1029h, 1400h, 1600h, 1800h, 1A00h), CiA 402-2 / IEC 61800-7-201
(6007h to 6502h), CiA 404 (6125h, 6131h, 6132h).
"""

from __future__ import annotations

from cspr_drivers.canopen import cia402, cia404
from cspr_drivers.canopen.frame_table import DRIVE_RPDO2, DRIVE_TPDO3, FunctionCode, TransmissionType, cob_id
from cspr_drivers.canopen.object_entry import Parameter, Setting
from cspr_drivers.canopen.pdo_parameters import RPDO, TPDO, pdo_setting
from cspr_drivers.config.can_config import CanConfig, DriveConfig, LoadCellConfig
from cspr_drivers.config.identity import Identity

# Error behaviour, 1029h:01: a communication error leaves the NMT state as it is. What follows is then the quick stop
# of 6007h alone, and the drive goes on reporting how it stops.
_NO_CHANGE_OF_NMT_STATE = 1

_MAJOR_REVISION = 0xFFFF_0000


# What is asked first.
DRIVE_TYPE = Parameter(0x1000, 0, 32, cia402.DEVICE_PROFILE, "device type", mask=0xFFFF)
LOAD_CELL_TYPE = Parameter(0x1000, 0, 32, cia404.DEVICE_PROFILE, "device type", mask=0xFFFF)

# What a drive must show once the mode of operation is active.
DRIVE_MODE = Parameter(
    0x6061, 0, 8, cia402.CYCLIC_SYNCHRONOUS_TORQUE, "modes of operation display", signed=True
)

# What makes an amplifier take its present value as zero; never repeated after a lost answer.
LOAD_CELL_TARE = Parameter(0x6125, 1, 32, cia404.AUTOZERO_SIGNATURE, "AI autozero", repeatable=False)


def identity_object(identity: Identity) -> tuple[Parameter, ...]:
    """Return the identity object of the right device."""
    return (
        Parameter(0x1018, 1, 32, identity.vendor_id, "vendor id"),
        Parameter(0x1018, 2, 32, identity.product_code, "product code"),
        Parameter(0x1018, 3, 32, identity.revision_number, "revision number", mask=_MAJOR_REVISION),
        Parameter(0x1018, 4, 32, identity.serial_number, "serial number"),
    )


def drive_scale(drive: DriveConfig) -> tuple[Parameter, ...]:
    """Return what must be found in a drive: with a wrong scale its torque would be wrong."""
    units = drive.units
    torque_mode = cia402.SUPPORTS_CYCLIC_SYNCHRONOUS_TORQUE
    return (
        Parameter(0x6502, 0, 32, torque_mode, "supported drive modes", mask=torque_mode),
        Parameter(0x6076, 0, 32, round(1000.0 * units.rated_torque), "motor rated torque, mN m"),
        Parameter(0x608F, 1, 32, units.encoder_increments, "encoder increments"),
        Parameter(0x608F, 2, 32, 1, "motor revolutions of the encoder increments"),
    )


def drive_settings(config: CanConfig, drive: DriveConfig) -> tuple[Setting, ...]:
    """Return how a drive is set up, in this order, in NMT pre-operational."""
    times = config.timeouts
    codes = config.option_codes
    heartbeat = config.master_node_id << 16 | milliseconds(times.heartbeat_consumer)
    single: tuple[Parameter, ...] = (
        Parameter(0x6060, 0, 8, cia402.CYCLIC_SYNCHRONOUS_TORQUE, "modes of operation", signed=True),
        Parameter(0x6072, 0, 16, drive.units.max_torque, "max torque, thousandths of the rated torque"),
        Parameter(0x605A, 0, 16, codes.quick_stop, "quick stop option", signed=True),
        Parameter(0x605B, 0, 16, codes.shutdown, "shutdown option", signed=True),
        Parameter(0x605C, 0, 16, codes.disable_operation, "disable operation option", signed=True),
        Parameter(0x605D, 0, 16, codes.halt, "halt option", signed=True),
        Parameter(0x605E, 0, 16, codes.fault_reaction, "fault reaction option", signed=True),
        Parameter(
            0x6007, 0, 16, cia402.QUICK_STOP_ON_LOST_CONNECTION, "abort connection option", signed=True
        ),
        Parameter(0x1029, 1, 8, _NO_CHANGE_OF_NMT_STATE, "error behaviour, communication error"),
        Parameter(0x1016, 1, 32, heartbeat, "consumer heartbeat time"),
        Parameter(0x1017, 0, 16, milliseconds(times.heartbeat_producer), "producer heartbeat time, ms"),
    )
    if config.brake_output is not None:
        single += (Parameter(0x60FE, 2, 32, config.brake_output.mask, "bit mask of the digital outputs"),)
    return (*map(Setting.of, single), *_drive_pdos(config, drive))


def _drive_pdos(config: CanConfig, drive: DriveConfig) -> list[Setting]:
    pdo, sync, event = config.pdo, TransmissionType.EVERY_SYNC, TransmissionType.EVENT_DRIVEN
    outputs = None if config.brake_output is None else DRIVE_RPDO2
    inputs = None if config.emergency_stop_input is None else DRIVE_TPDO3
    return [
        pdo_setting(index, cob_id(function, drive.node_id), transmission, layout, event_timer)
        for index, function, transmission, layout, event_timer in (
            (RPDO, FunctionCode.RPDO1, event, pdo.drive_rpdo, milliseconds(config.timeouts.rpdo)),
            (RPDO + 1, FunctionCode.RPDO2, event, outputs, None),
            (TPDO, FunctionCode.TPDO1, sync, pdo.drive_tpdo, None),
            (TPDO + 1, FunctionCode.TPDO2, sync, pdo.drive_tpdo_2, None),
            (TPDO + 2, FunctionCode.TPDO3, event, inputs, None),
        )
        if layout is not None
    ]


def load_cell_settings(config: CanConfig, cell: LoadCellConfig) -> tuple[Setting, ...]:
    """Return how an amplifier is set up, in this order, in NMT pre-operational."""
    single = (
        Parameter(0x6131, 1, 32, cia404.NEWTON, "AI physical unit PV"),
        Parameter(0x6132, 1, 8, cell.units.decimal_digits, "AI decimal digits PV"),
        Parameter(
            0x1017, 0, 16, milliseconds(config.timeouts.heartbeat_producer), "producer heartbeat time, ms"
        ),
    )
    return (
        *map(Setting.of, single),
        pdo_setting(
            TPDO,
            cob_id(FunctionCode.TPDO1, cell.node_id),
            TransmissionType.EVERY_SYNC,
            config.pdo.load_cell_tpdo,
        ),
    )


def milliseconds(time: float) -> int:
    """Return a time, s, in whole milliseconds, at least one."""
    return max(1, round(1000.0 * time))
