"""Which load cell is wrong: the spare equations of the balance and the cable's own motor, together.

A payload explains three of the six components of the wrench that the cells report: the vertical force and the moments
about x and y. The sideways forces and the moment about z are spare: with sound cells they vanish but for what pushes
the platform from outside. A cell that is wrong by d leaves d times its column of the wrench matrix there. Statics alone
cannot tell a push from a wrong cell, nor two cells from each other whose columns are nearly parallel (2.8 degrees for
the crossed pairs of the prototype at home). The motors can: each knows the tension of its own cable from its torque,
to the uncertainty of friction and inertia, and a push changes both alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspr_control.estimation.motor_tensions import MotorView
from cspr_control.estimation.stuck import StuckReadings
from cspr_control.estimation.two_poles import TwoPoles

FloatArray = NDArray[np.float64]

_SPARE = np.array([0, 1, 5])  # F_x, F_y, M_z
_LEVERS = np.array(
    [1.0, 1.0, 0.15]
)  # the last in m: turns the uncertainty of a force into that of the moment about z
_MARGIN = (
    4.0  # squared standard deviations by which a cell must explain more than a push, and than any other cell
)
_FITS = 3.0  # standard deviations within which both know the same error
_ERROR_SHARE = 0.1  # of an error, by which pose and delays may change it
_AGREEMENT = 0.5  # share of the tolerance within which a cell that was left out agrees with the others again


@dataclass(frozen=True)
class CellMonitorSettings:
    """The parameters of `CellMonitor`, with meanings and units in `cspr_msgs_py.parameters.table`."""

    cell_tolerance: float
    cell_confirmation: float
    cell_recovery: float
    stuck_time: float
    slack_tension: float


class CellObservation(NamedTuple):
    """What one cycle tells of the cells, all of it for the same moment and unfiltered.

    Attributes
    ----------
    jacobian
        J (m, 6), so that A = -J^T.
    residual
        Wrench (6,) of all cells less that of platform, payload and ropes in this motion, N and N m.
    tensions
        As the cells read (m,), N.
    motors
        What the motors know of the tensions; None while their brakes are closed.
    """

    jacobian: FloatArray
    residual: FloatArray
    tensions: FloatArray
    motors: MotorView | None


@dataclass(frozen=True)
class CellVerdict:
    """What is known of the load cells.

    Attributes
    ----------
    excluded
        Index of the cell that is not believed; None if all are.
    cause
        Why, in words; empty if all are.
    suspicion
        Whether one cell explains what no payload does, but not for long enough: an estimate had better wait.
    """

    excluded: int | None = None
    cause: str = ""
    suspicion: bool = False


class CellMonitor:
    """Watches the load cells, and says which one is wrong.

    One cell at a time: the balance of six equations with seven cells cannot tell a second one. A cell that is left out
    stays so until the operator resets the fault, or until it has agreed with the others for `cell_recovery` seconds
    with the brakes closed: nothing changes under a load that moves.

    Parameters
    ----------
    count
        Number m of cells.
    settings
        See `CellMonitorSettings`; may be replaced at any time.
    filter_time
        Time constant of each of two poles against the noise, s; likewise.

    Attributes
    ----------
    verdict
        What is known now.
    unexplained
        Largest spare component of the last cycle, as a multiple of the tolerance; above 1 something is wrong.
    """

    def __init__(self, count: int, settings: CellMonitorSettings, filter_time: float) -> None:
        self.settings, self.filter_time = settings, filter_time
        self.verdict = CellVerdict()
        self.unexplained = 0.0
        self._stuck = StuckReadings(count)
        self._spare, self._differences = TwoPoles(), TwoPoles()
        self._suspect: int | None = None
        self._suspected_since = math.inf
        self._agrees_since = math.inf

    def forget(self) -> None:
        """Begin anew after a gap, or after what was not to be believed; what was decided stays."""
        self._spare.clear()
        self._differences.clear()
        self._drop_suspicion()

    def believe_all(self) -> None:
        """Believe all cells, as the operator does who resets a fault; one that is still wrong is found again."""
        self.verdict = CellVerdict()
        self.forget()

    def _drop_suspicion(self) -> None:
        self._suspect, self._suspected_since = None, math.inf
        self._agrees_since = math.inf
        if self.verdict.suspicion:
            self.verdict = CellVerdict(self.verdict.excluded, self.verdict.cause)

    def observe_readings(self, time: float, tensions: FloatArray) -> None:
        """Note what the cells read (m,), N, unfiltered, at monotonic ``time``, s; a stuck one is left out at once."""
        self._stuck.observe(time, tensions)
        stuck = self._stuck.longest(time, self.settings.stuck_time)
        if stuck is not None and self.verdict.excluded is None:
            cell, duration = stuck
            self._exclude(cell, f"has shown exactly {tensions[cell]:zg} N for {duration:.1f} s")

    def update(self, time: float, seen: CellObservation) -> CellVerdict:
        """Judge one cycle at monotonic ``time``, s, not before the last call's."""
        spare = self._spare.update(time, seen.residual[_SPARE], self.filter_time) / self._tolerance()
        self.unexplained = max(map(abs, spare.tolist()))
        if seen.motors is None:
            self._differences.clear()
        else:
            beyond = seen.tensions - seen.motors.tensions
            difference = self._differences.update(time, beyond, self.filter_time)
        if self.verdict.excluded is not None:
            self._watch_recovery(time, self.verdict.excluded, seen.motors is None)
            return self.verdict
        if self.unexplained <= 1.0 or seen.motors is None:
            self._drop_suspicion()
            return self.verdict
        suspect = self._isolate(spare, -seen.jacobian.T, seen.tensions, difference, seen.motors.variance)
        if suspect is None or suspect != self._suspect:
            self._suspect, self._suspected_since = suspect, time
        confirmation = self.settings.cell_confirmation
        if suspect is not None and time - self._suspected_since >= confirmation:
            reads = seen.tensions[suspect]
            carries = reads - difference[suspect]
            self._exclude(suspect, f"reads {reads:z.0f} N, its motor carries {carries:z.0f} N")
            return self.verdict
        self.verdict = CellVerdict(suspicion=suspect is not None)
        return self.verdict

    def _tolerance(self) -> FloatArray:
        return self.settings.cell_tolerance * _LEVERS

    def _isolate(
        self,
        spare: FloatArray,
        wrench_matrix: FloatArray,
        tensions: FloatArray,
        difference: FloatArray,
        variance: FloatArray,
    ) -> int | None:
        """Return the cell whose error explains the spare components and the disagreement with its motor alike."""
        # In standard deviations: the tolerance is three of them.
        spare = 3.0 * spare
        columns = 3.0 * wrench_matrix[_SPARE] / self._tolerance()[:, None]
        error = spare @ columns / np.einsum("ij,ij->j", columns, columns)
        left = ((spare[:, None] - columns * error) ** 2).sum(axis=0)
        unexplained = (difference - error) ** 2
        gain = (difference**2 - unexplained) / variance - left
        # A cell is wrong by the same in both: else the motor does not hold what it applies, and its cell is right.
        gain = np.where(unexplained <= _FITS**2 * (variance + (_ERROR_SHARE * error) ** 2), gain, -math.inf)
        # Where a cable is slack its column says nothing, unless it is the reading that is wrong.
        slack = tensions < self.settings.slack_tension
        if slack.any():
            gain = np.where(slack & (slack.sum() == 1), gain, -math.inf)
        best = int(gain.argmax())
        rest = np.delete(gain, best).max()
        return best if gain[best] > _MARGIN and gain[best] - rest > _MARGIN else None

    def _exclude(self, cell: int, cause: str) -> None:
        self._agrees_since = math.inf
        self.verdict = CellVerdict(cell, f"cable_{cell + 1} {cause}")

    def _watch_recovery(self, time: float, cell: int, braked: bool) -> None:
        """Believe a cell again that has agreed with the others for a while, with the brakes closed."""
        stuck = self._stuck.longest(time, self.settings.stuck_time)
        agrees = self.unexplained < _AGREEMENT and braked and not (stuck and stuck[0] == cell)
        self._agrees_since = min(self._agrees_since, time) if agrees else math.inf
        if time - self._agrees_since >= self.settings.cell_recovery:
            self.verdict = CellVerdict()
            self._drop_suspicion()
