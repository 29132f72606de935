"""Load cells that keep showing the same value while others change: noise keeps a sound cell from doing that."""

from __future__ import annotations

from cspr_drivers.config.can_file import LoadCellChecks


class StuckCells:
    """Since when each cell has not changed, and what the other cells showed at that moment.

    Parameters
    ----------
    count
        Number of cells (m).
    checks
        Time without change, and change of the other tensions, after which a cell is stuck.

    Attributes
    ----------
    stuck
        Cells that are stuck; each stays so until its value changes.
    """

    def __init__(self, count: int, checks: LoadCellChecks) -> None:
        self._checks = checks
        self._last: tuple[float, ...] = (float("nan"),) * count
        self._since = [0.0] * count
        self._then: list[tuple[float, ...]] = [()] * count
        self.stuck: frozenset[int] = frozenset()

    def observe(self, time: float, tensions: tuple[float, ...]) -> None:
        """Process the tensions (m,), N, of one SYNC at a time, s."""
        last, self._last = self._last, tensions
        for index, (now, before) in enumerate(zip(tensions, last, strict=True)):
            if now != before:
                self._since[index] = time
                self._then[index] = tensions
                self.stuck -= {index}
            elif time - self._since[index] > self._checks.stuck_time:
                change = max(abs(a - b) for a, b in zip(tensions, self._then[index], strict=True))
                if change > self._checks.stuck_span:
                    self.stuck |= {index}
