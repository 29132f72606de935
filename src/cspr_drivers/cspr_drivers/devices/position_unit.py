"""Whether a drive counts its position as the driver takes it: encoder increments of the motor, in their own direction.

Sources: CiA 402-2 / IEC 61800-7-201 (607Eh, 608Fh, 6091h, 6092h, 60A8h). Position values (6064h) are increments times
feed constant over encoder resolution and gear ratio; a drive that lacks an object does without that factor.
"""

from __future__ import annotations

from cspr_drivers.canopen.object_entry import Parameter
from cspr_drivers.canopen.units import INCREMENTS
from cspr_drivers.devices.device import CanopenDevice
from cspr_drivers.errors import DeviceError

_POLARITY = Parameter(0x607E, 0, 8, 0, "polarity", mask=0b1110_0000)  # of positions, velocities, torques
_UNIT = Parameter(0x60A8, 0, 32, INCREMENTS, "SI unit position")

_FACTORS = {0x6091: ("gear ratio", "motor", "shaft"), 0x6092: ("feed constant", "feed", "shaft")}


def require_increments(device: CanopenDevice, encoder_increments: int) -> None:
    """Refuse a drive whose position values are not increments, or count against the direction of its encoder.

    Parameters
    ----------
    encoder_increments
        Per revolution of the motor shaft (608Fh).

    Raises
    ------
    DeviceError
        With the object, its value and what to do; also if the drive does not answer.
    """
    _require(device, _UNIT, "its positions are not in increments and cannot be converted")
    reversed_ = "it reverses directions: set it to 0, for polarity in can.yaml turns the direction"
    _require(device, _POLARITY, reversed_)
    _require_factor(device, 0x6091, (1,))
    _require_factor(device, 0x6092, (1, encoder_increments))


def _require(device: CanopenDevice, entry: Parameter, problem: str) -> None:
    found = device.read_if_present(entry)
    if found is not None and not entry.agrees(found):
        raise DeviceError(
            device.name, f"{entry} is {entry.shown(found)}, expected {entry.shown(entry.value)}: {problem}"
        )


def _require_factor(device: CanopenDevice, index: int, allowed: tuple[int, ...]) -> None:
    """Refuse a ratio of two objects that makes position values something else than increments."""
    name, numerator, denominator = _FACTORS[index]
    above = device.read_if_present(Parameter(index, 1, 32, 0, f"{name}, {numerator} revolutions"))
    below = device.read_if_present(Parameter(index, 2, 32, 0, f"{name}, {denominator} revolutions"))
    if above is None or below is None or above in [value * below for value in allowed]:
        return
    raise DeviceError(
        device.name,
        f"{index:04X}h ({name}) is {above} : {below}, so its positions are not in increments of the motor's encoder: "
        f"set it to {' or '.join(f'{value} : 1' for value in allowed)}",
    )
