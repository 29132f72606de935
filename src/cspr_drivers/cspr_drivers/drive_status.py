"""What is known of one drive."""

from __future__ import annotations

from dataclasses import dataclass

from cspr_drivers.cia402 import State


@dataclass(frozen=True)
class DriveStatus:
    """State of one drive as last reported.

    Attributes
    ----------
    name
        Such as ``motor_1``.
    unavailable
        Why it cannot be used, empty when it is configured and not lost.
    status_word, state, brake_open
        As last reported; state `None` before the first report.
    error_code
        Of its last emergency message, 0 after "error reset".
    """

    name: str
    unavailable: str = "not configured yet"
    status_word: int = 0
    state: State | None = None
    brake_open: bool = False
    error_code: int = 0

    @property
    def state_name(self) -> str:
        """Name of the state on topics."""
        return "unknown" if self.state is None else self.state.value

    @property
    def held(self) -> bool:
        """Whether the brake holds the shaft, as far as is known."""
        return not self.brake_open and self.state not in (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)

    def describe(self) -> str:
        """Return the state in words, such as ``motor_3 is in fault (error code 0x8130)``."""
        code = f" (error code 0x{self.error_code:04X})" if self.error_code else ""
        return f"{self.name} is in {self.state_name}{code}"
