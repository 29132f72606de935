"""A number that the robot is held to."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Row:
    """What was measured in a scenario, and its aim.

    Attributes
    ----------
    scenario, what
        In words.
    measured, aim
        In the unit; NaN reaches nothing.
    unit
        Of both.
    at_least
        Whether the aim is a lower limit; an upper one otherwise.
    note
        What else is to be known.
    """

    scenario: str
    what: str
    measured: float
    aim: float
    unit: str = ""
    at_least: bool = False
    note: str = ""

    @property
    def reached(self) -> bool:
        """Whether the aim is reached."""
        return self.measured >= self.aim if self.at_least else self.measured <= self.aim

    def values(self) -> dict[str, Any]:
        """Return all of it by name."""
        return asdict(self) | {"reached": self.reached}

    def __str__(self) -> str:
        """Format a line of the table."""
        aim = f"{'>=' if self.at_least else '<='} {self.aim:g}"
        line = f"{self.scenario:40}{self.what:46}{self.measured:>10.4g}{aim:>11} {self.unit:6}"
        line += "reached" if self.reached else "MISSED"
        return f"{line}  ({self.note})" if self.note else line
