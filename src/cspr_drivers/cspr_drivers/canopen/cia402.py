"""Finite state automaton of a drive (CiA 402-2 / IEC 61800-7-201), as pure functions.

Nothing is remembered here: the drive keeps its state and reports it in the status word; the driver
answers each report with the control word that leads one transition closer to where the drive should be.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, IntEnum

from cspr_drivers.errors import FrameError

DEVICE_PROFILE = 402  # low word of the device type, object 1000h

CYCLIC_SYNCHRONOUS_TORQUE = 10  # modes of operation, object 6060h
SUPPORTS_CYCLIC_SYNCHRONOUS_TORQUE = 1 << 9  # supported drive modes, object 6502h

# Quick stop option code, object 605Ah: slow down on the quick stop ramp, then transit into switch on
# disabled. The drive closes its brake at standstill and keeps its torque until the brake holds.
QUICK_STOP_THEN_SWITCH_ON_DISABLED = 2

# Abort connection option code, object 6007h: what a lost heartbeat or a late RPDO does: quick stop command.
QUICK_STOP_ON_LOST_CONNECTION = 3


class State(Enum):
    """States of the power drive system; the value is the name on topics."""

    NOT_READY_TO_SWITCH_ON = "not_ready_to_switch_on"
    SWITCH_ON_DISABLED = "switch_on_disabled"
    READY_TO_SWITCH_ON = "ready_to_switch_on"
    SWITCHED_ON = "switched_on"
    OPERATION_ENABLED = "operation_enabled"
    QUICK_STOP_ACTIVE = "quick_stop_active"
    FAULT_REACTION_ACTIVE = "fault_reaction_active"
    FAULT = "fault"


class Command(IntEnum):
    """Commands of the control word, object 6040h; the value is the word."""

    DISABLE_VOLTAGE = 0x0000
    QUICK_STOP = 0x0002
    SHUTDOWN = 0x0006
    SWITCH_ON = 0x0007
    ENABLE_OPERATION = 0x000F
    FAULT_RESET = 0x0080

    DISABLE_OPERATION = 0x0007  # the same word as switch on: it depends on the state


class Target(Enum):
    """Where a drive is to be led."""

    AT_REST = "at_rest"  # switch on disabled, brake closed first
    SWITCHED_ON = "switched_on"  # power on, brake closed
    OPERATION_ENABLED = "operation_enabled"  # brake open, torque at the shaft
    QUICK_STOP = "quick_stop"  # the shortest way to a closed brake
    FAULT_RESET = "fault_reset"  # out of fault, to switch on disabled


class Wait(Enum):
    """What a transition waits for, which is what limits its time; the value names the limit in `Timeouts`."""

    LOGIC = "transition"  # no brake moves
    RELEASE = "enable"  # the brake opens
    HOLD = "stop"  # the motor comes to rest and the brake closes


@dataclass(frozen=True)
class Transition:
    """A transition of the finite state automaton that this driver makes use of.

    Attributes
    ----------
    number
        In the figure of the standard.
    source, target
        States before and after.
    command
        Control word that asks for it, `None` when the drive takes it by itself.
    wait
        What it takes.
    """

    number: int
    source: State
    target: State
    command: Command | None
    wait: Wait


TRANSITIONS: tuple[Transition, ...] = (
    Transition(2, State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, Command.SHUTDOWN, Wait.LOGIC),
    Transition(3, State.READY_TO_SWITCH_ON, State.SWITCHED_ON, Command.SWITCH_ON, Wait.LOGIC),
    Transition(4, State.SWITCHED_ON, State.OPERATION_ENABLED, Command.ENABLE_OPERATION, Wait.RELEASE),
    Transition(5, State.OPERATION_ENABLED, State.SWITCHED_ON, Command.DISABLE_OPERATION, Wait.HOLD),
    Transition(6, State.SWITCHED_ON, State.READY_TO_SWITCH_ON, Command.SHUTDOWN, Wait.LOGIC),
    Transition(7, State.READY_TO_SWITCH_ON, State.SWITCH_ON_DISABLED, Command.DISABLE_VOLTAGE, Wait.LOGIC),
    Transition(7, State.READY_TO_SWITCH_ON, State.SWITCH_ON_DISABLED, Command.QUICK_STOP, Wait.LOGIC),
    Transition(10, State.SWITCHED_ON, State.SWITCH_ON_DISABLED, Command.DISABLE_VOLTAGE, Wait.LOGIC),
    Transition(10, State.SWITCHED_ON, State.SWITCH_ON_DISABLED, Command.QUICK_STOP, Wait.LOGIC),
    Transition(11, State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, Command.QUICK_STOP, Wait.LOGIC),
    Transition(12, State.QUICK_STOP_ACTIVE, State.SWITCH_ON_DISABLED, None, Wait.HOLD),
    Transition(14, State.FAULT_REACTION_ACTIVE, State.FAULT, None, Wait.HOLD),
    Transition(15, State.FAULT, State.SWITCH_ON_DISABLED, Command.FAULT_RESET, Wait.LOGIC),
)

_TRANSITION_OF = {(t.source, t.command): t for t in TRANSITIONS}


def transition(state: State, control_word: int) -> Transition | None:
    """Return the transition that a drive in `state` is to take on a control word, `None` when it may stay."""
    return _TRANSITION_OF.get((state, None)) or _TRANSITION_OF.get((state, Command(control_word)))


VOLTAGE_ENABLED = 1 << 4  # bits of the status word besides those of the state
FOLLOWS_TARGET = 1 << 12  # in cyclic synchronous torque mode, while operation is enabled

# Status word, object 6041h: mask and value of each state.
STATUS_PATTERNS: tuple[tuple[State, int, int], ...] = (
    (State.NOT_READY_TO_SWITCH_ON, 0x4F, 0x00),
    (State.SWITCH_ON_DISABLED, 0x4F, 0x40),
    (State.READY_TO_SWITCH_ON, 0x6F, 0x21),
    (State.SWITCHED_ON, 0x6F, 0x23),
    (State.OPERATION_ENABLED, 0x6F, 0x27),
    (State.QUICK_STOP_ACTIVE, 0x6F, 0x07),
    (State.FAULT_REACTION_ACTIVE, 0x4F, 0x0F),
    (State.FAULT, 0x4F, 0x08),
)

STATUS_BITS: dict[State, int] = {state: value for state, _, value in STATUS_PATTERNS}

_STATE_OF_BITS: tuple[State | None, ...] = tuple(
    next((state for state, mask, value in STATUS_PATTERNS if bits & mask == value), None)
    for bits in range(0x80)
)


def decode_state(status_word: int) -> State:
    """Return the state that a status word reports.

    Raises
    ------
    FrameError
        If its bits are those of no state.
    """
    state = _STATE_OF_BITS[status_word & 0x7F]
    if state is None:
        raise FrameError(f"status word 0x{status_word:04X} reports no state of CiA 402")
    return state


_WAY: dict[Target, dict[State, Command]] = {
    # Leaving operation by "disable operation" lets the drive close its brake under torque before power goes.
    Target.AT_REST: {
        State.OPERATION_ENABLED: Command.DISABLE_OPERATION,
        State.SWITCHED_ON: Command.SHUTDOWN,
    },
    Target.SWITCHED_ON: {
        State.SWITCH_ON_DISABLED: Command.SHUTDOWN,
        State.READY_TO_SWITCH_ON: Command.SWITCH_ON,
        State.SWITCHED_ON: Command.SWITCH_ON,
        State.OPERATION_ENABLED: Command.DISABLE_OPERATION,
    },
    Target.OPERATION_ENABLED: {
        State.SWITCH_ON_DISABLED: Command.SHUTDOWN,
        State.READY_TO_SWITCH_ON: Command.SWITCH_ON,
        State.SWITCHED_ON: Command.ENABLE_OPERATION,
        State.OPERATION_ENABLED: Command.ENABLE_OPERATION,
    },
    Target.QUICK_STOP: {
        State.READY_TO_SWITCH_ON: Command.QUICK_STOP,
        State.SWITCHED_ON: Command.QUICK_STOP,
        State.OPERATION_ENABLED: Command.QUICK_STOP,
    },
    Target.FAULT_RESET: {
        State.OPERATION_ENABLED: Command.DISABLE_OPERATION,
        State.SWITCHED_ON: Command.SHUTDOWN,
        State.FAULT: Command.FAULT_RESET,
    },
}


def next_control_word(state: State, target: Target) -> int:
    """Return the control word that leads a drive from `state` one transition towards `target`.

    In every state without a way to the target the word is "disable voltage", which keeps bit 7 low, so that
    the word of a fault reset is always a rising edge. A quick stop that has begun is never cut short: neither
    by "disable voltage" (transition 12) nor by "enable operation" (transition 16).
    """
    if state is State.QUICK_STOP_ACTIVE:
        return int(Command.QUICK_STOP)
    return int(_WAY[target].get(state, Command.DISABLE_VOLTAGE))
