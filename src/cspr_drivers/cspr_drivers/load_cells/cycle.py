"""What the load cells measure: frames in, the tensions of one SYNC out, and what is wrong with which cell.

It has no bus, no thread, no lock and no clock: times are arguments, in seconds of one monotonic clock.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from cspr_drivers.canopen.cia404 import status_text
from cspr_drivers.canopen.emergency import ActiveErrors, Emergency, after
from cspr_drivers.canopen.frame_table import INPUT_STATUS, PROCESS_VALUE
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.load_cells.stuck_cells import StuckCells
from cspr_drivers.load_cells.tension_cycle import CompleteTensions, TensionCycle

_SATURATED = "at the end of its measuring range"


class LoadCellCycle:
    """The m load cells of a configuration, from one SYNC to the next.

    Parameters
    ----------
    config
        Load cells, frame layout, times.

    Attributes
    ----------
    tensions
        The present cycle and its statistics.
    errors
        Of each cell, that it has reported by emergency messages and not withdrawn (m).
    sync_time
        Of the last SYNC, s; `None` before the first.
    """

    def __init__(self, config: CanConfig) -> None:
        count = len(config.load_cells)
        self.tensions = TensionCycle([cell.name for cell in config.load_cells])
        self.errors: list[ActiveErrors] = [()] * count
        self.sync_time: float | None = None
        self._cells = config.load_cells
        self._silence = config.timeouts.feedback
        self._layout = config.pdo.load_cell_tpdo
        self._value_place = self._layout.position(PROCESS_VALUE)
        self._status_place = self._layout.position(INPUT_STATUS)
        self._stuck = StuckCells(count, config.load_cell_checks)
        self._heard = [-math.inf] * count
        self._status = [""] * count  # of the newest value of each cell, empty when it is valid
        self._spans: list[tuple[float, float]] = [(-math.inf, math.inf)] * count

    def sync(self, now: float, stamp_ns: int) -> None:
        """Begin the cycle of a SYNC; its stamp in ns of ROS time."""
        self.sync_time = now
        self.tensions.sync(stamp_ns)

    def measured(self, now: float, index: int, data: bytes | bytearray) -> CompleteTensions | None:
        """Process the frame of a cell; return all tensions when it was the last one missing.

        Raises
        ------
        FrameError
            If the frame is cut short or too long.
        """
        values = self._layout.decode(data)
        value, status = values[self._value_place], values[self._status_place]
        low, high = self._spans[index]
        problem = status_text(status) if status else "" if low < value < high else _SATURATED
        self._heard[index] = now
        self._status[index] = problem
        complete = self.tensions.measured(index, self._cells[index].units.tension(value), problem)
        if complete is not None:
            self._stuck.observe(now, complete.tensions)
        return complete

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
            elif self._status[index]:
                found[cell.name] = self._status[index]
            elif index in self._stuck.stuck:
                found[cell.name] = "stuck: its value does not change while others do"
            elif self.errors[index]:
                found[cell.name] = f"reports {self.errors[index][-1].text}"
        return found
