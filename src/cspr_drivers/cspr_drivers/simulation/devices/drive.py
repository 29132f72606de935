"""An emulated servo drive with its motor's holding brake: CiA 402 in cyclic synchronous torque mode."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from canopen.sdo import SdoAbortedError

from cspr_drivers.canopen.cia402 import (
    CYCLIC_SYNCHRONOUS_TORQUE,
    FOLLOWS_TARGET,
    QUICK_STOP_ON_LOST_CONNECTION,
    STATUS_BITS,
    VOLTAGE_ENABLED,
    State,
)
from cspr_drivers.canopen.nmt import NmtState
from cspr_drivers.canopen.units import wrapped
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.simulation.devices.canopen_codes import EmergencyCode, SdoAbort
from cspr_drivers.simulation.devices.drive_states import (
    QUICK_STOP_RAMP,
    SLOW_DOWN_RAMP,
    DriveStateMachine,
    Phase,
)
from cspr_drivers.simulation.devices.encoder import Encoder
from cspr_drivers.simulation.devices.node import EmulatedNode
from cspr_drivers.simulation.plant.shared import SharedPlant
from cspr_drivers.simulation.simulation_config import BrakeProperties, DriveProperties

# Status word, object 6041h, besides the bits of the state and those that the master reads.
_WARNING = 1 << 7
_REMOTE = 1 << 9
_INTERNAL_LIMIT = 1 << 11

_BRAKE_SET = (
    1 << 0
)  # digital outputs, object 60FEh:01: what the drive shows, and heeds where 60FEh:02 has the bit
_INTERLOCK = 1 << 3  # digital inputs, object 60FDh

_NO_MODE = 0  # modes of operation, object 6060h

_FAULT_SIGNAL = 1  # abort connection option code, object 6007h

# Values that this drive offers of each option code: those with which the load ends up on the brake. Those that stop at
# the limit of current or of voltage (3 and 4) are optional, and not offered.
_OPTION_CODES = {
    0x6007: (_FAULT_SIGNAL, QUICK_STOP_ON_LOST_CONNECTION),
    0x605A: (SLOW_DOWN_RAMP, QUICK_STOP_RAMP),
    0x605B: (SLOW_DOWN_RAMP,),
    0x605C: (SLOW_DOWN_RAMP,),
    0x605D: (SLOW_DOWN_RAMP, QUICK_STOP_RAMP),  # without effect: the mode has no halt
    0x605E: (SLOW_DOWN_RAMP, QUICK_STOP_RAMP),
}


class DriveEmulator(EmulatedNode):
    """The drive of one motor.

    Parameters
    ----------
    can_config, index
        What drives and driver agree on, and the number of the motor, from 0, whose drive this is.
    eds
        Its object dictionary, `cia402_drive.eds`.
    machine
        The machine.
    brake, drive
        Delays of the brake, and how the drive stops a motor.

    Attributes
    ----------
    automaton
        State, power stage and brake.
    encoder
        On the motor's shaft; all that the drive does by itself rests on what it shows.
    emergency_stop
        Whether the emergency stop chain is open, see `set_emergency_stop`.
    warning
        Whether the drive warns of something (bit 7 of the status word).
    mode_is_lost, runs_away, blocked
        Injected faults, to be followed by `apply_faults`: the drive has left its mode of operation on its own and
        keeps the torque that it had; in operation it applies this share of its torque, positive to pay out, whatever
        the command; the brake holds although the drive says that it is open.
    """

    def __init__(
        self,
        can_config: CanConfig,
        index: int,
        eds: Path,
        machine: SharedPlant,
        brake: BrakeProperties,
        drive: DriveProperties,
    ) -> None:
        config = can_config.drives[index]
        nameplate = (config.identity.objects if config.identity else {}) | {
            (0x6076, 0): round(config.units.rated_torque * 1e3),
            (0x608F, 1): config.units.encoder_increments,
            (0x608F, 2): 1,
        }
        super().__init__(config.node_id, eds, machine, nameplate)
        self.name = config.name
        self._index = index
        self._units = config.units
        self._damping = drive.quick_stop_damping
        self._brake_open_flag = 1 << can_config.brake_open_bit
        self._brake_output = can_config.brake_output
        self._brake = brake
        self._host_closed = False  # whether the host has closed the brake, and it has got there
        self._host_wish: tuple[bool, float] | None = (
            None  # what the host wants, and when the brake has got there
        )
        self._new_outputs = False
        self._new_automaton = partial(DriveStateMachine, brake, drive, self.value)
        self.automaton = self._new_automaton()
        self.encoder = Encoder()
        self.emergency_stop = False
        self.warning = False
        self.mode_is_lost = False
        self.runs_away = 0.0
        self.blocked = False
        self._error_code = 0
        self._mode = _NO_MODE
        self._control_word = 0
        self._new_control_word = False
        self._target_torque = 0
        self._max_torque = self.value(0x6072)
        self._demand = 0  # thousandths of the rated torque
        self._limited = False
        self._angle = self._speed = self._torque = 0.0
        self._counter_shift = 0  # increments by which the position value is off
        self._outputs = (0.0, 0.0, True)  # what the plant has: torque, damping, brake closed
        self.readers |= {
            (0x603F, 0): lambda: self._error_code,
            (0x6040, 0): lambda: self._control_word,
            (0x6041, 0): self._status_word,
            (0x6060, 0): lambda: self._mode,
            (0x6061, 0): lambda: _NO_MODE if self.mode_is_lost else self._mode,
            (0x6064, 0): lambda: wrapped(self._units.counts(self._angle) + self._counter_shift),
            (0x606C, 0): lambda: wrapped(self._units.counts(self._speed) - self._units.home_counts),
            (0x6071, 0): lambda: self._target_torque,
            (0x6072, 0): lambda: self._max_torque,
            (0x6074, 0): lambda: self._demand,
            (0x6077, 0): lambda: self._units.per_mille(self._torque),
            (0x60FD, 0): lambda: _INTERLOCK if self.emergency_stop else 0,
            (0x60FE, 1): self._digital_outputs,
        }
        self.writers |= {
            (0x6040, 0): self._write_control_word,
            (0x6060, 0): self._write_mode,
            (0x6071, 0): partial(setattr, self, "_target_torque"),
            (0x6072, 0): partial(setattr, self, "_max_torque"),
            (0x60FE, 1): self._write_outputs,
        }
        self._host_outputs = 0
        for option, allowed in _OPTION_CODES.items():
            self.writers[option, 0] = partial(self._write_option, option, allowed)

    @property
    def brake_open(self) -> bool:
        """Whether the brake is open: neither the drive nor the host has closed it."""
        return self.automaton.brake_open and not self._host_closed

    @property
    def mapping_locked(self) -> bool:
        """Mappings stay as they are in NMT operational, and while the power stage is on."""
        return self.nmt_state is NmtState.OPERATIONAL or self.automaton.powered

    def latch(self) -> None:
        """Take angle, speed and torque of the motor."""
        sensed = self._machine.measure()
        self._angle = self.encoder.angle(self._machine.time, sensed.angles[self._index])
        self._speed = self.encoder.speed(sensed.speeds[self._index])
        self._torque = sensed.torques[self._index]

    def applied(self, time: float) -> None:
        """Take the control word, now that the other objects of its frame are written, and set the torque."""
        self._machine.advance(time)
        self._heed_outputs(time)
        if self._new_control_word:
            self._new_control_word = False
            before = self.automaton.state
            may_operate = self._mode != _NO_MODE
            reset = self.automaton.command(self._control_word, time, may_operate, not self.emergency_stop)
            resumed = before is State.SWITCH_ON_DISABLED and self.automaton.state is State.READY_TO_SWITCH_ON
            if reset or resumed:
                self._error_code = 0
                self.errors_over()
        self._drive()

    def connection_lost(self, code: EmergencyCode, time: float) -> None:
        """Do what the abort connection option code, 6007h, says, if the drive is in operation.

        That no RPDO came in time is an error in any state (CiA 301, 7.2.7.1, code 8250h).
        """
        if self.automaton.state is not State.OPERATION_ENABLED:
            if code is EmergencyCode.RPDO_TIMEOUT:
                self.emergency(code)
            return
        self._error_code = int(code)
        self.emergency(code)
        self._machine.advance(time)
        if self.value(0x6007) == QUICK_STOP_ON_LOST_CONNECTION:
            self.automaton.quick_stop(time)
        else:
            self.automaton.fault(time)
        self._drive()

    def fail(self, code: EmergencyCode) -> None:
        """Let the drive find a fault in itself: it stops its motor, closes the brake and is in fault."""
        with self._at_present() as time:
            self._error_code = int(code)
            self.emergency(code)
            self.automaton.fault(time)

    def set_emergency_stop(self, active: bool) -> None:
        """Open or close the emergency stop chain at the drive's interlock input (bit 3 of 60FDh).

        While it is open the drive is stopped as by the quick stop command and cannot be switched on: the safety
        relay of a machine does the same before it takes the power away (stop category 1 of IEC 60204-1).
        """
        with self._at_present() as time:
            self.emergency_stop = active
            if active:
                self.automaton.quick_stop(time)
                if self.automaton.state in (State.READY_TO_SWITCH_ON, State.SWITCHED_ON):
                    self.automaton.state = State.SWITCH_ON_DISABLED

    def shift_counter(self, revolutions: float) -> None:
        """Let the encoder count so many revolutions of the motor that it has not made."""
        self._counter_shift += round(revolutions * self._units.encoder_increments)

    def turn_counter_round(self, times: int = 1) -> None:
        """Let the position counter go round its 32 bits."""
        self._counter_shift += times * 2**32

    def power_cycle(self) -> None:
        """Lose the supply and boot again: the motor coasts until the brake, closed by its spring, holds."""
        with self._machine.lock:
            with self._at_present() as time:
                self.automaton.lose_power(time)
                self._errors.over()
                self._error_code = 0
                self.restart(time)
            self.power_on()

    def restart(self, time: float) -> None:
        """Begin as after power-on; a drive that is still stopping its motor goes on with that."""
        if self.automaton.phase is Phase.OFF:
            self.automaton = self._new_automaton()
            self._error_code = 0
            self._errors.over()
        self._mode = _NO_MODE
        self._control_word = 0
        self._new_control_word = self._new_outputs = self._host_closed = False
        self._host_wish = None
        self._host_outputs = 0
        self._target_torque = 0
        self._max_torque = int(self.object_dictionary[0x6072].default)

    def tick(self, time: float, supervise: bool = True) -> None:
        """Do what is due at a plant time, s; see `EmulatedNode.tick`."""
        super().tick(time, supervise)
        moved = self._move_brake(time)
        if self.automaton.settled and not moved:
            return
        self._machine.advance(time)
        self.automaton.advance(time, self.encoder.speed(self._machine.measure().speeds[self._index]))
        self._drive()

    def apply_faults(self) -> None:
        """Give the plant what the injected faults, just changed, make of the drive's torque."""
        with self._at_present():
            pass

    def apply_brake(self) -> None:
        """Let the plant's brake hold what it holds now, if it is closed."""
        self._machine.plant.set_brake(self._index, self._outputs[2])

    @contextmanager
    def _at_present(self) -> Iterator[float]:
        """Hold the machine at the present plant time, s, and give it what the drive has become by then."""
        with self._machine.lock:
            time = self._machine.now()
            self._machine.advance(time)
            yield time
            self._drive()

    def _drive(self) -> None:
        """Give torque, damping and brake to the plant, which stands at the present time."""
        automaton = self.automaton
        if automaton.follows_target:
            if not self.mode_is_lost:
                self._demand = max(-self._max_torque, min(self._max_torque, self._target_torque))
                self._limited = self._demand != self._target_torque
        elif not automaton.powered:
            self._demand = 0
            self._limited = False
        torque = self._units.torque(self._demand)
        if self.runs_away and automaton.follows_target:
            torque = self.runs_away * self._max_torque * self._units.rated_torque / 1000.0
        # The plant damps the true speed; the drive damps the one that its encoder shows.
        damping = 0.0 if self.encoder.frozen else self._damping * automaton.damping
        torque -= damping * self.encoder.drift
        closed = self.blocked or not self.brake_open
        outputs = (torque, damping, closed)
        if outputs == self._outputs:
            return
        plant = self._machine.plant
        plant.set_torque(self._index, torque)
        if damping != self._outputs[1]:
            plant.set_damping(self._index, damping)
        if closed != self._outputs[2]:
            plant.set_brake(self._index, closed)
        self._outputs = outputs

    def _status_word(self) -> int:
        word = STATUS_BITS[self.automaton.state]
        if not self.emergency_stop:
            word |= VOLTAGE_ENABLED
        if self.warning:
            word |= _WARNING
        if self.nmt_state is NmtState.OPERATIONAL:
            word |= _REMOTE
        if self._limited:
            word |= _INTERNAL_LIMIT
        if self.automaton.follows_target and not self.mode_is_lost:
            word |= FOLLOWS_TARGET
        if self.brake_open:
            word |= self._brake_open_flag
        return word

    def _digital_outputs(self) -> int:
        mask = self.value(0x60FE, 2)
        shown = 0 if self.brake_open else _BRAKE_SET
        return (shown & ~mask) | (self._host_outputs & mask)

    def _write_outputs(self, value: int) -> None:
        self._host_outputs = value
        self._new_outputs = True

    def _heed_outputs(self, time: float) -> None:
        """Move the brake as the host says, if the mask of the outputs lets it."""
        if not self._new_outputs or self._brake_output is None:
            return
        self._new_outputs = False
        output = self._brake_output
        heeded = bool(self.value(0x60FE, 2) & output.mask)
        closed = heeded and self._host_outputs & output.mask == output.outputs(closed=True)
        wish = self._host_wish[0] if self._host_wish else self._host_closed
        if closed != wish:
            delay = self._brake.close_delay if closed else self._brake.open_delay
            self._host_wish = closed, time + (delay if self.automaton.brake_open else 0.0)

    def _move_brake(self, time: float) -> bool:
        """Let the brake get to where the host wants it; return whether it has."""
        if self._host_wish is None or time < self._host_wish[1]:
            return False
        self._host_closed, self._host_wish = self._host_wish[0], None
        return True

    def _write_control_word(self, word: int) -> None:
        self._control_word = word
        self._new_control_word = True

    def _write_mode(self, mode: int) -> None:
        if mode == self._mode:
            return
        if mode not in (_NO_MODE, CYCLIC_SYNCHRONOUS_TORQUE):
            raise SdoAbortedError(SdoAbort.INVALID_VALUE)
        if self.automaton.powered:
            raise SdoAbortedError(SdoAbort.DEVICE_STATE)
        self._mode = mode

    def _write_option(self, index: int, allowed: tuple[int, ...], value: int) -> None:
        if value not in allowed:
            raise SdoAbortedError(SdoAbort.INVALID_VALUE)
        self._store(index, 0, value)
