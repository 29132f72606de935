"""Bookkeeping of the load cells: all tensions of one SYNC together; a missing value is never filled in."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cspr_drivers.cycle.cycle_watch import AnswerCounts, CycleWatch


@dataclass(frozen=True)
class CompleteTensions:
    """Tensions of all cables at one SYNC: its stamp in ns of ROS time, and (m,) in N."""

    stamp_ns: int
    tensions: tuple[float, ...]


@dataclass(frozen=True)
class TensionStatistics:
    """Counts since the start.

    Attributes
    ----------
    cycles
        Cycles that have ended.
    incomplete_cycles
        Those of them without a valid value of every cell.
    missing
        Cycles without a valid value, of each cell that has any.
    answers
        Of each cell, valid or not.
    problems
        What is wrong with a cell now: it is silent, or its status in words. Only cells with a problem.
    """

    cycles: int
    incomplete_cycles: int
    missing: dict[str, int]
    problems: dict[str, str]
    answers: tuple[AnswerCounts, ...]


class TensionCycle:
    """The present cycle of the load cells, and the statistics of those before it.

    Parameters
    ----------
    names
        Names of the cells (m).
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = tuple(names)
        self._stamp: int | None = None
        self._values: list[float | None] = [None] * len(self._names)
        self._last: list[float | None] = [None] * len(self._names)
        self._invalid: dict[int, str] = {}
        self._cycles = 0
        self._incomplete = 0
        self._missing = [0] * len(self._names)
        self._problems: dict[str, str] = {}
        self._answers = CycleWatch(len(self._names))

    def sync(self, stamp_ns: int) -> None:
        """End the present cycle and begin the next, whose SYNC has this stamp."""
        if self._stamp is not None:
            self._cycles += 1
            self._last = self._values
            self._incomplete += None in self._values
            self._problems = {}
            for index, value in enumerate(self._values):
                if value is None:
                    self._missing[index] += 1
                    self._problems[self._names[index]] = self._invalid.get(index, "silent")
        self._answers.sync(counted=False)
        self._stamp = stamp_ns
        self._values = [None] * len(self._names)
        self._invalid = {}

    def measured(self, index: int, tension: float, problem: str) -> CompleteTensions | None:
        """Process the value of a cell; return all tensions when it was the last one missing.

        Parameters
        ----------
        index
            Of the cell.
        tension
            N.
        problem
            Why the value is not valid, empty when it is.
        """
        if self._stamp is None or self._values[index] is not None:
            return None
        # Amplifiers convert for a good part of a cycle. A value that comes after the next SYNC is counted as late and
        # used in the cycle in which it comes: unlike a position it is not differentiated.
        self._answers.is_late(index)
        self._answers.feedback(index, 0.0)
        if problem:
            self._invalid[index] = problem
            return None
        self._values[index] = tension
        values = tuple(value for value in self._values if value is not None)
        return CompleteTensions(self._stamp, values) if len(values) == len(self._names) else None

    def tare_refusal(self, limit: float) -> str | None:
        """Return why the cells must not be tared now, or `None`.

        A value of every cell in the last cycle is wanted, none of them beyond `limit`, N: the weight of the
        platform must not become zero.
        """
        for name, value in zip(self._names, self._last, strict=True):
            if value is None:
                return f"{name} gives no valid value"
            if abs(value) > limit:
                return f"{name} carries {value:z.0f} N: only slack cables, below {limit:g} N, can be tared"
        return None

    def statistics(self) -> TensionStatistics:
        """Return the counts so far."""
        missing = {name: count for name, count in zip(self._names, self._missing, strict=True) if count}
        return TensionStatistics(
            self._cycles, self._incomplete, missing, dict(self._problems), self._answers.statistics().answers
        )
