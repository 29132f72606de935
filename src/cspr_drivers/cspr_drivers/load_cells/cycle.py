"""What the load cells measure: frames in, the tensions of one SYNC out, and what is wrong with which cell.

All tensions of one SYNC come together; a missing value is never filled in. The cycle has no bus, no thread, no lock and
no clock: times are arguments, in seconds of one monotonic clock.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from cspr_drivers.canopen.cia404 import status_text
from cspr_drivers.canopen.emergency import ActiveErrors, Emergency, after
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.cycle.answer_balance import AnswerBalance
from cspr_drivers.cycle.cycle_watch import AnswerCounts, CycleWatch
from cspr_drivers.load_cells.stuck_cells import StuckCells

_SATURATED = "at the end of its measuring range"


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


class LoadCellCycle:
    """The m load cells of a configuration, from one SYNC to the next.

    Parameters
    ----------
    config
        Load cells, frame layout, times.

    Attributes
    ----------
    errors
        Of each cell, that it has reported by emergency messages and not withdrawn (m).
    sync_time
        Of the last SYNC, s; `None` before the first.
    """

    def __init__(self, config: CanConfig) -> None:
        count = len(config.load_cells)
        self.errors: list[ActiveErrors] = [()] * count
        self.sync_time: float | None = None
        self._cells = config.load_cells
        self._silence = config.timeouts.feedback
        self._layout = config.pdo.load_cell_tpdo
        self._stuck = StuckCells(count, config.load_cell_checks)
        self._heard = [-math.inf] * count
        self._status = [""] * count  # of the newest value of each cell, empty when it is valid
        self._spans: list[tuple[float, float]] = [(-math.inf, math.inf)] * count
        self._stamp_ns = 0  # of the last SYNC
        self._values: list[float | None] = [None] * count  # of the present cycle
        self._last = self._values  # of the cycle before
        self._answers = CycleWatch(count)
        self._balance = AnswerBalance(count, config.timeouts.feedback, config.period)
        self._doubled = [-math.inf] * count  # when a cell has answered more often than it was asked
        self._cycles = 0
        self._incomplete = 0
        self._missing = [0] * count
        self._problems: dict[str, str] = {}  # of the cycle before

    def sync(self, now: float, stamp_ns: int) -> None:
        """Begin the cycle of a SYNC; its stamp in ns of ROS time."""
        if self.sync_time is not None:
            silent = self._answers.missing
            self._cycles += 1
            self._last = self._values
            self._incomplete += None in self._values
            self._problems = {}
            for index, value in enumerate(self._values):
                if value is None:
                    self._missing[index] += 1
                    self._problems[self._cells[index].name] = (
                        "silent" if index in silent else self._status[index]
                    )
        self._answers.sync(counted=False)
        self._balance.sync()
        self.sync_time = now
        self._stamp_ns = stamp_ns
        self._values = [None] * len(self._cells)

    def measured(
        self, now: float, index: int, data: bytes | bytearray
    ) -> tuple[int, tuple[float, ...]] | None:
        """Process the frame of a cell; return stamp and tensions (m,), N, of the SYNC when it was the last one missing.

        Of several that come in a cycle the first valid one counts.

        Raises
        ------
        FrameError
            If the frame is cut short or too long.
        """
        value, status = self._layout.decode(data)
        if self.sync_time is not None and self._balance.answered(index):
            self._doubled[index] = now
            return None
        self._heard[index] = now
        if self._values[index] is not None:
            return None
        low, high = self._spans[index]
        problem = status_text(status) if status else "" if low < value < high else _SATURATED
        self._status[index] = problem
        if self.sync_time is None:
            return None
        # Amplifiers convert for a good part of a cycle. A value that comes after the next SYNC is counted as late and
        # used in the cycle in which it comes: unlike a position it is not differentiated.
        self._answers.is_late(index)
        self._answers.feedback(index, 0.0)
        if problem:
            return None
        self._values[index] = self._cells[index].units.tension(value)
        tensions = tuple(value for value in self._values if value is not None)
        if len(tensions) < len(self._cells):
            return None
        self._stuck.observe(now, tensions)
        return self._stamp_ns, tensions

    def configured(self, index: int, span: tuple[int | None, int | None]) -> None:
        """Note that a cell is configured: the values at the ends of its measuring range, as far as it says."""
        low, high = span
        self._spans[index] = (-math.inf if low is None else low, math.inf if high is None else high)

    def emergency(self, index: int, message: Emergency) -> None:
        """Process an emergency message of a cell."""
        self.errors[index] = after(self.errors[index], message)

    def problems(self, now: float, not_configured: Mapping[str, str]) -> dict[str, str]:
        """Return what is wrong with cells, by name; empty when all is well.

        Parameters
        ----------
        now
            s.
        not_configured
            Devices that are not configured, with the reason.
        """
        found = {}
        synchronous = self.sync_time is not None and now - self.sync_time < self._silence
        for index, cell in enumerate(self._cells):
            if (problem := not_configured.get(str(cell))) is not None:
                found[cell.name] = problem
            elif synchronous and now - self._heard[index] > self._silence:
                found[cell.name] = "silent"
            elif now - self._doubled[index] < self._silence:
                found[cell.name] = "answers one SYNC twice: another device has its node id"
            elif self._status[index]:
                found[cell.name] = self._status[index]
            elif index in self._stuck.stuck:
                found[cell.name] = "stuck: its value does not change while others do"
            elif self.errors[index]:
                found[cell.name] = f"reports {self.errors[index][-1].text}"
        return found

    def tare_refusal(self, limit: float) -> str | None:
        """Return why the cells must not be tared now, or `None`.

        A value of every cell in the last cycle is wanted, none of them beyond `limit`, N: the weight of the
        platform must not become zero.
        """
        for cell, value in zip(self._cells, self._last, strict=True):
            if value is None:
                return f"{cell.name} gives no valid value"
            if abs(value) > limit:
                return (
                    f"{cell.name} carries {value:z.0f} N: only slack cables, below {limit:g} N, can be tared"
                )
        return None

    def statistics(self) -> TensionStatistics:
        """Return the counts so far."""
        missing = {cell.name: count for cell, count in zip(self._cells, self._missing, strict=True) if count}
        return TensionStatistics(
            self._cycles, self._incomplete, missing, dict(self._problems), self._answers.statistics().answers
        )
