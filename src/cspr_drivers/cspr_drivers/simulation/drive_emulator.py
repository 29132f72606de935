"""An emulated servo drive with its motor's holding brake: CiA 402 in cyclic synchronous torque mode."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from canopen.sdo import SdoAbortedError

from cspr_drivers.can_config import DriveConfig
from cspr_drivers.cia402 import (
    CYCLIC_SYNCHRONOUS_TORQUE,
    QUICK_STOP_ON_LOST_CONNECTION,
    QUICK_STOP_THEN_SWITCH_ON_DISABLED,
    STATUS_BITS,
    State,
)
from cspr_drivers.simulation.canopen_codes import EmergencyCode, NmtState, SdoAbort
from cspr_drivers.simulation.drive_state_machine import DriveStateMachine, DriveTiming
from cspr_drivers.simulation.emulated_node import EmulatedNode
from cspr_drivers.simulation.shared_plant import SharedPlant
from cspr_drivers.simulation.simulation_config import BrakeProperties, DriveProperties

# Status word, object 6041h, besides the bits of the state.
_VOLTAGE_ENABLED = 1 << 4
_REMOTE = 1 << 9
_INTERNAL_LIMIT = 1 << 11
_FOLLOWS_COMMAND = 1 << 12

_BRAKE_SET = 1 << 0  # digital outputs, object 60FEh:01

_NO_MODE = 0
_FAULT_SIGNAL_ON_LOST_CONNECTION = 1  # 6007h

# Option codes that this drive offers. With all of them it stops its motor and closes its brake before power
# goes.
_OPTION_CODES = {
    0x6007: (_FAULT_SIGNAL_ON_LOST_CONNECTION, QUICK_STOP_ON_LOST_CONNECTION),
    0x605A: (QUICK_STOP_THEN_SWITCH_ON_DISABLED,),
    0x605B: (1,),  # shutdown: slow down, then ready to switch on
    0x605C: (1,),  # disable operation: slow down, then switched on
    0x605D: (1,),  # halt
    0x605E: (2,),  # fault reaction: quick stop ramp
}

_STANDSTILL_SPEED = 1.0  # rad/s at the motor shaft: some 2 mm/s of cable


class DriveEmulator(EmulatedNode):
    """The drive of one motor.

    Parameters
    ----------
    config
        Node id, scale and sign.
    eds
        Its object dictionary, `cia402_drive.eds`.
    machine
        The machine.
    index
        Number of the motor, from 0.
    brake, drive
        Delays of the brake, and how the drive stops a motor.
    brake_open_bit
        Bit of the status word that is set while the brake is open.

    Attributes
    ----------
    automaton
        State, power stage and brake.
    """

    def __init__(
        self,
        config: DriveConfig,
        eds: Path,
        machine: SharedPlant,
        index: int,
        brake: BrakeProperties,
        drive: DriveProperties,
        brake_open_bit: int,
    ) -> None:
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
        self._brake_open_flag = 1 << brake_open_bit
        self._timing = DriveTiming(
            brake.open_delay, brake.close_delay, drive.quick_stop_time, _STANDSTILL_SPEED
        )
        self.automaton = DriveStateMachine(self._timing)
        self._error_code = 0
        self._mode = _NO_MODE
        self._control_word = 0
        self._new_control_word = False
        self._target_torque = 0
        self._max_torque = self.value(0x6072)
        self._demand = 0
        self._limited = False
        self._angle = self._speed = self._torque = 0.0
        self._outputs = (0.0, 0.0, True)  # what the plant has: torque, damping, brake closed
        self.readers |= {
            (0x603F, 0): lambda: self._error_code,
            (0x6040, 0): lambda: self._control_word,
            (0x6041, 0): self._status_word,
            (0x6060, 0): lambda: self._mode,
            (0x6061, 0): lambda: self._mode,
            (0x6064, 0): lambda: _wrapped(self._units.counts(self._angle)),
            (0x606C, 0): lambda: _wrapped(self._units.counts(self._speed) - self._units.home_counts),
            (0x6071, 0): lambda: self._target_torque,
            (0x6072, 0): lambda: self._max_torque,
            (0x6074, 0): lambda: self._demand,
            (0x6077, 0): lambda: self._units.per_mille(self._torque),
            (0x60FE, 1): lambda: 0 if self.automaton.brake_open else _BRAKE_SET,
        }
        self.writers |= {
            (0x6040, 0): self._write_control_word,
            (0x6060, 0): self._write_mode,
            (0x6071, 0): self._write_target_torque,
            (0x6072, 0): self._write_max_torque,
        }
        for option, allowed in _OPTION_CODES.items():
            self.writers[option, 0] = self._option_writer(option, allowed)

    @property
    def mapping_locked(self) -> bool:
        """Mappings stay as they are while the power stage is on."""
        return self.automaton.powered

    def latch(self) -> None:
        """Take angle, speed and torque of the motor."""
        sensed = self._machine.measure()
        self._angle = sensed.angles[self._index]
        self._speed = sensed.speeds[self._index]
        self._torque = sensed.torques[self._index]

    def applied(self, time: float) -> None:
        """Take the control word, now that the other objects of its frame are written, and set the torque."""
        self._machine.advance(time)
        if self._new_control_word:
            self._new_control_word = False
            before = self.automaton.state
            may_operate = self._mode == CYCLIC_SYNCHRONOUS_TORQUE
            reset = self.automaton.command(self._control_word, time, may_operate)
            resumed = before is State.SWITCH_ON_DISABLED and self.automaton.state is State.READY_TO_SWITCH_ON
            if reset or resumed:
                self._error_code = 0
                self.errors_over()
        self._drive()

    def connection_lost(self, code: EmergencyCode, time: float) -> None:
        """Stop the motor if it is in operation (abort connection option code, 6007h)."""
        if not self.automaton.follows_target:
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
        with self._machine.lock:
            time = self._machine.now()
            self._machine.advance(time)
            self._error_code = int(code)
            self.emergency(code)
            self.automaton.fault(time)
            self._drive()

    def restart(self, time: float) -> None:
        """Begin as after power-on; a drive that is still stopping its motor goes on with that."""
        if not self.automaton.powered:
            self.automaton = DriveStateMachine(self._timing)
            self._error_code = 0
            self._errors.over()
        self._mode = _NO_MODE
        self._control_word = 0
        self._new_control_word = False
        self._target_torque = 0
        self._max_torque = int(self.object_dictionary[0x6072].default)

    def tick(self, time: float, supervise: bool = True) -> None:
        """Do what is due at a plant time, s; see `EmulatedNode.tick`."""
        super().tick(time, supervise)
        if self.automaton.settled:
            return
        self._machine.advance(time)
        self.automaton.advance(time, self._machine.measure().speeds[self._index])
        self._drive()

    def _drive(self) -> None:
        """Give torque, damping and brake to the plant, which stands at the present time."""
        automaton = self.automaton
        if automaton.follows_target:
            self._demand = max(-self._max_torque, min(self._max_torque, self._target_torque))
            self._limited = self._demand != self._target_torque
        elif not automaton.powered:
            self._demand = 0
            self._limited = False
        outputs = (
            self._units.torque(self._demand),
            self._damping if automaton.damps else 0.0,
            not automaton.brake_open,
        )
        if outputs == self._outputs:
            return
        torque, damping, closed = outputs
        plant = self._machine.plant
        plant.set_torque(self._index, torque)
        if damping != self._outputs[1]:
            plant.set_damping(self._index, damping)
        if closed != self._outputs[2]:
            plant.set_brake(self._index, closed)
        self._outputs = outputs

    def _status_word(self) -> int:
        word = STATUS_BITS[self.automaton.state] | _VOLTAGE_ENABLED
        if self.nmt_state is NmtState.OPERATIONAL:
            word |= _REMOTE
        if self._limited:
            word |= _INTERNAL_LIMIT
        if self.automaton.follows_target:
            word |= _FOLLOWS_COMMAND
        if self.automaton.brake_open:
            word |= self._brake_open_flag
        return word

    def _write_control_word(self, word: int) -> None:
        self._control_word = word
        self._new_control_word = True

    def _write_target_torque(self, per_mille: int) -> None:
        self._target_torque = per_mille

    def _write_max_torque(self, per_mille: int) -> None:
        self._max_torque = per_mille

    def _write_mode(self, mode: int) -> None:
        if mode == self._mode:
            return
        if mode not in (_NO_MODE, CYCLIC_SYNCHRONOUS_TORQUE):
            raise SdoAbortedError(SdoAbort.INVALID_VALUE)
        if self.automaton.powered:
            raise SdoAbortedError(SdoAbort.DEVICE_STATE)
        self._mode = mode

    def _option_writer(self, index: int, allowed: tuple[int, ...]) -> Callable[[int], None]:
        def write(value: int) -> None:
            if value not in allowed:
                raise SdoAbortedError(SdoAbort.INVALID_VALUE)
            self._store(index, 0, value)

        return write


def _wrapped(counts: int) -> int:
    """Return counts as the 32-bit counter of a drive shows them."""
    return (counts + 2**31) % 2**32 - 2**31
