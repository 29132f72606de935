"""What is known about one drive."""

from __future__ import annotations

from dataclasses import dataclass

from cspr_drivers.canopen.cia402 import FOLLOWS_TARGET, VOLTAGE_ENABLED, State
from cspr_drivers.canopen.emergency import ActiveErrors


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
    errors
        That it has reported by emergency messages and not withdrawn.
    emergency_stop
        Whether its input for the emergency stop is active.
    slipped
        How far its motor has turned with the brake closed, rad, if the brake slips; else 0.
    """

    name: str
    unavailable: str = "not configured yet"
    status_word: int = 0
    state: State | None = None
    brake_open: bool = False
    errors: ActiveErrors = ()
    emergency_stop: bool = False
    slipped: float = 0.0

    @property
    def state_name(self) -> str:
        """Name of the state on topics."""
        return "unknown" if self.state is None else self.state.value

    @property
    def error_code(self) -> int:
        """Code of its newest error, 0 if there is none."""
        return self.errors[-1].code if self.errors else 0

    @property
    def held(self) -> bool:
        """Whether the brake holds the shaft, as far as is known."""
        return not self.brake_open and self.state not in (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)

    @property
    def in_operation(self) -> bool:
        """Whether the brake is open and the torque that of the target."""
        return self.state is State.OPERATION_ENABLED and self.brake_open and self.follows_target

    @property
    def follows_target(self) -> bool:
        """Whether it says that it follows the target torque; meaningful while operation is enabled."""
        return bool(self.status_word & FOLLOWS_TARGET)

    @property
    def without_power(self) -> bool:
        """Whether it says that the power stage has no supply."""
        return self.state is not None and not self.status_word & VOLTAGE_ENABLED

    def describe(self) -> str:
        """Return the state in words, such as ``motor_3 is in fault: RPDO timeout (error code 0x8250)``."""
        error = f": {self.errors[-1].text}" if self.errors else ""
        return f"{self.name} is in {self.state_name}{error}"
