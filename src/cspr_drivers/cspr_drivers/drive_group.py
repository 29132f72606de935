"""The m drives of the robot as one: enabled together, stopped together, with one latched cause.

The group watches status words, commands and silence, and answers with the control word of each drive. It
sends nothing and reads no clock: times are arguments, in seconds of one monotonic clock.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from enum import Enum

from cspr_drivers.cia402 import Command, State, Target, decode_state, next_control_word
from cspr_drivers.drive_status import DriveStatus
from cspr_drivers.timeouts import Timeouts


class GroupState(Enum):
    """State of the drives as a whole; the value is the name on topics."""

    NOT_READY = "not_ready"  # a drive is missing or not at rest
    DISABLED = "disabled"  # all drives at rest, brakes closed
    ENABLING = "enabling"  # on the way to enabled; brakes open last, and together
    ENABLED = "enabled"  # all brakes open, torque at every shaft
    STOPPING = "stopping"  # brakes are closing, under torque
    FAULT = "fault"  # quick stop, latched until reset


IN_MOTION = frozenset({GroupState.ENABLING, GroupState.ENABLED, GroupState.STOPPING})

_SETTLED: dict[Target, frozenset[State]] = {
    Target.AT_REST: frozenset({State.SWITCH_ON_DISABLED, State.FAULT}),
    Target.SWITCHED_ON: frozenset({State.SWITCHED_ON}),
    Target.OPERATION_ENABLED: frozenset({State.OPERATION_ENABLED}),
    Target.QUICK_STOP: frozenset({State.SWITCH_ON_DISABLED, State.FAULT}),
    Target.FAULT_RESET: frozenset({State.SWITCH_ON_DISABLED}),
}

_FAULTY = frozenset({State.FAULT, State.FAULT_REACTION_ACTIVE})


class DriveGroup:
    """State machine of all drives. Not thread-safe: the caller serialises.

    Parameters
    ----------
    names
        Names of the drives (m).
    brake_open_bit
        Bit of the status word that is set while the brake is open.
    timeouts
        `command`, `feedback`, `enable` and `stop` are used here.
    """

    def __init__(self, names: Sequence[str], brake_open_bit: int, timeouts: Timeouts) -> None:
        self._drives = [DriveStatus(name) for name in names]
        self._heard = [-math.inf] * len(names)
        self._commanded = [-math.inf] * len(names)
        self._brake_open = 1 << brake_open_bit
        self._timeouts = timeouts
        self._state = GroupState.NOT_READY
        self._cause = "drives are not configured yet"
        self._since = 0.0
        self._releasing = False
        self._resetting = False
        self._words = [int(Command.DISABLE_VOLTAGE)] * len(self._drives)

    # What is observed.

    def configured(self, index: int) -> None:
        """Note that a drive is configured and takes part."""
        self._drives[index] = replace(self._drives[index], unavailable="")

    def lost(self, index: int, reason: str, time: float) -> None:
        """Note that a drive restarted, fell silent or cannot be configured; in motion that is a fault."""
        # What it reported before says nothing about the device that will come back.
        self._drives[index] = DriveStatus(self._drives[index].name, unavailable=reason)
        if self._state in IN_MOTION:
            self._latch(f"{self._drives[index].name}: {reason}", time)

    def feedback(self, index: int, status_word: int, time: float) -> None:
        """Take the status word of a drive.

        Raises
        ------
        FrameError
            If its bits are those of no state; it is not used then.
        """
        drive = self._drives[index]
        if status_word != drive.status_word or drive.state is None:
            self._drives[index] = replace(
                drive,
                status_word=status_word,
                state=decode_state(status_word),
                brake_open=bool(status_word & self._brake_open),
            )
        self._heard[index] = time

    def emergency(self, index: int, error_code: int) -> None:
        """Note the error code of a drive's emergency message."""
        self._drives[index] = replace(self._drives[index], error_code=error_code)

    def commanded(self, index: int, time: float) -> None:
        """Note that an acceptable torque command for a drive arrived."""
        self._commanded[index] = time

    # What is commanded.

    def enable(self, time: float) -> str | None:
        """Begin to release the brakes; return why not when that is refused."""
        if self._state is GroupState.FAULT:
            return f"a fault is latched: {self._cause}; reset it first"
        if self._state is GroupState.NOT_READY:
            return self._cause
        if self._state is not GroupState.DISABLED:
            return f"the drives are {self._state.value}"
        if stale := self._without_command(time):
            return f"no fresh torque commands for {', '.join(stale)}"
        self._releasing = False
        self._enter(GroupState.ENABLING, "", time)
        return None

    def disable(self, time: float) -> None:
        """Begin to close the brakes, then take the torque away. Without effect unless in motion."""
        if self._state in (GroupState.ENABLING, GroupState.ENABLED):
            self._enter(GroupState.STOPPING, "", time)

    def quick_stop(self, cause: str, time: float) -> None:
        """Stop all drives at once and latch the cause. The first cause stays."""
        self._latch(cause, time)

    def fault_reset(self, time: float) -> str | None:
        """Begin to reset the drives' faults and the latch; return why not when that is refused."""
        if self._state is not GroupState.FAULT:
            return None
        moving = [drive.describe() for drive in self._present(time) if not drive.held]
        if moving:
            return f"not stopped yet: {'; '.join(moving)}"
        self._resetting = True
        self._since = time
        self._aim()
        return None

    # What follows.

    def step(self, time: float) -> None:
        """Judge what was observed, change state, and set the control words. Called once a cycle."""
        if self._state in (GroupState.NOT_READY, GroupState.DISABLED):
            self._rest(time)
        elif self._state is GroupState.FAULT:
            self._hold_fault(time)
        elif cause := self._trouble(time):
            self._latch(cause, time)
        elif self._state is GroupState.ENABLING:
            self._release(time)
        elif self._state is GroupState.STOPPING:
            self._close(time)
        self._aim()

    @property
    def state(self) -> GroupState:
        """State of the group."""
        return self._state

    @property
    def cause(self) -> str:
        """Why the group is not ready or in fault; empty otherwise."""
        return self._cause

    @property
    def control_words(self) -> Sequence[int]:
        """Control word that each drive shall have (m)."""
        return self._words

    @property
    def held(self) -> bool:
        """Whether the brakes of all drives that can be reached are closed."""
        return all(drive.held for drive in self._drives if not drive.unavailable)

    @property
    def drives(self) -> tuple[DriveStatus, ...]:
        """What is known of each drive (m)."""
        return tuple(self._drives)

    def settled(self, index: int) -> bool:
        """Return whether a drive is where it shall be, so that its control word need not be repeated."""
        state = self._drives[index].state
        return state is None or state in _SETTLED[self._target()]

    # Inner working.

    def _target(self) -> Target:
        match self._state:
            case GroupState.ENABLING:
                return Target.OPERATION_ENABLED if self._releasing else Target.SWITCHED_ON
            case GroupState.ENABLED:
                return Target.OPERATION_ENABLED
            case GroupState.FAULT:
                return Target.FAULT_RESET if self._resetting else Target.QUICK_STOP
            case _:
                return Target.AT_REST

    def _aim(self) -> None:
        target = self._target()
        for index, drive in enumerate(self._drives):
            if drive.state is not None:
                self._words[index] = next_control_word(drive.state, target)

    def _enter(self, state: GroupState, cause: str, time: float) -> None:
        self._state = state
        self._cause = cause
        self._since = time
        self._aim()

    def _latch(self, cause: str, time: float) -> None:
        if self._state is not GroupState.FAULT or self._resetting:
            self._resetting = False
            self._enter(GroupState.FAULT, cause, time)

    def _silent(self, index: int, time: float) -> bool:
        return time - self._heard[index] > self._timeouts.feedback

    def _present(self, time: float) -> list[DriveStatus]:
        """Return the drives that can be used and report their state."""
        return [
            drive
            for index, drive in enumerate(self._drives)
            if not drive.unavailable and not self._silent(index, time)
        ]

    def _without_command(self, time: float) -> list[str]:
        limit = self._timeouts.command
        return [
            drive.name
            for drive, commanded in zip(self._drives, self._commanded, strict=True)
            if time - commanded > limit
        ]

    def _rest(self, time: float) -> None:
        present = self._present(time)
        if faulty := [drive.describe() for drive in present if drive.state in _FAULTY]:
            self._latch("; ".join(faulty), time)
            return
        reasons: dict[str, list[str]] = {}
        for drive in self._drives:
            if reason := self._restless(drive, drive in present):
                reasons.setdefault(reason, []).append(drive.name)
        if reasons:
            cause = "; ".join(f"{', '.join(names)}: {reason}" for reason, names in reasons.items())
            self._enter(GroupState.NOT_READY, cause, time)
        elif self._state is GroupState.NOT_READY:
            self._enter(GroupState.DISABLED, "", time)

    @staticmethod
    def _restless(drive: DriveStatus, present: bool) -> str:
        """Return why a drive is not at rest and ready, or an empty text."""
        if drive.unavailable:
            return drive.unavailable
        if not present:
            return "sends no feedback"
        if drive.state is not State.SWITCH_ON_DISABLED:
            return f"is in {drive.state_name}"
        return "its brake is open" if drive.brake_open else ""

    def _trouble(self, time: float) -> str:
        """Return what makes going on impossible, or an empty text."""
        for index, drive in enumerate(self._drives):
            if drive.state in _FAULTY:
                return drive.describe()
            if self._silent(index, time):
                return f"{drive.name}: silent for {1e3 * (time - self._heard[index]):.0f} ms"
        if self._state is GroupState.STOPPING:
            # The torque stays what it was until the brakes hold: commands are not needed any more.
            return ""
        if stale := self._without_command(time):
            limit = 1e3 * self._timeouts.command
            return f"no torque command within {limit:.0f} ms for {', '.join(stale)}"
        running = self._state is GroupState.ENABLED
        for drive in self._drives:
            if (running and drive.state is not State.OPERATION_ENABLED) or (
                drive.state is State.QUICK_STOP_ACTIVE
            ):
                return drive.describe()
            if running and not drive.brake_open:
                return f"{drive.name}: its brake closed by itself"
        return ""

    def _release(self, time: float) -> None:
        powered = (State.SWITCHED_ON, State.OPERATION_ENABLED)
        if not self._releasing:
            self._releasing = all(drive.state in powered for drive in self._drives)
        open_ = [d.state is State.OPERATION_ENABLED and d.brake_open for d in self._drives]
        if all(open_):
            self._enter(GroupState.ENABLED, "", time)
        elif time - self._since > self._timeouts.enable:
            late = [drive.describe() for drive, done in zip(self._drives, open_, strict=True) if not done]
            self._latch(f"not enabled within {self._timeouts.enable:g} s: {'; '.join(late)}", time)

    def _close(self, time: float) -> None:
        late = [d for d in self._drives if d.brake_open or d.state is not State.SWITCH_ON_DISABLED]
        if not late:
            self._enter(GroupState.DISABLED, "", time)
        elif time - self._since > self._timeouts.stop:
            names = "; ".join(drive.describe() for drive in late)
            self._latch(f"brakes not closed within {self._timeouts.stop:g} s: {names}", time)

    def _hold_fault(self, time: float) -> None:
        if not self._resetting:
            return
        late = [
            drive.describe() for drive in self._present(time) if drive.state is not State.SWITCH_ON_DISABLED
        ]
        if not late:
            self._resetting = False
            self._enter(GroupState.NOT_READY, "", time)
            self._rest(time)
        elif time - self._since > self._timeouts.stop:
            self._resetting = False
            self._cause = f"not reset: {'; '.join(late)}"
