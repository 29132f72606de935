"""Load-cell amplifier as an analogue input (CiA 404)."""

from __future__ import annotations

from enum import IntFlag

DEVICE_PROFILE = 404  # low word of the device type, object 1000h

NEWTON = 0x0021_0000  # AI physical unit PV, object 6131h: newton without prefix (codes of CiA 303-2)

AUTOZERO_SIGNATURE = int.from_bytes(b"zero", "little")  # written to AI autozero, object 6125h


class InputStatus(IntFlag):
    """Bits of AI status, object 6150h."""

    VALID = 0x00
    NOT_VALID = 0x01
    POSITIVE_OVERLOAD = 0x02
    NEGATIVE_OVERLOAD = 0x04


def status_text(status: int) -> str:
    """Return an AI status in words, such as ``positive overload``; ``valid`` when no bit is set."""
    words = {
        InputStatus.NOT_VALID: "not valid",
        InputStatus.POSITIVE_OVERLOAD: "positive overload",
        InputStatus.NEGATIVE_OVERLOAD: "negative overload",
    }
    named = [word for bit, word in words.items() if status & bit]
    if status & 0xF8:
        named.append(f"reserved bits 0x{status & 0xF8:02X}")
    return ", ".join(named) or "valid"
