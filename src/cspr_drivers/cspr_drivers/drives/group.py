"""The m drives of the robot as a group: enabled together, stopped together, with one latched cause.

The group watches status words, commands and silence, and answers with the control word of each drive. It
sends nothing and reads no clock: times are arguments, in seconds of one monotonic clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

from cspr_drivers.brakes.brake_proof import BrakeProof
from cspr_drivers.canopen.cia402 import Command, State, Target, decode_state, next_control_word
from cspr_drivers.canopen.emergency import Emergency, after, is_error
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.devices.device import in_words
from cspr_drivers.drives.status import DriveStatus
from cspr_drivers.drives.transition_watch import TransitionWatch
from cspr_msgs_py.vocabulary import DriverState

IN_MOTION = frozenset({DriverState.WINDING, DriverState.ENABLING, DriverState.ENABLED, DriverState.STOPPING})

_SETTLED: dict[Target, frozenset[State]] = {
    Target.AT_REST: frozenset({State.SWITCH_ON_DISABLED, State.FAULT}),
    Target.SWITCHED_ON: frozenset({State.SWITCHED_ON}),
    Target.OPERATION_ENABLED: frozenset({State.OPERATION_ENABLED}),
    Target.QUICK_STOP: frozenset({State.SWITCH_ON_DISABLED, State.FAULT}),
    Target.FAULT_RESET: frozenset({State.SWITCH_ON_DISABLED}),
}

NOT_PROVEN = (
    "not possible: there is no brake_output in can.yaml, and the drives take the torque away untested"
)
_PROOF_SLIP = (
    0.2  # share of the angle that is a slip in any state: under its full load a bad brake shows early
)

_FAULTY = frozenset({State.FAULT, State.FAULT_REACTION_ACTIVE})


class DriveGroup:
    """State machine of all drives. Not thread-safe: the caller serialises.

    Parameters
    ----------
    config
        Names of the drives (m), the bit that says that a brake is open, and the limits in time.

    Attributes
    ----------
    state
        State of the group.
    cause
        Why the group is not ready or in fault; empty otherwise.
    control_words
        Control word that each drive should have (m).
    """

    def __init__(self, config: CanConfig) -> None:
        count = len(config.drives)
        self._drives = [DriveStatus(drive.name) for drive in config.drives]
        self._everyone = frozenset(range(count))
        self._heard = [-math.inf] * count
        self._commanded = [-math.inf] * count
        self._supervised = -math.inf
        self._brake_is_open = config.brake_is_open
        self._timeouts = config.timeouts
        self._watch = TransitionWatch(count, config.timeouts)
        self._largest_slip = config.largest_brake_slip
        self._host_closes = config.brake_output is not None
        self.proof: BrakeProof | None = None  # of the brakes that the host has closed, before the torque goes
        self.last_proof = "" if self._host_closes else NOT_PROVEN
        self.state = DriverState.NOT_READY
        self.cause = "drives are not configured yet"
        self._since = 0.0
        self._members: frozenset[int] = frozenset()  # drives that are, or are to be, in operation
        self._running: frozenset[int] = frozenset()  # those that have been in operation
        self._unread: frozenset[int] = frozenset()  # those whose settings are still being read
        self._releasing = False
        self._resetting: frozenset[int] = frozenset()  # drives whose fault is being reset
        self._clearing = False  # whether the latched cause is cleared with them
        self._not_stopped: frozenset[int] = frozenset()  # drives reported as late with their stop
        self.control_words = [int(Command.DISABLE_VOLTAGE)] * len(self._drives)

    # What is observed.

    def configured(self, index: int) -> None:
        """Note that a drive is configured and takes part."""
        self._drives[index] = replace(self._drives[index], unavailable="")

    def lost(self, index: int, reason: str, time: float) -> None:
        """Note that a drive restarted, fell silent or cannot be configured; in motion that is a fault."""
        # What it reported before says nothing about the device that will come back.
        self._drives[index] = DriveStatus(self._drives[index].name, unavailable=reason)
        if self.state in IN_MOTION:
            self.quick_stop(f"{self._drives[index].name}: {reason}", time)

    def feedback(self, index: int, status_word: int, time: float) -> None:
        """Process the status word of a drive.

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
                brake_open=self._brake_is_open(status_word),
            )
        self._heard[index] = time

    def emergency(self, index: int, message: Emergency) -> None:
        """Process an emergency message of a drive; in motion an error is a fault."""
        drive = self._drives[index]
        self._drives[index] = replace(drive, errors=after(drive.errors, message))
        if self.state in IN_MOTION and is_error(message.code):
            self.quick_stop(f"{drive.name} reports {message.text}", message.time)

    def emergency_stop(self, index: int, active: bool, time: float) -> None:
        """Process the state of a drive's emergency stop input; when active in motion it is a fault."""
        drive = self._drives[index]
        self._drives[index] = replace(drive, emergency_stop=active)
        if not active:
            return
        cause = f"emergency stop: input of {drive.name}"
        if self.state in IN_MOTION:
            self.quick_stop(cause, time)
        elif not self.cause.startswith("emergency stop"):
            self.explain(cause, time)  # a drive that stops by itself may say so before its input does

    def slips(self, index: int, angle: float, time: float) -> None:
        """Process how far a motor has turned with its brake closed, rad; 0 when it holds. A fault at rest too."""
        drive = self._drives[index]
        angle = round(angle, 1)
        if angle == drive.slipped:
            return
        self._drives[index] = replace(drive, slipped=angle)
        if angle and not drive.slipped:
            turned = f"turns with its brake closed, by {angle:+.1f} rad so far"
            cause = f"{drive.name} {turned}: its brake slips, or its encoder"
            if self.state is DriverState.FAULT and not self._clearing:
                self.cause += f"; {cause}"
            else:
                self.quick_stop(cause, time)

    def commanded(self, index: int, time: float) -> None:
        """Note that an acceptable torque command for a drive arrived."""
        self._commanded[index] = time

    def supervised(self, time: float) -> None:
        """Note that the supervisor lives."""
        self._supervised = time

    # What is commanded.

    def enable(self, time: float, index: int | None = None, unread: Iterable[int] = ()) -> str | None:
        """Begin to release the brakes, of all drives or of one; return why not when that is refused.

        Parameters
        ----------
        unread
            Drives whose settings are read meanwhile: none leaves rest until all of them are `confirmed`.
        """
        if self.state is DriverState.FAULT:
            return f"a fault is latched: {self.cause}; reset it first"
        if self.state is DriverState.NOT_READY:
            return self.cause
        if self.state is DriverState.HELD_BY_DRIVES:
            return self._open_again(time, index)
        wanted = self._everyone if index is None else frozenset({index})
        singly = index is not None and self.state is DriverState.ENABLED and index not in self._members
        if self.state is not DriverState.DISABLED and not singly:
            return f"the drives are {self.state.value}"
        members = wanted | (self._members if singly else frozenset())
        if stale := self._without_command(time, members):
            return f"no fresh torque commands for {', '.join(stale)}"
        if self._unsupervised(time, members):
            return "no sign of life of the supervisor, without which one drive alone may be enabled: is it running?"
        self._members = members
        self._unread = frozenset(unread)
        self._releasing = False
        self._enter(DriverState.ENABLING, "", time)
        return None

    def _open_again(self, time: float, index: int | None) -> str | None:
        """Open the brakes of drives that hold the load anyway, so that the operator can let it down."""
        if index is not None:
            return f"the drives are {self.state.value}: {self.cause}"
        if stale := self._without_command(time, self._members):
            return f"no fresh torque commands for {', '.join(stale)}"
        if self._unsupervised(time, self._members):
            return "no sign of life of the supervisor: is it running?"
        self.proof, self._running, self._releasing = None, frozenset(), True
        self._enter(DriverState.ENABLING, "", time)
        return None

    def confirmed(self, index: int, time: float) -> None:
        """Note that a drive is set as it was when it was set up."""
        if index in self._unread:
            self._unread -= {index}
            self._since = time if self.state is DriverState.ENABLING else self._since
            self._aim()

    def wind(self, time: float, index: int, doing: str) -> str | None:
        """Begin to release the brake of a winch that is wound alone, all others braked; return why not when refused.

        Parameters
        ----------
        time
            s.
        index
            Of the drive. It is wound until it is disabled.
        doing
            What happens, in words: the cause on topics meanwhile.
        """
        if self.state is DriverState.FAULT:
            return f"a fault is latched: {self.cause}; reset it first"
        if self.state is DriverState.WINDING:
            return f"{self.cause}: one winch at a time, call again when that is over"
        if self.state is not DriverState.DISABLED:
            return self.cause or f"the drives are {self.state.value}: disable them first"
        self._members = frozenset({index})
        self._unread = frozenset()
        self._releasing = True
        self._enter(DriverState.WINDING, doing, time)
        return None

    def disable_refusal(self, index: int | None) -> str | None:
        """Return why one drive may not be disabled: of all that carry the platform, none may let go alone."""
        if index is None or self.state is not DriverState.ENABLED or self._members != self._everyone:
            return None
        if len(self._everyone) == 1:
            return None
        return f"{self._drives[index].name} carries the platform with all others: disable them together"

    def disable(self, time: float, index: int | None = None) -> None:
        """Begin to close the brakes, of all drives or of one. Has no effect unless in motion."""
        if self.state is DriverState.HELD_BY_DRIVES and index is None:
            self._prove(time)
        if self.state not in (DriverState.WINDING, DriverState.ENABLING, DriverState.ENABLED):
            return
        if index is None and self._host_closes and self._running == self._everyone:
            self._prove(time)
            return
        remaining = frozenset() if index is None else self._members - {index}
        if remaining and self.state is DriverState.ENABLED:
            self._members = self._running = remaining
            self._aim()
        elif index is None or index in self._members:
            self._members = self._running = frozenset()
            if self.state is DriverState.WINDING:
                self._since = time  # it is over when the brake has closed
                self._aim()
            else:
                self._enter(DriverState.STOPPING, "", time)

    def _prove(self, time: float) -> None:
        """Begin to close the brakes under torque, and to test them before it goes."""
        self.proof = BrakeProof(len(self._drives), _PROOF_SLIP * self._largest_slip)
        self._enter(DriverState.STOPPING, "", time)

    def quick_stop(self, cause: str, time: float, ordered: bool = False) -> None:
        """Stop all drives at once and latch the cause. The first cause stays.

        Drives that hold the load, as a brake does not, are stopped only when that is ordered: they would let it go.
        """
        if self.state is DriverState.HELD_BY_DRIVES and not ordered and self._hold_on():
            if cause not in self.cause:
                self.cause += f"; {cause}"
            return
        if self.state is not DriverState.FAULT or self._clearing:
            self._resetting = self._members = self._running = self._not_stopped = frozenset()
            self._clearing = False
            self.proof = None
            self._enter(DriverState.FAULT, cause, time)

    def explain(self, cause: str, time: float) -> None:
        """Name what has caused the fault that was latched a moment ago, where its effect was noticed first."""
        recent = self.state is DriverState.FAULT and time - self._since < self._timeouts.feedback
        if recent and cause not in self.cause:
            self.cause = f"{cause}; {self.cause}"

    def fault_reset(self, time: float, index: int | None = None) -> str | None:
        """Begin to reset faults of the drives; return why not when that is refused.

        Parameters
        ----------
        index
            Drive whose fault is reset; by default that of all, and the latched cause with them.
        """
        if self.state is not DriverState.FAULT:
            return None
        concerned = self._everyone if index is None else frozenset({index})
        reporting = [self._drives[k] for k in self._present(time) & concerned]
        if moving := [drive.describe() for drive in reporting if not drive.held]:
            return f"not stopped yet: {'; '.join(moving)}"
        self._resetting = frozenset(k for k in concerned if self._drives[k].state is State.FAULT)
        self._clearing = index is None
        self._since = time
        self._watch.clear()
        self._aim()
        return None

    # What follows.

    def step(self, time: float) -> None:
        """Evaluate what was observed, change state, and set the control words. Called once per cycle."""
        if self.state in (DriverState.NOT_READY, DriverState.DISABLED):
            self._rest(time)
        elif self.state is DriverState.FAULT:
            self._hold_fault(time)
        elif cause := self._fault_cause(time):
            self.quick_stop(cause, time)
        elif self.proof is not None:
            self._test(self.proof, time)
        elif self.state is DriverState.ENABLING:
            self._release(time)
        elif self.state is DriverState.WINDING and self._members:
            self._release_winch(time)
        elif self.state in (DriverState.STOPPING, DriverState.WINDING):
            self._close(time)
        self._aim()
        if self.state is not DriverState.ENABLED or self._members != self._everyone:
            self._watch_transitions(time)

    @property
    def held(self) -> bool:
        """Whether the brakes of all drives that can be reached are closed."""
        return all(drive.held for drive in self._drives if not drive.unavailable)

    @property
    def drives(self) -> tuple[DriveStatus, ...]:
        """What is known about each drive (m)."""
        return tuple(self._drives)

    @property
    def members(self) -> tuple[str, ...]:
        """Names of the drives that are in operation, or on the way there."""
        return tuple(self._drives[index].name for index in sorted(self._members))

    def operates(self, index: int) -> bool:
        """Return whether a drive follows its torque."""
        if self.proof is not None:
            return index in self._running
        return self.state in (DriverState.ENABLED, DriverState.WINDING) and index in self._running

    def closes(self, index: int) -> bool | None:
        """Return whether the host is to close a brake; None while the drive moves it as it sees fit."""
        if self.proof is not None:
            return True
        if self.state is DriverState.STOPPING:
            return None
        if index in self._members:
            return False
        return True if self._drives[index].held else None

    def settled(self, index: int) -> bool:
        """Return whether a drive is where it should be, so that its control word need not be repeated."""
        state = self._drives[index].state
        return state is None or state in _SETTLED[self._target(index)]

    def feedback_age(self, index: int, time: float) -> float:
        """Return the time since the last frame of a drive, s; infinite before the first."""
        return time - self._heard[index]

    # Inner working.

    def _target(self, index: int) -> Target:
        if self.state is DriverState.FAULT:
            return Target.FAULT_RESET if index in self._resetting else Target.QUICK_STOP
        waits = self._unread and index not in self._running
        if index not in self._members or waits:
            return Target.AT_REST
        if self.state is DriverState.ENABLING and not self._releasing and index not in self._running:
            return Target.SWITCHED_ON
        return Target.OPERATION_ENABLED

    def _aim(self) -> None:
        for index, drive in enumerate(self._drives):
            if drive.state is not None:
                self.control_words[index] = next_control_word(drive.state, self._target(index))

    def _enter(self, state: DriverState, cause: str, time: float) -> None:
        self.state = state
        self.cause = cause
        self._since = time
        self._aim()

    def _silent(self, index: int, time: float) -> bool:
        return self.feedback_age(index, time) > self._timeouts.feedback

    def _silent_with(self, index: int) -> str:
        """Return the names of the drives that were heard last when one was, as all on a broken bus were.

        Not of those that nobody has heard since because this process had to wait for the CPU.
        """
        last = self._heard[index] + 0.25 * self._timeouts.feedback
        silent = [k for k in self._everyone if self._heard[k] <= last]
        if len(silent) == len(self._drives):
            return "all drives"
        return ", ".join(self._drives[k].name for k in sorted(silent))

    def _present(self, time: float) -> frozenset[int]:
        """Return the drives that can be used and report their state."""
        return frozenset(
            index
            for index, drive in enumerate(self._drives)
            if not drive.unavailable and not self._silent(index, time)
        )

    def _without_command(self, time: float, members: Iterable[int]) -> list[str]:
        limit = self._timeouts.command
        return [
            self._drives[index].name for index in sorted(members) if time - self._commanded[index] > limit
        ]

    def _unsupervised(self, time: float, members: frozenset[int]) -> bool:
        """Return whether nobody watches drives that share the load; one alone, all others braked, needs nobody."""
        return len(members) > 1 and not time - self._supervised <= self._timeouts.supervisor

    def _rest(self, time: float) -> None:
        present = self._present(time)
        reporting = [self._drives[k] for k in sorted(present)]
        if faulty := [drive.describe() for drive in reporting if drive.state in _FAULTY]:
            self.quick_stop("; ".join(faulty), time)
            return
        reasons = {d.name: self._why_not_at_rest(d, index in present) for index, d in enumerate(self._drives)}
        if cause := in_words({name: reason for name, reason in reasons.items() if reason}):
            self._enter(DriverState.NOT_READY, cause, time)
        elif self.state is DriverState.NOT_READY:
            self._enter(DriverState.DISABLED, "", time)

    @staticmethod
    def _why_not_at_rest(drive: DriveStatus, present: bool) -> str:
        """Return why a drive is not at rest and ready, or an empty text."""
        if drive.unavailable:
            return drive.unavailable
        if not present:
            return "sends no feedback"
        if drive.emergency_stop:
            return "its emergency stop input is active"
        if drive.state is not State.SWITCH_ON_DISABLED:
            return f"is in {drive.state_name}"
        return "its brake is open" if drive.brake_open else ""

    def _fault_cause(self, time: float) -> str:
        """Return why the drives cannot go on, or an empty text."""
        for index, drive in enumerate(self._drives):
            if drive.state in _FAULTY:
                return drive.describe()
            if self._silent(index, time):
                return f"{self._silent_with(index)}: silent for {1e3 * (time - self._heard[index]):.0f} ms"
        # The torque stays what it was until the brakes hold: drives that stop need no more commands.
        holding = (
            self.state is DriverState.HELD_BY_DRIVES
        )  # the torque is all that holds: it stays what it was
        stale = [] if holding else self._without_command(time, self._members)
        if stale:
            limit = 1e3 * self._timeouts.command
            return f"no torque command within {limit:.0f} ms for {', '.join(stale)}"
        if not holding and self._unsupervised(time, self._members):
            return f"no sign of life of the supervisor for {1e3 * (time - self._supervised):.0f} ms"
        for index in self._members:
            drive = self._drives[index]
            running = index in self._running
            if (running and drive.state is not State.OPERATION_ENABLED) or (
                drive.state is State.QUICK_STOP_ACTIVE
            ):
                power = "; its power stage has no supply" if drive.without_power else ""
                return drive.describe() + power
            if running and not drive.brake_open and self.proof is None:
                return f"{drive.name}: its brake closed by itself"
            if running and not drive.follows_target:
                return f"{drive.name} does not follow its target torque: it has left its mode of operation"
        return ""

    def _release(self, time: float) -> None:
        powered = (State.SWITCHED_ON, State.OPERATION_ENABLED)
        members = [self._drives[index] for index in sorted(self._members)]
        if not self._releasing:
            self._releasing = all(drive.state in powered for drive in members)
        if self._released(time):
            self._enter(DriverState.ENABLED, "", time)

    def _release_winch(self, time: float) -> None:
        if not self._running:
            self._released(time)

    def _released(self, time: float) -> bool:
        """Return whether all that are to be in operation are; too late is a fault."""
        late = [
            drive.describe()
            for drive in (self._drives[index] for index in sorted(self._members))
            if not drive.in_operation
        ]
        if self._unread:
            late = [
                f"{self._drives[k].name}: its settings are still being read" for k in sorted(self._unread)
            ]
        if not late:
            self._running = self._members
        elif time - self._since > self._timeouts.enable:
            self.quick_stop(f"not enabled within {self._timeouts.enable:g} s: {'; '.join(late)}", time)
        return not late

    def _test(self, proof: BrakeProof, time: float) -> None:
        """Take the torque from closed brakes, and leave it to them only when all have held."""
        if open_brakes := [drive.name for drive in self._drives if drive.brake_open]:
            if time - self._since > self._timeouts.stop and self.state is DriverState.STOPPING:
                names = ", ".join(open_brakes)
                self.cause = f"not closed within {self._timeouts.stop:g} s: brakes of {names}"
                self._enter(DriverState.HELD_BY_DRIVES, self.cause, time)
            return
        if self.state is DriverState.HELD_BY_DRIVES:
            return
        proof.begin(time)
        if proof.slipped:
            slips = ", ".join(
                f"{self._drives[k].name} ({angle:+.1f} rad)" for k, angle in sorted(proof.slipped.items())
            )
            self.last_proof = f"brake slips under its load: {slips}"
            self._enter(DriverState.HELD_BY_DRIVES, self.last_proof, time)
        elif proof.passed(time):
            self.last_proof = "all brakes have held"
            self.proof = None
            self._members = self._running = frozenset()
            self._enter(DriverState.STOPPING, "", time)

    def _hold_on(self) -> bool:
        """Return whether the drives whose brakes do not hold are still in operation."""
        slipping = self.proof.slipped if self.proof is not None else {}
        return all(
            self._drives[k].state is State.OPERATION_ENABLED for k in (slipping or range(len(self._drives)))
        )

    def _close(self, time: float) -> None:
        late = [d for d in self._drives if d.brake_open or d.state is not State.SWITCH_ON_DISABLED]
        if not late:
            self._enter(DriverState.DISABLED, "", time)
        elif time - self._since > self._timeouts.stop:
            names = "; ".join(drive.describe() for drive in late)
            self.quick_stop(f"brakes not closed within {self._timeouts.stop:g} s: {names}", time)

    def _hold_fault(self, time: float) -> None:
        # One reset is one edge of bit 7: a drive that falls into fault again waits for the operator again.
        self._resetting = frozenset(k for k in self._resetting if self._drives[k].state is State.FAULT)
        reporting = [self._drives[k] for k in sorted(self._present(time))]
        late = [drive.describe() for drive in reporting if drive.state is not State.SWITCH_ON_DISABLED]
        overdue = time - self._since > self._timeouts.stop
        if self._clearing and not late:
            self._clearing = False
            self._resetting = frozenset()
            self._enter(DriverState.NOT_READY, "", time)
            self._rest(time)
        elif overdue and (self._clearing or self._resetting):
            self._clearing = False
            self._resetting = frozenset()
            self.cause = f"not reset: {'; '.join(late)}"

    def _watch_transitions(self, time: float) -> None:
        late = self._watch.overdue([drive.state for drive in self._drives], self.control_words, time)
        if not late:
            return
        if self.state in IN_MOTION:
            index, problem = next(iter(late.items()))
            self.quick_stop(f"{self._drives[index].name}: {problem}", time)
        elif self.state is DriverState.FAULT and not (self._clearing or self._resetting):
            for index in late.keys() - self._not_stopped:
                self._not_stopped |= {index}
                self.cause += f"; {self._drives[index].name}: {late[index]}: assume the load is not held"
