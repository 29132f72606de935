"""The errors that a device has reported by emergency messages and not yet withdrawn (CiA 301, section 7.2.7)."""

from __future__ import annotations

from dataclasses import dataclass

from cspr_drivers.canopen.emergency_codes import in_register, is_error, meaning, register_text


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
