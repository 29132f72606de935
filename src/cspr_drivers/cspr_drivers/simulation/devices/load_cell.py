"""An emulated strain-gauge amplifier with its load cell (CiA 404, one analogue input)."""

from __future__ import annotations

import dataclasses
from functools import partial
from pathlib import Path

import numpy as np
from canopen.sdo import SdoAbortedError

from cspr_drivers.canopen.cia404 import AUTOZERO_SIGNATURE, NEWTON, InputStatus
from cspr_drivers.config.can_config import LoadCellConfig
from cspr_drivers.simulation.devices.canopen_codes import SdoAbort
from cspr_drivers.simulation.devices.node import EmulatedNode
from cspr_drivers.simulation.plant.shared import SharedPlant
from cspr_drivers.simulation.simulation_config import LoadCellProperties

_SPAN = 5000  # N, upper end of the measuring range
_SPAN_BELOW_ZERO = 100  # N, measuring range below zero
_NOISE_BLOCK = 256  # samples drawn at once, which costs little more than drawing one


class LoadCellEmulator(EmulatedNode):
    """The amplifier of one cable's load cell.

    Parameters
    ----------
    config
        Node id and calibration.
    eds
        Its object dictionary, `cia404_load_cell.eds`.
    machine
        The machine.
    index
        Number of the cable, from 0.
    errors
        Noise, gain errors and offsets of the load cells.
    seed
        Seed of the noise.

    Attributes
    ----------
    stuck, saturated
        Injected faults: the value stays what it was, or is at the end of the measuring range.
    shift, gain_loss
        Injected faults: N that are shown too much, and the share of the tension that is shown too little.
    """

    def __init__(
        self,
        config: LoadCellConfig,
        eds: Path,
        machine: SharedPlant,
        index: int,
        errors: LoadCellProperties,
        seed: int,
    ) -> None:
        super().__init__(config.node_id, eds, machine, config.identity.objects if config.identity else {})
        self.name = config.name
        self._index = index
        self._units = config.units
        self._noise_std = errors.noise_std
        self._gain = 1.0 + errors.gain_error[index]
        self._offset = errors.offset[index]
        self._generator = np.random.default_rng((seed, index))
        self._noise: list[float] = []
        self.stuck = self.saturated = False
        self.shift = self.gain_loss = 0.0
        self._drift_rate = 0.0  # N/s
        self._drift_since = 0.0  # plant time, s
        self._input_offset = 0  # added to the process value, 9124h
        self._process_value = 0
        self._status = InputStatus.NOT_VALID
        self._set_decimal_digits(self.value(0x6132, 1))
        self.readers |= {
            (0x6132, 1): lambda: self._units.decimal_digits,
            (0x6150, 1): lambda: int(self._status),
            (0x9124, 1): lambda: self._input_offset,
            (0x9130, 1): lambda: self._process_value,
            (0x9148, 1): lambda: self._span_start,
            (0x9149, 1): lambda: self._span_end,
        }
        self.writers |= {
            (0x6125, 1): self._autozero,
            (0x6131, 1): self._check_unit,
            (0x6132, 1): self._set_decimal_digits,
            (0x9124, 1): partial(setattr, self, "_input_offset"),
        }

    def drift(self, rate: float) -> None:
        """Let the zero of the cell drift from now on, N/s; 0 ends and undoes it (an injected fault)."""
        self._drift_rate = rate
        self._drift_since = self._machine.time

    def latch(self) -> None:
        """Take the tension of the cable."""
        if self.stuck:
            return
        if not self._noise:
            self._noise = self._generator.normal(0.0, self._noise_std, _NOISE_BLOCK).tolist()
        shown = self._shown(self._noise.pop()) + self._input_offset
        low, high = self._span_start, self._span_end
        if self.saturated:
            shown = high + 1
        if shown > high:
            self._status = InputStatus.POSITIVE_OVERLOAD
        elif shown < low:
            self._status = InputStatus.NEGATIVE_OVERLOAD
        else:
            self._status = InputStatus.VALID
        self._process_value = max(low, min(high, shown))

    def restart(self, time: float) -> None:
        """Begin as after power-on; the zero of the last taring is kept, as amplifiers store it."""
        self._status = InputStatus.NOT_VALID
        self._set_decimal_digits(int(self.object_dictionary[0x6132][1].default))

    def _shown(self, noise: float) -> int:
        tension = self._machine.measure().tensions[self._index]
        drift = self._drift_rate * (self._machine.time - self._drift_since) + self.shift
        gain = self._gain * (1.0 - self.gain_loss)
        return self._units.process_value(gain * tension + self._offset + drift + noise)

    def _autozero(self, signature: int) -> None:
        if signature != AUTOZERO_SIGNATURE:
            raise SdoAbortedError(SdoAbort.CANNOT_BE_STORED)
        # The mean over the amplifier's filter time is free of noise.
        self._input_offset = -self._shown(noise=0.0)

    def _check_unit(self, unit: int) -> None:
        if unit != NEWTON:
            raise SdoAbortedError(SdoAbort.INVALID_VALUE)

    def _set_decimal_digits(self, digits: int) -> None:
        before = 10.0**-self._units.decimal_digits
        self._units = dataclasses.replace(self._units, decimal_digits=digits)
        self._input_offset = round(self._input_offset * before * 10.0**digits)
        self._span_start = -_SPAN_BELOW_ZERO * 10**digits
        self._span_end = _SPAN * 10**digits
