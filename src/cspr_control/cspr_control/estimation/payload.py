"""The payload in real time: estimated, checked, bounded and rate-limited before the feed-forward uses it."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_control.errors import MeasurementError
from cspr_control.estimation.cell_monitor import CellMonitor, CellMonitorSettings, CellObservation
from cspr_control.estimation.length_misfit import LengthMisfit
from cspr_control.estimation.motion_filter import MotionFilter, MotionSettings
from cspr_control.estimation.motor_tensions import MotorTensions, MotorView
from cspr_control.estimation.observation import Found, Held, Observation
from cspr_control.estimation.static_filter import StaticFilter, StaticSettings
from cspr_kinematics import CableFollower, Payload, Robot
from cspr_msgs_py.vocabulary import PayloadMethod
from cspr_msgs_py.wire.cdr import NANOSECONDS

_IRREGULAR = (
    0.05  # share by which a cycle may differ in length from the one before it, for the check of the cells
)
_LONGEST_STEP = (
    0.02  # s; over a longer gap, differences say nothing of the bounce of the platform on its cables
)


@dataclass(frozen=True)
class EstimatorSettings:
    """The parameters of `PayloadEstimator`, with meanings and units in `cspr_msgs_py.parameters.table`.

    Attributes
    ----------
    motion, static, cells
        Those of the two methods, and of the check of the load cells.
    """

    method: PayloadMethod
    mass_rate_limit: float
    center_rate_limit: float
    max_payload: float
    max_offset: float
    minimum_mass: float
    payload_height: float
    slack_tension: float
    slack_hold: float
    input_timeout: float
    motion: MotionSettings
    static: StaticSettings
    cells: CellMonitorSettings


@dataclass(frozen=True, eq=False)
class PayloadEstimate:
    """State of the estimation.

    Attributes
    ----------
    published
        Bounded and rate-limited: what the feed-forward may use.
    found
        What the method found last, before bounds and rate limit; None before it first did.
    held
        Why the newest cycle was not used; None if it was.
    length_misfit
        Largest difference between a cable's length and the path at the pose that fits all best, m; NaN without one.
    samples
        Number of estimates so far.
    stamp
        Of the newest cycle that was used, ROS time, ns; 0 before the first.
    """

    published: Payload
    found: Found | None
    held: Held | None
    length_misfit: float
    samples: int
    stamp: int


class PayloadEstimator:
    """Estimates the payload from motor angles and cable tensions of the same SYNC.

    What is published follows within bounds and at a limited rate, and stays as it is while a cycle is not usable. A
    load cell that balance and motors contradict is left out, and the estimate goes on with the others; the static
    method, whose balance holds at rest alone, cannot tell and believes them all.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    settings
        To begin with.

    Attributes
    ----------
    newest
        What is known now.
    cells
        Watches the load cells.
    lengths
        Whether the lengths of the run fit poses, as far as all cables were taut and all cells believed.
    """

    def __init__(self, robot: Robot, settings: EstimatorSettings) -> None:
        self._robot = robot
        self._settings = settings
        self._follower = CableFollower(robot)
        self._zeros = np.zeros(robot.number_of_cables)
        self._begun = False  # whether it is known where the estimate begins
        self._stamp = 0
        self._step = math.inf  # between the newest two cycles, s
        self._trusted_from = 0  # stamp, ns
        self.cells = CellMonitor(robot.number_of_cables, settings.cells, settings.motion.time_constant)
        self._motors = MotorTensions(robot)
        self.lengths = LengthMisfit(robot)
        self.newest = PayloadEstimate(Payload.none(), None, Held.NO_CYCLE, math.nan, 0, 0)
        self._filter = self._new_filter()

    @property
    def settings(self) -> EstimatorSettings:
        """Settings in use."""
        return self._settings

    @property
    def alarms(self) -> int:
        """Number of changes of the mass that the method detected."""
        return self._filter.alarms

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations of mass and first moment by the method's own account, kg and kg m; NaN if it has none."""
        return self._filter.deviations

    def configure(self, settings: EstimatorSettings) -> None:
        """Use other settings from the next cycle on; another method begins where the present one is."""
        other = settings.method is not self._settings.method
        self._settings = settings
        self.cells.settings, self.cells.filter_time = settings.cells, settings.motion.time_constant
        if other:
            self._filter = self._new_filter()
        elif isinstance(self._filter, MotionFilter):
            self._filter.settings = settings.motion
        else:
            self._filter.settings = settings.static

    def begin_at(self, payload: Payload) -> None:
        """Begin at what is in use already; of no account once there was an estimate."""
        if self.newest.samples == 0:
            self._begun = True
            self.newest = replace(self.newest, published=payload)
            self._filter.begin_at(payload)

    def believe_all_cells(self) -> None:
        """Begin with all load cells again, as after the operator has reset a fault."""
        before = self.cells.verdict.excluded
        self.cells.believe_all()
        self._exclude(before)

    def _new_filter(self) -> MotionFilter | StaticFilter:
        if self._settings.method is PayloadMethod.MOTION:
            return MotionFilter(self._robot, self._settings.motion, self.newest.published)
        return StaticFilter(self._robot, self._settings.static, self.newest.published)

    def observe(
        self, stamp: int, motor_angles: ArrayLike, tensions: ArrayLike, torques: ArrayLike | None = None
    ) -> PayloadEstimate:
        """Estimate the payload.

        Parameters
        ----------
        stamp
            Of the SYNC, ROS time, ns.
        motor_angles, tensions
            (m,) each, rad and N.
        torques
            Of the motors (m,), N m, while all brakes are open; None while they say nothing of the tensions.

        Raises
        ------
        MeasurementError
            If they are not m finite numbers; they are then not used.
        """
        follower = self._follower
        angles, measured = self._checked("motor angles", motor_angles), self._checked("tensions", tensions)
        pulling = None if torques is None else self._checked("torques", torques)
        step = (stamp - self._stamp) / NANOSECONDS
        if not 0.0 < step <= _LONGEST_STEP:
            step = math.inf
        # Accelerations of motors and platform, large against what a cell may err, need cycles of one length.
        regular = abs(step - self._step) <= _IRREGULAR * step
        if not regular:
            self.cells.forget()
            self._motors.clear()
        self._step = step
        self._stamp = stamp
        motors = self._observe_cells(stamp, step, angles, measured, pulling)
        excluded = self.cells.verdict.excluded
        slack = measured < self._settings.slack_tension
        if excluded is not None:
            slack[excluded] = False
        wait = Held.AFTER_SLACK if stamp < self._trusted_from else None
        if slack.any():
            if not self._in_doubt(slack, motors):
                self._trusted_from = stamp + round(self._settings.slack_hold * NANOSECONDS)
                return self._hold(Held.SLACK_CABLE)
            wait = Held.DOUBT
        if not (follower.follow(angles, measured, step) or self._found_from_home(angles, measured)):
            return self._hold(Held.NO_POSE)
        misfit = follower.misfit
        observation = Observation(
            step, follower.position, follower.rotation, follower.wrench, follower.jacobian
        )
        if self.cells.verdict.suspicion:
            wait = wait or Held.DOUBT
        if wait is None and excluded is None:
            self.lengths.observe(follower.lengths, follower.errors)
        found = self._filter.observe(observation, wait, excluded)
        if found is Held.JOLT:
            self.cells.forget()
        elif regular:
            self._check_cells(stamp, measured, motors)
        if isinstance(found, Held):
            self.newest = replace(self.newest, held=found, length_misfit=misfit)
        else:
            self.newest = PayloadEstimate(
                self._limited(found, step), found, None, misfit, self.newest.samples + 1, stamp
            )
            self._begun = True
        return self.newest

    def _found_from_home(self, angles: NDArray[np.float64], tensions: NDArray[np.float64]) -> bool:
        self._follower.begin_at(self._robot.home)
        return self._follower.follow(angles, tensions)

    def _checked(self, name: str, values: ArrayLike) -> NDArray[np.float64]:
        checked, m = np.asarray(values, dtype=float), self._robot.number_of_cables
        # a number times zero is finite if the number is; this takes a tenth of the time of numpy.isfinite
        if checked.shape != (m,) or not math.isfinite(float(checked @ self._zeros)):
            raise MeasurementError(f"{name} are {checked.tolist()}; {m} finite numbers are needed")
        return checked

    def _observe_cells(
        self,
        stamp: int,
        step: float,
        angles: NDArray[np.float64],
        measured: NDArray[np.float64],
        torques: NDArray[np.float64] | None,
    ) -> MotorView | None:
        """Note what cells and motors say; return the latter, if they say something."""
        before = self.cells.verdict.excluded
        self.cells.observe_readings(stamp / NANOSECONDS, measured)
        self._exclude(before)
        if torques is None:
            self._motors.clear()
            return None
        return self._motors.update(angles, torques, step)

    def _in_doubt(self, slack: NDArray[np.bool_], motors: MotorView | None) -> bool:
        """Return whether a cable seems slack that its motor pulls: then the reading may be wrong."""
        if motors is None or slack.sum() != 1:
            return False
        cable = int(slack.argmax())
        surely = motors.tensions[cable] - 3.0 * math.sqrt(motors.variance[cable])
        return bool(surely > self._settings.slack_tension)

    def _check_cells(
        self,
        stamp: int,
        measured: NDArray[np.float64],
        motors: MotorView | None,
    ) -> None:
        """Let the balance of this cycle say whether a cell is wrong; another one that is left out is a new begin."""
        if not isinstance(self._filter, MotionFilter) or self._filter.unexplained is None:
            return
        before = self.cells.verdict.excluded
        seen = CellObservation(self._follower.jacobian, self._filter.unexplained, measured, motors)
        self.cells.update(stamp / NANOSECONDS, seen)
        self._exclude(before)

    def _exclude(self, before: int | None) -> None:
        """Begin the filter anew if the verdict on the cells has changed."""
        if self.cells.verdict.excluded != before and isinstance(self._filter, MotionFilter):
            self._filter.reopen()

    def _hold(self, cause: Held) -> PayloadEstimate:
        self._filter.restart()
        self.cells.forget()  # not the motors: what they carry tells whether a cable is slack or its cell wrong
        self.newest = replace(self.newest, held=cause, length_misfit=math.nan)
        return self.newest

    def _limited(self, found: Found, step: float) -> Payload:
        settings, last = self._settings, self.newest.published
        assumed = (0.0, 0.0, settings.payload_height)
        told = found.mass > settings.minimum_mass
        center = [moment / found.mass for moment in found.moment.tolist()] if told else assumed
        mass_step, center_step = settings.mass_rate_limit * step, settings.center_rate_limit * step
        if not math.isfinite(step):
            mass_step = center_step = 0.0
        if not self._begun:  # nobody uses another one that this one could be a step from
            mass_step = center_step = math.inf
        mass = _moved(last.mass, found.mass, 0.0, settings.max_payload, mass_step)
        coordinates = [
            _moved(before, goal, middle - settings.max_offset, middle + settings.max_offset, center_step)
            for before, goal, middle in zip(last.center_of_mass.tolist(), center, assumed, strict=True)
        ]
        return Payload.trusted(mass, np.array(coordinates))


def _moved(before: float, goal: float, lowest: float, highest: float, step: float) -> float:
    """Return a number moved towards its goal, or the bound before that, by no more than a step."""
    change = min(max(goal, lowest), highest) - before
    return before + min(max(change, -step), step)
