"""Network management of CANopen (CiA 301): states of nodes, and commands to them."""

from __future__ import annotations

from enum import IntEnum


class NmtState(IntEnum):
    """NMT state of a node as its heartbeat carries it (CiA 301, section 7.2.8.3.2.2)."""

    BOOT_UP = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


class NmtCommand(IntEnum):
    """Command specifier of an NMT frame (CiA 301, section 7.2.8.3.1)."""

    START = 1
    STOP = 2
    ENTER_PRE_OPERATIONAL = 128
    RESET_NODE = 129
    RESET_COMMUNICATION = 130


_TEXTS: dict[int, str] = {state: state.name.lower().replace("_", "-") for state in NmtState}


def nmt_state_text(state: int | None) -> str:
    """Return the NMT state of a heartbeat in words; `None` before the first one."""
    return "unknown" if state is None else _TEXTS.get(state, f"state {state}")
