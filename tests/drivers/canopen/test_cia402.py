import pytest

from cspr_drivers.canopen.cia402 import STATUS_BITS, Command, State, Target, decode_state, next_control_word
from cspr_drivers.errors import FrameError

# IEC 61800-7-201, table "device state bits": x stands for a bit that does not matter.
STATE_CODING = {
    State.NOT_READY_TO_SWITCH_ON: "xxxx xxxx x0xx 0000",
    State.SWITCH_ON_DISABLED: "xxxx xxxx x1xx 0000",
    State.READY_TO_SWITCH_ON: "xxxx xxxx x01x 0001",
    State.SWITCHED_ON: "xxxx xxxx x01x 0011",
    State.OPERATION_ENABLED: "xxxx xxxx x01x 0111",
    State.QUICK_STOP_ACTIVE: "xxxx xxxx x00x 0111",
    State.FAULT_REACTION_ACTIVE: "xxxx xxxx x0xx 1111",
    State.FAULT: "xxxx xxxx x0xx 1000",
}


def coded_state(word):
    """Return the state of a status word by reading the table digit by digit."""
    digits = f"{word:016b}"
    for state, pattern in STATE_CODING.items():
        if all(p in ("x", d) for p, d in zip(pattern.replace(" ", ""), digits, strict=True)):
            return state
    return None


def test_every_status_word_decodes_as_the_table_says():
    for word in [high | low for high in (0x0000, 0xFF80, 0x4200) for low in range(0x100)]:
        expected = coded_state(word)
        if expected is None:
            with pytest.raises(FrameError, match=f"0x{word:04X} reports no state"):
                decode_state(word)
        elif decode_state(word) is not expected:
            pytest.fail(f"0x{word:04X} is {expected}")


@pytest.mark.parametrize("state", State)
def test_status_bits_are_those_of_the_state(state):
    assert decode_state(STATUS_BITS[state]) is state


def test_control_words_as_the_table_says():
    # IEC 61800-7-201, table "command coding".
    assert Command.SHUTDOWN == 0b0000_0110
    assert Command.SWITCH_ON == 0b0000_0111
    assert Command.ENABLE_OPERATION == 0b0000_1111
    assert Command.DISABLE_VOLTAGE == 0b0000_0000
    assert Command.QUICK_STOP == 0b0000_0010
    assert Command.DISABLE_OPERATION == 0b0000_0111
    assert Command.FAULT_RESET == 0b1000_0000


S, C, T = State, Command, Target

WORDS = {
    T.AT_REST: {
        S.NOT_READY_TO_SWITCH_ON: C.DISABLE_VOLTAGE,
        S.SWITCH_ON_DISABLED: C.DISABLE_VOLTAGE,
        S.READY_TO_SWITCH_ON: C.DISABLE_VOLTAGE,
        S.SWITCHED_ON: C.SHUTDOWN,
        S.OPERATION_ENABLED: C.DISABLE_OPERATION,
        S.QUICK_STOP_ACTIVE: C.QUICK_STOP,
        S.FAULT_REACTION_ACTIVE: C.DISABLE_VOLTAGE,
        S.FAULT: C.DISABLE_VOLTAGE,
    },
    T.SWITCHED_ON: {
        S.NOT_READY_TO_SWITCH_ON: C.DISABLE_VOLTAGE,
        S.SWITCH_ON_DISABLED: C.SHUTDOWN,
        S.READY_TO_SWITCH_ON: C.SWITCH_ON,
        S.SWITCHED_ON: C.SWITCH_ON,
        S.OPERATION_ENABLED: C.DISABLE_OPERATION,
        S.QUICK_STOP_ACTIVE: C.QUICK_STOP,
        S.FAULT_REACTION_ACTIVE: C.DISABLE_VOLTAGE,
        S.FAULT: C.DISABLE_VOLTAGE,
    },
    T.OPERATION_ENABLED: {
        S.NOT_READY_TO_SWITCH_ON: C.DISABLE_VOLTAGE,
        S.SWITCH_ON_DISABLED: C.SHUTDOWN,
        S.READY_TO_SWITCH_ON: C.SWITCH_ON,
        S.SWITCHED_ON: C.ENABLE_OPERATION,
        S.OPERATION_ENABLED: C.ENABLE_OPERATION,
        S.QUICK_STOP_ACTIVE: C.QUICK_STOP,
        S.FAULT_REACTION_ACTIVE: C.DISABLE_VOLTAGE,
        S.FAULT: C.DISABLE_VOLTAGE,
    },
    T.QUICK_STOP: {
        S.NOT_READY_TO_SWITCH_ON: C.DISABLE_VOLTAGE,
        S.SWITCH_ON_DISABLED: C.DISABLE_VOLTAGE,
        S.READY_TO_SWITCH_ON: C.QUICK_STOP,
        S.SWITCHED_ON: C.QUICK_STOP,
        S.OPERATION_ENABLED: C.QUICK_STOP,
        S.QUICK_STOP_ACTIVE: C.QUICK_STOP,
        S.FAULT_REACTION_ACTIVE: C.DISABLE_VOLTAGE,
        S.FAULT: C.DISABLE_VOLTAGE,
    },
    T.FAULT_RESET: {
        S.NOT_READY_TO_SWITCH_ON: C.DISABLE_VOLTAGE,
        S.SWITCH_ON_DISABLED: C.DISABLE_VOLTAGE,
        S.READY_TO_SWITCH_ON: C.DISABLE_VOLTAGE,
        S.SWITCHED_ON: C.SHUTDOWN,
        S.OPERATION_ENABLED: C.DISABLE_OPERATION,
        S.QUICK_STOP_ACTIVE: C.QUICK_STOP,
        S.FAULT_REACTION_ACTIVE: C.DISABLE_VOLTAGE,
        S.FAULT: C.FAULT_RESET,
    },
}


@pytest.mark.parametrize("target", Target)
@pytest.mark.parametrize("state", State)
def test_next_control_word(state, target):
    assert next_control_word(state, target) == WORDS[target][state]


def test_only_a_reset_raises_bit_7():
    for target in Target:
        for state in State:
            raised = bool(next_control_word(state, target) & 0x80)
            assert raised == (target is Target.FAULT_RESET and state is State.FAULT)
