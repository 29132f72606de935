"""Error register and error history of an emulated device (CiA 301, objects 1001h and 1003h)."""

from __future__ import annotations

from cspr_drivers.canopen.emergency import error_register
from cspr_drivers.simulation.devices.canopen_codes import EmergencyCode

_HISTORY_LENGTH = 8  # subindices of 1003h in the EDS files


class ErrorLog:
    """Errors that are present, and those that were.

    Attributes
    ----------
    register
        Bits of 1001h, 0 when no error is present.
    history
        Codes reported, newest first.
    """

    def __init__(self) -> None:
        self.register = 0
        self.history: list[int] = []

    def report(self, code: EmergencyCode) -> bool:
        """Take note of an error; return whether it is news, and no repetition of the last one."""
        register = self.register | error_register(code)
        if register == self.register and self.history[:1] == [int(code)]:
            return False
        self.register = register
        self.history = [int(code), *self.history][:_HISTORY_LENGTH]
        return True

    def over(self) -> bool:
        """Take note that no error is present; return whether that is news."""
        news = self.register != 0
        self.register = 0
        return news
