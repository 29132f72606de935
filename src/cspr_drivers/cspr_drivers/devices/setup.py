"""Setting up a device: who it is, how it is set, and what has to be written."""

from __future__ import annotations

from dataclasses import dataclass

from cspr_drivers.canopen import cia402
from cspr_drivers.canopen.frame_table import DIGITAL_INPUTS, STATUS_WORD
from cspr_drivers.canopen.nmt import NmtCommand
from cspr_drivers.canopen.object_entry import Parameter, Setting
from cspr_drivers.canopen.pdo_parameters import default_pdos, out_of_use
from cspr_drivers.canopen.units import velocity_unit
from cspr_drivers.config.can_config import CanConfig, DriveConfig, LoadCellConfig
from cspr_drivers.config.identity import Identity
from cspr_drivers.devices.device import CanopenDevice
from cspr_drivers.devices.position_unit import require_increments
from cspr_drivers.devices.settings import (
    DRIVE_MODE,
    DRIVE_TYPE,
    LOAD_CELL_TYPE,
    drive_scale,
    drive_settings,
    identity_object,
    load_cell_settings,
)
from cspr_drivers.errors import DeviceError, WrongDeviceError

_POWERED = (
    cia402.State.OPERATION_ENABLED,
    cia402.State.QUICK_STOP_ACTIVE,
    cia402.State.FAULT_REACTION_ACTIVE,
)


@dataclass(frozen=True)
class DriveFacts:
    """What a drive says about itself when it is set up.

    Attributes
    ----------
    rated_current
        Of its motor, A (6075h); `None` when it does not report it.
    velocity_unit
        Velocity, rad/s, of one unit of 606Ch; `None` where it is not needed.
    emergency_stop
        Whether its input for the emergency stop is active.
    error_code, error_register
        Its last error (603Fh) and the errors that are present (1001h): nobody has heard the messages sent before.
    written
        Settings that had to be written, 0 when it was configured already.
    """

    rated_current: float | None
    velocity_unit: float | None
    emergency_stop: bool
    error_code: int
    error_register: int
    written: int


def set_up_drive(device: CanopenDevice, config: CanConfig, drive: DriveConfig) -> DriveFacts:
    """Bring a drive to NMT operational, or find out why it must not be.

    A drive that is set up already is only read. One that is not is written to in NMT pre-operational, never while
    its motor is under torque.

    Raises
    ------
    WrongDeviceError
        If it is another device than the configured one.
    DeviceError
        If it does not answer, refuses something, or has another scale than configured.
    """
    _identify(device, DRIVE_TYPE, drive.identity)
    device.check(drive_scale(drive))
    current = _rated_current(device)
    require_increments(device, drive.units.encoder_increments)
    velocity = config.pdo.drive_tpdo_2 is not None
    unit = _velocity_unit(device, drive) if velocity else None
    wrong = _differing(device, drive_settings(config, drive))
    if wrong:
        _require_no_torque(device)
        device.command(NmtCommand.ENTER_PRE_OPERATIONAL)
        device.set(wrong)
    device.wait_for(DRIVE_MODE)
    code = device.read_if_present(Parameter(0x603F, 0, 16, 0, "error code")) or 0
    register = device.read_if_present(Parameter(0x1001, 0, 8, 0, "error register")) or 0
    device.start()
    return DriveFacts(current, unit, _emergency_stop(device, config), code, register, len(wrong))


def check_drive(device: CanopenDevice, config: CanConfig, drive: DriveConfig, facts: DriveFacts) -> None:
    """Raise DeviceError, with both values, if a drive that was set up is set otherwise by now, or does not answer.

    Parameters
    ----------
    facts
        What it said when it was set up.
    """
    device.check(drive_scale(drive))
    require_increments(device, drive.units.encoder_increments)
    for setting in drive_settings(config, drive):
        device.check(setting.result)
    if facts.velocity_unit is not None and _velocity_unit(device, drive) != facts.velocity_unit:
        raise DeviceError(
            device.name, "60A9h (SI unit velocity) has changed: its velocities have another scale"
        )


def set_up_load_cell(
    device: CanopenDevice, config: CanConfig, cell: LoadCellConfig
) -> tuple[int | None, int | None]:
    """Bring an amplifier to NMT operational, likewise.

    Returns
    -------
    tuple
        Process values between which it measures (9148h, 9149h), both `None` when it does not report it.

    Raises
    ------
    WrongDeviceError, DeviceError
        As `set_up_drive`.
    """
    _identify(device, LOAD_CELL_TYPE, cell.identity)
    wrong = _differing(device, load_cell_settings(config, cell))
    if wrong:
        device.command(NmtCommand.ENTER_PRE_OPERATIONAL)
        device.set(wrong)
    ends = [
        Parameter(0x9148, 1, 32, 0, "AI span start", signed=True),
        Parameter(0x9149, 1, 32, 0, "AI span end", signed=True),
    ]
    low, high = map(device.read_if_present, ends)
    device.start()
    return low, high


def _identify(device: CanopenDevice, profile: Parameter, identity: Identity | None) -> None:
    device.leave_stopped()
    device.check((profile,), WrongDeviceError)
    if identity is None:
        raise WrongDeviceError(
            device.name,
            "is not commissioned: its identity is null in the configuration; `cspr commission` finds it",
        )
    device.check(identity_object(identity), WrongDeviceError)


def _rated_current(device: CanopenDevice) -> float | None:
    """Return the rated current, A; without motor data a drive cannot scale torque either."""
    entry = Parameter(0x6075, 0, 32, 0, "motor rated current, mA")
    current = device.read_if_present(entry)
    if current == 0:
        raise DeviceError(
            device.name,
            f"{entry} is 0: its motor data are not set; set them with the manufacturer's software",
        )
    return None if current is None else 1e-3 * current


def _velocity_unit(device: CanopenDevice, drive: DriveConfig) -> float:
    entry = Parameter(0x60A9, 0, 32, 0, "SI unit velocity")
    code = device.read_if_present(entry)
    unit = None if code is None else velocity_unit(code, drive.units.encoder_increments)
    if unit is None:
        found = "is missing" if code is None else f"is {entry.shown(code)}"
        raise DeviceError(
            device.name,
            f"{entry} {found}: its velocities cannot be converted; use velocity_source: position_difference",
        )
    return unit


def _emergency_stop(device: CanopenDevice, config: CanConfig) -> bool:
    """Return the present state of the input; from now on the drive sends its changes."""
    entry = config.emergency_stop_input
    if entry is None:
        return False
    return entry.is_active(device.read(Parameter(DIGITAL_INPUTS.index, 0, 32, 0, "digital inputs")))


def _differing(device: CanopenDevice, settings: tuple[Setting, ...]) -> list[Setting]:
    wrong = device.differing(settings)
    for entry in default_pdos({parameter.index for setting in settings for parameter in setting.result}):
        found = device.read_if_present(entry)
        if found is not None and not entry.agrees(found):
            wrong.append(out_of_use(entry, found))
    return wrong


def _require_no_torque(device: CanopenDevice) -> None:
    word = device.read(Parameter(STATUS_WORD.index, 0, 16, 0, "statusword"))
    state = cia402.decode_state(word)
    if state in _POWERED:
        raise DeviceError(
            device.name, f"is in {state.value} and not yet set up: this waits until it is at rest"
        )
