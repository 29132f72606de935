"""Finite state automaton of an emulated drive with its power stage and holding brake (CiA 402-2).

Pure: time and speed are arguments. There is torque before the brake opens. Operation ends with a ramp, and the
brake holds before the torque goes; only at "disable voltage" power goes at once, and the motor turns freely until
the brake has closed.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum, auto

from cspr_drivers.canopen.cia402 import Command, State
from cspr_drivers.simulation.simulation_config import BrakeProperties, DriveProperties

_SWITCH_ON = 1 << 0
_ENABLE_VOLTAGE = 1 << 1
_QUICK_STOP = 1 << 2  # active low
_ENABLE_OPERATION = 1 << 3
_FAULT_RESET = 1 << 7

_STATES_WITHOUT_POWER = (State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, State.SWITCHED_ON)


QUICK_STOP_OPTION = 0x605A
FAULT_REACTION_OPTION = 0x605E

# Ways to stop that the option codes 605Ah to 605Eh name alike.
SLOW_DOWN_RAMP = 1
QUICK_STOP_RAMP = 2

_SLOW_DOWN = 0.5  # share of the quick stop's damping that the slow down ramp has; it may take as much longer
_STANDSTILL_SPEED = 1.0  # rad/s at the motor shaft at which the brake may close: some 2 mm/s of cable


class Phase(Enum):
    """What power stage and brake are doing."""

    OFF = auto()  # no torque, brake holds
    RELEASING = auto()  # torque on, brake about to open
    RUNNING = auto()  # torque on, brake open
    SLOWING = auto()  # the drive stops the motor by itself, brake open
    CLOSING = auto()  # torque on, brake about to hold
    COASTING = auto()  # no torque, brake about to hold


class DriveStateMachine:
    """State, power stage and brake of one drive.

    Parameters
    ----------
    brake, drive
        Delays of the brake, and how long the drive may take to stop its motor.
    option_code
        Returns the ramp of a quick stop or a fault reaction, by the index of its object.

    Attributes
    ----------
    state
        State that the status word reports.
    phase
        What power stage and brake are doing.
    brake_open
        Whether the brake is open.
    """

    def __init__(
        self, brake: BrakeProperties, drive: DriveProperties, option_code: Callable[[int], int]
    ) -> None:
        self._brake = brake
        self._stop_time = drive.quick_stop_time
        self._option_code = option_code
        self.state = State.NOT_READY_TO_SWITCH_ON
        self.phase = Phase.OFF
        self._phase_end = 0.0
        self._ramp = QUICK_STOP_RAMP
        self._next_state = State.SWITCH_ON_DISABLED  # taken when the power goes
        self.brake_open = False
        self._last_word = 0

    @property
    def powered(self) -> bool:
        """Whether the power stage applies torque."""
        return self.phase not in (Phase.OFF, Phase.COASTING)

    @property
    def follows_target(self) -> bool:
        """Whether the torque is the target torque; else a powered drive keeps the torque it had."""
        return self.powered and self.state is State.OPERATION_ENABLED

    @property
    def damping(self) -> float:
        """How much the drive opposes motion by itself, as a share of the damping of its quick stop."""
        slowing = self.phase is Phase.SLOWING
        if not self.powered or (self.state is State.OPERATION_ENABLED and not slowing):
            return 0.0
        return _SLOW_DOWN if slowing and self._ramp == SLOW_DOWN_RAMP else 1.0

    @property
    def settled(self) -> bool:
        """Whether time alone changes nothing."""
        at_rest = self.phase in (Phase.OFF, Phase.RUNNING)
        return at_rest and self.state is not State.NOT_READY_TO_SWITCH_ON

    def command(self, word: int, time: float, may_operate: bool, may_switch_on: bool = True) -> bool:
        """Take a control word (6040h).

        Parameters
        ----------
        word
            The control word.
        time
            Time, s.
        may_operate
            Whether the drive is in a mode of operation that can hold a load; else operation stays disabled.
        may_switch_on
            Whether nothing, as an emergency stop, keeps the drive in switch on disabled.

        Returns
        -------
        bool
            Whether the word has reset a fault.
        """
        rising = word & ~self._last_word
        self._last_word = word
        if self.state is State.FAULT:
            if not rising & _FAULT_RESET or not may_switch_on:
                return False
            self.state = State.SWITCH_ON_DISABLED
            return True
        if self.state is State.OPERATION_ENABLED:
            self._leave_operation(word, time)
        elif self.state is State.QUICK_STOP_ACTIVE:
            if not word & _ENABLE_VOLTAGE:
                self.disable_voltage(time)
        elif self.state in _STATES_WITHOUT_POWER and (may_switch_on or not word & _ENABLE_VOLTAGE):
            self._switch(word, time, may_operate)
        return False

    def quick_stop(self, time: float) -> None:
        """Stop by itself as 605Ah says; without power there is nothing to stop."""
        if self.state is State.OPERATION_ENABLED:
            self.state = State.QUICK_STOP_ACTIVE
            self._stop(self._option_code(QUICK_STOP_OPTION), State.SWITCH_ON_DISABLED, time)

    def disable_voltage(self, time: float) -> None:
        """Take power away, as the command "disable voltage" does."""
        if self.powered and self.state is not State.FAULT_REACTION_ACTIVE:
            self._cut_power(State.SWITCH_ON_DISABLED, time)

    def fault(self, time: float) -> None:
        """Stop by itself as 605Eh says, if there is power, and end in fault."""
        if not self.powered:
            self.state = State.FAULT
        elif self.state is not State.FAULT_REACTION_ACTIVE:
            self.state = State.FAULT_REACTION_ACTIVE
            self._stop(self._option_code(FAULT_REACTION_OPTION), State.FAULT, time)

    def lose_power(self, time: float) -> None:
        """Lose the supply: no torque from now on, and the brake closes by its spring."""
        if self.brake_open or self.powered:
            self._cut_power(State.NOT_READY_TO_SWITCH_ON, time)
        self.state = State.NOT_READY_TO_SWITCH_ON
        self._last_word = 0

    def advance(self, time: float, speed: float) -> None:
        """Do what is due at a time, s, with the motor turning at a speed, rad/s."""
        if self.state is State.NOT_READY_TO_SWITCH_ON:
            self.state = State.SWITCH_ON_DISABLED
        if self.phase is Phase.SLOWING and (abs(speed) < _STANDSTILL_SPEED or time >= self._phase_end):
            self._close_brake(time)
        elif self.phase is Phase.RELEASING and time >= self._phase_end:
            self.phase = Phase.RUNNING
            self.brake_open = True
        elif self.phase in (Phase.CLOSING, Phase.COASTING) and time >= self._phase_end:
            if self.phase is Phase.CLOSING:
                self.state = self._next_state
            self.phase = Phase.OFF
            self.brake_open = False

    def _switch(self, word: int, time: float, may_operate: bool) -> None:
        """Take the transitions of the states without power (2, 3, 4, 6, 7, 10 of CiA 402-2)."""
        if not word & _ENABLE_VOLTAGE or not word & _QUICK_STOP:
            self.state = State.SWITCH_ON_DISABLED
        elif not word & _SWITCH_ON:
            self.state = State.READY_TO_SWITCH_ON
        elif self.state is State.READY_TO_SWITCH_ON:
            self.state = State.SWITCHED_ON
        elif self.state is State.SWITCHED_ON and word & _ENABLE_OPERATION and may_operate:
            self.state = State.OPERATION_ENABLED
            self.phase = Phase.RELEASING
            self._phase_end = time + self._brake.open_delay

    def _leave_operation(self, word: int, time: float) -> None:
        if word & Command.ENABLE_OPERATION == Command.ENABLE_OPERATION:
            return
        if not word & _ENABLE_VOLTAGE:
            self.disable_voltage(time)
        elif not word & _QUICK_STOP:
            self.quick_stop(time)
        else:
            next_state = State.SWITCHED_ON if word & _SWITCH_ON else State.READY_TO_SWITCH_ON
            self._stop(SLOW_DOWN_RAMP, next_state, time)

    def _stop(self, ramp: int, next_state: State, time: float) -> None:
        self._ramp = ramp
        self._next_state = next_state
        if self.phase is Phase.RUNNING:
            self.phase = Phase.SLOWING
            share = _SLOW_DOWN if ramp == SLOW_DOWN_RAMP else 1.0
            self._phase_end = time + self._stop_time / share
        elif self.phase is Phase.RELEASING:
            self._close_brake(time)

    def _close_brake(self, time: float) -> None:
        if self.phase is not Phase.CLOSING:
            self.phase = Phase.CLOSING
            self._phase_end = time + self._brake.close_delay

    def _cut_power(self, state: State, time: float) -> None:
        self.state = state
        if self.brake_open:
            # a brake that was closing already goes on doing so
            end = time + self._brake.close_delay
            self._phase_end = min(end, self._phase_end) if self.phase is Phase.CLOSING else end
            self.phase = Phase.COASTING
        else:
            self.phase = Phase.OFF
