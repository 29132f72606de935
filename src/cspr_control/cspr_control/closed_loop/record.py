"""What happened in the closed loop while a trajectory was followed, as arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.analysis.numbers.mass import MassMetrics, MassTrace, mass_metrics
from cspr_control.analysis.sample_memory import SampleMemory
from cspr_control.closed_loop.loop import ClosedLoop, ClosedLoopError
from cspr_control.closed_loop.scenario import Scenario
from cspr_msgs_py.topics import MOTOR_STATES, REFERENCE, SETPOINT, TRUE_POSE, Topic
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.reference import ReferenceSample
from cspr_msgs_py.wire.samples import PoseSample

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class LoopRecord:
    """What happened between the start and the end of the trajectory; n cycles, m motors.

    Attributes
    ----------
    scenario
        What was run.
    time
        (n,) s after the start.
    position_error, velocity_error
        (n, m) desired minus measured, rad and rad/s.
    platform_error
        (n, 3) desired minus true position of the platform, m.
    tensions, asked_tensions
        (n, m) true ones, and those behind the feed-forward torque, N.
    torque
        (n, m) commanded, N m; NaN where no command answered.
    mass_estimate, mass_true
        (n,) of the payload, kg.
    simulated, elapsed
        How long the whole run was, s, and how much of the processor's time it took, s.
    cause
        What stopped the robot, in words; empty if nothing did.
    published
        All that was published, if it was to be kept.
    """

    scenario: Scenario
    time: FloatArray
    position_error: FloatArray
    velocity_error: FloatArray
    platform_error: FloatArray
    tensions: FloatArray
    asked_tensions: FloatArray
    torque: FloatArray
    mass_estimate: FloatArray
    mass_true: FloatArray
    simulated: float
    elapsed: float
    cause: str
    published: SampleMemory | None = None

    @property
    def errors(self) -> ErrorStatistics:
        """Of the position of each motor (m,), degrees."""
        return ErrorStatistics.of(np.degrees(self.position_error))

    @property
    def rms_deg(self) -> FloatArray:
        """RMS position error of each motor (m,), degrees."""
        return self.errors.rms

    @property
    def mass(self) -> MassMetrics:
        """How good the estimate of the payload's mass was; times are s after the start."""
        stamps = np.rint(self.time * 1e9).astype(np.int64)
        mass = mass_metrics(MassTrace(stamps, self.mass_estimate), MassTrace(stamps, self.mass_true), 0)
        assert mass is not None  # a record has samples
        return mass

    @property
    def mass_error(self) -> float:
        """Estimated minus true mass at the end, kg."""
        return float(self.mass_estimate[-1] - self.mass_true[-1])

    @property
    def settling_time(self) -> float:
        """Time from the change of the payload until the estimate is within 2 % for good, s; inf if never."""
        settled = self.mass.settling
        return np.inf if settled is None else settled


class _Cycle(NamedTuple):
    stamp_ns: int
    position_error: FloatArray
    velocity_error: FloatArray
    platform_error: FloatArray
    tensions: FloatArray
    asked_tensions: FloatArray
    torque: FloatArray
    mass_estimate: float
    mass_true: float


class LoopRecorder:
    """Listens to a closed loop and keeps what a `LoopRecord` is made of."""

    def __init__(self, loop: ClosedLoop[Any]) -> None:
        self._loop = loop
        components: dict[str, Any] = dict(loop.graph.components)
        self._feedforward = components["feedforward"]
        self._estimator = components["mass_estimator"].estimator
        self._motors = loop.motors
        self._setpoint: JointStateSample | None = None
        self._reference: ReferenceSample | None = None
        self._true_pose: PoseSample | None = None
        self._cycles: list[_Cycle] = []
        loop.listeners.append(self._listen)

    def record(self, scenario: Scenario, simulated: float, elapsed: float) -> LoopRecord:
        """Return the cycles from the start of the trajectory to its end, or to where the robot was stopped.

        Raises
        ------
        ClosedLoopError
            If the robot was stopped before the trajectory began.
        """
        start, end = self._loop.player.start_time, self._loop.player.end_time
        cycles = [cycle for cycle in self._cycles if start <= cycle.stamp_ns < end]
        if len(cycles) < 2:
            raise ClosedLoopError(f"the trajectory did not begin: {self._loop.cause}")
        columns: dict[str, Any] = {
            name: np.array(column)
            for name, column in zip(_Cycle._fields, zip(*cycles, strict=True), strict=True)
        }
        time = (columns.pop("stamp_ns") - start) * 1e-9
        return LoopRecord(
            scenario, time, **columns, simulated=simulated, elapsed=elapsed, cause=self._loop.cause
        )

    def _listen(self, topic: Topic, sample: Any) -> None:
        if topic is SETPOINT:
            self._setpoint = sample
        elif topic is REFERENCE:
            self._reference = sample
        elif topic is TRUE_POSE:
            self._true_pose = sample
        elif topic is MOTOR_STATES:
            if self._setpoint is not None and self._loop.player.start_time:
                self._keep(sample, self._setpoint)
        elif (motor := self._motors.get(topic.name)) is not None and self._cycles:
            self._cycles[-1].torque[motor] = sample.effort

    def _keep(self, states: JointStateSample, setpoint: JointStateSample) -> None:
        plant, estimate = self._loop.machine.plant, self._estimator.newest
        self._cycles.append(
            _Cycle(
                states.stamp_ns,
                setpoint.position - states.position,
                setpoint.velocity - states.velocity,
                self._platform_error(states.stamp_ns),
                plant.tensions(),
                self._feedforward.newest.tensions,
                np.full(states.position.shape, np.nan),
                estimate.published.mass,
                plant.payload.mass,
            )
        )

    def _platform_error(self, stamp_ns: int) -> FloatArray:
        """Return where the platform should be less where it is (3,), m; NaN if one of both is of another moment."""
        reference, true = self._reference, self._true_pose
        if reference is None or true is None or not reference.stamp_ns == true.stamp_ns == stamp_ns:
            return np.full(3, np.nan)
        return reference.position - true.position
