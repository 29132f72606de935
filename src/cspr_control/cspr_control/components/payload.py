"""The estimation of the payload as a component of the graph."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import numpy as np

from cspr_control.components.component import NOTHING, Component, Outputs, Publication, Remark
from cspr_control.errors import MeasurementError
from cspr_control.estimation.observation import Held
from cspr_control.estimation.payload import EstimatorSettings, PayloadEstimator
from cspr_control.estimation.sync_pairs import SyncPair, SyncPairs
from cspr_kinematics import KinematicsError, Payload, Robot
from cspr_msgs_py.topics import (
    CABLE_TENSIONS,
    EXTERNAL_WRENCH,
    LOAD_CELL_CHECK,
    MOTOR_STATES,
    PAYLOAD,
    PAYLOAD_IN_USE,
    ROBOT_STATE,
    Topic,
)
from cspr_msgs_py.vocabulary import UNDER_TORQUE, CellCheck, HealthKey, Level, RobotState
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import InertiaSample, Status, WrenchSample

_SETTLED = 0.5  # s under torque after which all brakes are open and the motors have settled
_WARM_UP = 40  # cycles until all of the estimation has run once


class PayloadComponent(Component):
    """Publishes the payload for every SYNC, from the first estimate on; it begins at the payload that is in use.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    settings
        See `EstimatorSettings`.
    """

    inputs: ClassVar[tuple[Topic, ...]] = (
        MOTOR_STATES,
        CABLE_TENSIONS,
        PAYLOAD_IN_USE,
        ROBOT_STATE,
    )

    def __init__(self, robot: Robot, settings: EstimatorSettings) -> None:
        super().__init__("mass_estimator", PAYLOAD, EXTERNAL_WRENCH, LOAD_CELL_CHECK)
        self.estimator = PayloadEstimator(robot, settings)
        self._pairs = SyncPairs()
        self._arrived = -math.inf  # when the newest pair was complete, s
        self._robot_state: RobotState | None = None
        self._under_torque_since = math.inf  # s
        # The first computations are slower than the others; they must not fall into a control cycle.
        spare = PayloadEstimator(robot, settings)
        taut = np.full(robot.number_of_cables, 2.0 * settings.slack_tension)
        for cycle in range(_WARM_UP):
            spare.observe(cycle * 4_000_000, 0.0 * taut, taut, robot.winch.motor_torque(taut))

    def configure(self, settings: EstimatorSettings) -> None:
        """Use other settings from the next cycle on."""
        self.estimator.configure(settings)

    def begin(self) -> Outputs:
        """Return that all load cells are believed."""
        return (self._cell_check(),)

    def on_robot_state(self, now: float, sample: Status) -> Outputs:
        """Note since when torques and tensions belong together; believe all cells again after a reset."""
        before, self._robot_state = self._robot_state, self.read_word(ROBOT_STATE, RobotState, sample.message)
        under_torque = self._robot_state in UNDER_TORQUE
        self._under_torque_since = min(self._under_torque_since, now) if under_torque else math.inf
        if before is not RobotState.FAULT or self._robot_state is RobotState.FAULT:
            return NOTHING
        self.estimator.believe_all_cells()
        return (self._cell_check(),)

    def on_payload_in_use(self, now: float, sample: InertiaSample) -> Outputs:
        """Begin at the payload that the feed-forward counts on, so that a restart is no step of its torque."""
        try:
            self.estimator.begin_at(Payload(sample.mass, sample.center_of_mass))
        except KinematicsError as error:
            self.refuse(PAYLOAD_IN_USE, str(error))
        return NOTHING

    def on_motor_states(self, now: float, sample: JointStateSample) -> Outputs:
        """Take the motor angles; return the payload if the tensions are there already."""
        return self._estimate(now, self._pairs.motors(sample))

    def on_cable_tensions(self, now: float, sample: JointStateSample) -> Outputs:
        """Take the tensions of all cables; return the payload if the motor angles are there."""
        return self._estimate(now, self._pairs.tensions(sample.stamp_ns, sample.effort))

    def _estimate(self, now: float, pair: SyncPair | None) -> Outputs:
        if pair is None:
            return NOTHING
        before, believed = self.estimator.newest.held, self.estimator.cells.verdict.excluded
        torques = pair.torques if now - self._under_torque_since >= _SETTLED else None
        try:
            estimate = self.estimator.observe(pair.stamp, pair.motor_angles, pair.tensions, torques)
        except MeasurementError as error:
            self.refuse(CABLE_TENSIONS, str(error))
            return NOTHING
        self._arrived = now
        outputs: list[Any] = []
        if estimate.samples > 0:
            mass, center = estimate.published.mass, estimate.published.center_of_mass
            outputs.append(Publication(PAYLOAD, InertiaSample(estimate.stamp, mass, center)))
        if estimate.held is None and estimate.found is not None:
            wrench = estimate.found.external_wrench
            if wrench is not None:
                outputs.append(
                    Publication(EXTERNAL_WRENCH, WrenchSample(estimate.stamp, wrench[:3], wrench[3:]))
                )
        if (verdict := self.estimator.cells.verdict).excluded != believed:
            outputs.append(self._cell_check())
            text = (
                f"load cell left out: {verdict.cause}"
                if verdict.cause
                else "all load cells are believed again"
            )
            outputs.append(Remark(self.name, Level.ERROR if verdict.cause else Level.OK, text))
        if estimate.held is not before:
            outputs += self.report(now)
        return outputs

    def _cell_check(self) -> Publication:
        verdict = self.estimator.cells.verdict
        cell = "" if verdict.excluded is None else f"cable_{verdict.excluded + 1}"
        state = CellCheck.SOUND if verdict.excluded is None else CellCheck.EXCLUDED
        level = Level.OK if verdict.excluded is None else Level.ERROR
        values = {"cell": cell, "cause": verdict.cause}
        return Publication(LOAD_CELL_CHECK, self._status(level, state.value, values))

    def status(self, now: float) -> Status:
        """Return the estimate, how sure it is, and why it is held if it is."""
        estimator, estimate = self.estimator, self.estimator.newest
        held = estimate.held
        if held is not Held.NO_CYCLE and now - self._arrived > estimator.settings.input_timeout:
            held = Held.STALE
        compared = held is None or held is Held.DOUBT
        level, text = Level.OK, "estimating"
        if held is not None:
            level, text = Level.WARN, f"the estimate is held: {held.value}"
        elif cause := estimator.cells.verdict.cause:
            level, text = Level.ERROR, f"estimating without a load cell: {cause}"
        else:
            doubts = []
            if estimator.cells.unexplained > 1.0:
                doubts.append("something pushes the platform, or a load cell is wrong")
            if problem := estimator.lengths.problem:
                doubts.append(f"the mass may be wrong: {problem}")
            if doubts:
                level, text = Level.WARN, f"estimating, but {'; '.join(doubts)}"
        values: dict[str, Any] = {
            "method": estimator.settings.method.value,
            "valid": str(held is None).lower(),
            "held_by": "" if held is None else held.name.lower(),
            "samples": estimate.samples,
            "alarms": estimator.alarms,
            "published_mass": f"{estimate.published.mass:z.3f}",
            "cell_excluded": ""
            if (cell := estimator.cells.verdict.excluded) is None
            else f"cable_{cell + 1}",
            HealthKey.CELLS_UNEXPLAINED.value: f"{estimator.cells.unexplained:.3f}" if compared else "",
            "length_misfit": f"{estimate.length_misfit:.6f}",
            "length_misfit_rms": f"{estimator.lengths.rms:.6f}" if estimator.lengths.places else "",
            "unpaired_messages": self._pairs.unpaired,
            "unusable_messages": self.unusable,
            "last_problem": self.problem,
        }
        if (found := estimate.found) is not None:
            mass_deviation, moment_deviation = estimator.deviations
            heavy = max(found.mass, estimator.settings.minimum_mass)
            values |= {
                "estimated_mass": f"{found.mass:z.3f}",
                "mass_std": f"{mass_deviation:.3f}",
                "center_std": f"{moment_deviation / heavy:.4f}",
                "center": " ".join(f"{coordinate:z.4f}" for coordinate in estimate.published.center_of_mass),
            }
        return self._status(level, text, values)
