"""One load-cell amplifier at a time: its reading, and its zero."""

from __future__ import annotations

from cspr_drivers.canopen import cia404
from cspr_drivers.canopen.object_entry import Parameter
from cspr_drivers.config.can_config import LoadCellConfig
from cspr_drivers.devices.device import CanopenDevice
from cspr_drivers.devices.settings import LOAD_CELL_TARE
from cspr_drivers.errors import DeviceError

_SAMPLES = 25  # of a reading that counts: their mean has a fifth of the noise of one
GLANCE = 4  # of one that only has to change
_LARGEST_ZERO = 5.0  # N that a tared cell may show with a slack cable


class SingleLoadCell:
    """An amplifier that displays newtons.

    Parameters
    ----------
    device
        The amplifier.
    config
        Its decimal digits.

    Raises
    ------
    DeviceError
        If it does not answer, or refuses the unit or the digits.
    """

    def __init__(self, device: CanopenDevice, config: LoadCellConfig) -> None:
        self._device = device
        digits = config.units.decimal_digits
        self._divisor = 10.0**digits
        device.write(Parameter(0x6131, 1, 32, cia404.NEWTON, "AI physical unit PV"))
        device.write(Parameter(0x6132, 1, 8, digits, "AI decimal digits PV"))

    def reading(self, samples: int = _SAMPLES) -> float:
        """Return the mean of some readings, N, as the amplifier displays them.

        Raises
        ------
        DeviceError
            If the amplifier reports an overload or another problem.
        """
        total = 0.0
        for _ in range(samples):
            total += self._device.read(Parameter(0x9130, 1, 32, 0, "AI input PV", signed=True))
            status = self._device.read(Parameter(0x6150, 1, 8, 0, "AI status"))
            if status:
                raise DeviceError(self._device.name, f"reports: {cia404.status_text(status)}")
        return total / samples / self._divisor

    def tare(self) -> float:
        """Make the present reading zero; return what it was, N.

        Raises
        ------
        DeviceError
            If the reading is not zero afterwards.
        """
        before = self.reading()
        self._device.write(LOAD_CELL_TARE)
        after = self.reading()
        if abs(after) > _LARGEST_ZERO:
            raise DeviceError(self._device.name, f"shows {after:z.1f} N after taring: is the cable at rest?")
        return before
