"""Emergency messages: the error codes in words, and the errors that a device has reported and not yet withdrawn.

Sources: CiA 301, section 7.2.7 (emergency object, table of emergency error codes) and section 7.5.2.2 (error
register); CiA 402-2 / IEC 61800-7-201, object 603Fh (table of error codes). The codes, in `emergency_codes.csv`, form a
tree: a code that is not listed means at least what the code with its last digits zero means.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from importlib.resources import files


@dataclass(frozen=True)
class EmergencyMeaning:
    """What an emergency error code means: a text, and what to do about it."""

    text: str
    remedy: str


def _table() -> dict[int, EmergencyMeaning]:
    """Read the codes that are listed in the file beside this module."""
    lines = (files(__package__) / "emergency_codes.csv").read_text(encoding="utf-8").splitlines()
    entries = csv.DictReader(lines)
    return {int(e["code"], 16): EmergencyMeaning(e["text"], e["remedy"]) for e in entries}


EMERGENCY_CODES = _table()

# Error register, object 1001h (CiA 301, section 7.5.2.2).
ERROR_REGISTER_BITS = {
    0: "generic",
    1: "current",
    2: "voltage",
    3: "temperature",
    4: "communication",
    5: "device profile",
    7: "manufacturer",
}

# Bit of the error register that goes with the first digit of a code.
_REGISTER_BIT = {0x2: 1, 0x3: 2, 0x4: 3, 0x8: 4}


def meaning(code: int) -> EmergencyMeaning:
    """Return what an emergency error code means, from the nearest code of the tree that is listed."""
    for mask in (0xFFFF, 0xFFF0, 0xFF00, 0xF000):
        if found := EMERGENCY_CODES.get(code & mask):
            return found
    return EmergencyMeaning("unknown error", "see the device's manual")


def is_error(code: int) -> bool:
    """Return whether a code reports an error; codes 00xxh say that one is gone."""
    return bool(code & 0xFF00)


def error_register(code: int) -> int:
    """Return the bits of the error register, 1001h, that belong to an emergency code."""
    return 1 | 1 << _REGISTER_BIT.get(code >> 12, 0) if is_error(code) else 0


def in_register(code: int, register: int) -> bool:
    """Return whether an error of this code may still be present while the error register has this value."""
    bit = _REGISTER_BIT.get(code >> 12)
    return bool(register) if bit is None else bool(register & 1 << bit)


def register_text(register: int) -> str:
    """Return the error register in words, such as ``generic, temperature``; empty when it is 0."""
    return ", ".join(word for bit, word in ERROR_REGISTER_BITS.items() if register & 1 << bit)


@dataclass(frozen=True)
class Emergency:
    """One emergency message.

    Attributes
    ----------
    code
        Emergency error code.
    register
        Error register, 1001h.
    data
        The manufacturer's five bytes.
    time
        When it arrived, s of the monotonic clock.
    """

    code: int
    register: int
    data: bytes
    time: float

    @property
    def text(self) -> str:
        """The error in words, such as ``RPDO timeout (error code 0x8250)``."""
        return f"{meaning(self.code).text} (error code 0x{self.code:04X})"

    @property
    def remedy(self) -> str:
        """What to do about it."""
        return meaning(self.code).remedy

    def __str__(self) -> str:
        extra = f", data {self.data.hex(' ')}" if any(self.data) else ""
        return f"{self.text}, register 0x{self.register:02X} ({register_text(self.register)}){extra}"


ActiveErrors = tuple[Emergency, ...]
"""Errors that are present, oldest first."""


def after(active: ActiveErrors, message: Emergency) -> ActiveErrors:
    """Return the errors that are present after a message.

    A message "error reset" (00xxh) with an empty register ends all of them. With a register that is not empty some
    are still present: those whose bit is set.
    """
    if is_error(message.code):
        return (*(error for error in active if error.code != message.code), message)
    return tuple(error for error in active if in_register(error.code, message.register))
