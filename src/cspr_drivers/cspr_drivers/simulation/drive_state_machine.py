"""Finite state automaton of an emulated drive with its power stage and holding brake (CiA 402-2).

Pure: time and speed are arguments. Power and brake follow the order that never lets a load drop: there is
torque before the brake opens, and the brake holds before the torque goes.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto

from cspr_drivers.cia402 import Command, State

_SWITCH_ON = 1 << 0
_ENABLE_VOLTAGE = 1 << 1
_QUICK_STOP = 1 << 2  # active low
_ENABLE_OPERATION = 1 << 3
_FAULT_RESET = 1 << 7

_STATES_WITHOUT_POWER = (State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, State.SWITCHED_ON)


@dataclass(frozen=True)
class DriveTiming:
    """Durations, s, and the speed that counts as standstill, rad/s at the motor shaft.

    Attributes
    ----------
    brake_open_delay, brake_close_delay
        From the command to the brake until it is open, or holds.
    quick_stop_time
        Longest time for slowing down; then the brake closes all the same.
    standstill_speed
        Speed below which the brake closes during a quick stop.
    """

    brake_open_delay: float
    brake_close_delay: float
    quick_stop_time: float
    standstill_speed: float


class Phase(Enum):
    """What power stage and brake are doing."""

    OFF = auto()  # no torque, brake holds
    RELEASING = auto()  # torque on, brake about to open
    RUNNING = auto()  # torque on, brake open
    SLOWING = auto()  # the drive stops the motor by itself, brake open
    CLOSING = auto()  # torque on, brake about to hold


class DriveStateMachine:
    """State, power stage and brake of one drive.

    Attributes
    ----------
    state
        State that the status word reports.
    phase
        What power stage and brake are doing.
    """

    def __init__(self, timing: DriveTiming) -> None:
        self._timing = timing
        self.state = State.NOT_READY_TO_SWITCH_ON
        self.phase = Phase.OFF
        self._phase_end = 0.0
        self._next_state = State.SWITCH_ON_DISABLED  # taken when the power goes
        self._brake_open = False
        self._last_word = 0

    @property
    def powered(self) -> bool:
        """Whether the power stage applies torque."""
        return self.phase is not Phase.OFF

    @property
    def follows_target(self) -> bool:
        """Whether the torque is the target torque; else a powered drive keeps the torque it had."""
        return self.powered and self.state is State.OPERATION_ENABLED

    @property
    def damps(self) -> bool:
        """Whether the drive opposes motion by itself."""
        return self.powered and self.state is not State.OPERATION_ENABLED

    @property
    def brake_open(self) -> bool:
        """Whether the brake is open."""
        return self._brake_open

    @property
    def settled(self) -> bool:
        """Whether time alone changes nothing."""
        return self.phase in (Phase.OFF, Phase.RUNNING) and self.state is not State.NOT_READY_TO_SWITCH_ON

    def command(self, word: int, time: float, may_operate: bool) -> bool:
        """Take a control word (6040h).

        Parameters
        ----------
        word
            The control word.
        time
            Time, s.
        may_operate
            Whether the drive is in a mode of operation that can hold a load; else operation stays disabled.

        Returns
        -------
        bool
            Whether the word has reset a fault.
        """
        rising = word & ~self._last_word
        self._last_word = word
        if self.state is State.FAULT:
            if not rising & _FAULT_RESET:
                return False
            self.state = State.SWITCH_ON_DISABLED
            return True
        if self.state is State.OPERATION_ENABLED:
            self._leave_operation(word, time)
        elif self.state is State.QUICK_STOP_ACTIVE:
            if not word & _ENABLE_VOLTAGE:
                self._close_brake(time)
        elif self.state in _STATES_WITHOUT_POWER:
            self._switch(word, time, may_operate)
        return False

    def quick_stop(self, time: float) -> None:
        """Stop by itself and end in switch on disabled; without power there is nothing to stop."""
        if self.state is State.OPERATION_ENABLED:
            self._stop(State.QUICK_STOP_ACTIVE, State.SWITCH_ON_DISABLED, time)

    def fault(self, time: float) -> None:
        """Stop by itself, if there is power, and end in fault."""
        if not self.powered:
            self.state = State.FAULT
        elif self.state is not State.FAULT_REACTION_ACTIVE:
            self._stop(State.FAULT_REACTION_ACTIVE, State.FAULT, time)

    def advance(self, time: float, speed: float) -> None:
        """Do what is due at a time, s, with the motor turning at a speed, rad/s."""
        if self.state is State.NOT_READY_TO_SWITCH_ON:
            self.state = State.SWITCH_ON_DISABLED
        if self.phase is Phase.SLOWING and (
            abs(speed) < self._timing.standstill_speed or time >= self._phase_end
        ):
            self._close_brake(time)
        elif self.phase is Phase.RELEASING and time >= self._phase_end:
            self.phase = Phase.RUNNING
            self._brake_open = True
        elif self.phase is Phase.CLOSING and time >= self._phase_end:
            self.phase = Phase.OFF
            self._brake_open = False
            self.state = self._next_state

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
            self._phase_end = time + self._timing.brake_open_delay

    def _leave_operation(self, word: int, time: float) -> None:
        command = word & Command.ENABLE_OPERATION
        if command == Command.ENABLE_OPERATION:
            return
        if not word & _ENABLE_VOLTAGE:
            self._next_state = State.SWITCH_ON_DISABLED
        elif not word & _QUICK_STOP:
            self.quick_stop(time)
            return
        else:
            self._next_state = State.SWITCHED_ON if word & _SWITCH_ON else State.READY_TO_SWITCH_ON
        self._close_brake(time)

    def _stop(self, state: State, next_state: State, time: float) -> None:
        self.state = state
        self._next_state = next_state
        if self.phase is Phase.RUNNING:
            self.phase = Phase.SLOWING
            self._phase_end = time + self._timing.quick_stop_time
        elif self.phase is Phase.RELEASING:
            self._close_brake(time)

    def _close_brake(self, time: float) -> None:
        if self.phase is not Phase.CLOSING:
            self.phase = Phase.CLOSING
            self._phase_end = time + self._timing.brake_close_delay
