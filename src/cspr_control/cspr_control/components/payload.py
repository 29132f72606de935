"""The estimation of the payload as a component of the graph."""

from __future__ import annotations

from typing import Any, ClassVar

from cspr_control.components.component import NOTHING, Component, Outputs, Publication, Timer
from cspr_control.errors import MeasurementError
from cspr_control.estimation.payload import UPDATE_PERIOD, EstimatorSettings, PayloadEstimator
from cspr_kinematics import KinematicsError, Payload, Pose, Robot
from cspr_msgs_py.topics import CABLE_TENSIONS, PAYLOAD, PLATFORM_POSE, Topic
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import InertiaSample, PoseSample, Status


class PayloadComponent(Component):
    """Publishes the filtered, bounded and rate-limited payload from the first valid estimate on.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    settings
        See `EstimatorSettings`.
    initial
        Published before the first valid measurement, and where the rate limit starts; none by default.
    """

    inputs: ClassVar[tuple[Topic, ...]] = (CABLE_TENSIONS, PLATFORM_POSE)

    def __init__(self, robot: Robot, settings: EstimatorSettings, initial: Payload | None = None) -> None:
        super().__init__("mass_estimator", PAYLOAD)
        self.estimator = PayloadEstimator(robot, settings, initial)

    def configure(self, settings: EstimatorSettings) -> None:
        """Use other settings from the next update on."""
        self.estimator.settings = settings

    def on_cable_tensions(self, now: float, sample: JointStateSample) -> Outputs:
        """Store the tensions of all cables."""
        try:
            self.estimator.observe_tensions(now, sample.stamp_ns, sample.effort)
        except MeasurementError as error:
            self.refuse(CABLE_TENSIONS, str(error))
        return NOTHING

    def on_platform_pose(self, now: float, sample: PoseSample) -> Outputs:
        """Store the pose for which the tensions are evaluated."""
        try:
            pose = Pose.from_quaternion(sample.position, sample.quaternion_xyzw)
            self.estimator.observe_pose(now, sample.stamp_ns, pose)
        except KinematicsError as error:
            self.refuse(PLATFORM_POSE, str(error))
        return NOTHING

    def timers(self) -> tuple[Timer, ...]:
        """Return the update and the report."""
        return (*super().timers(), Timer(UPDATE_PERIOD, self.update))

    def update(self, now: float) -> Outputs:
        """Return the payload as it is now, and a report when the measurements become usable or cease to be."""
        before = self.estimator.newest.invalidities
        estimate = self.estimator.update(now)
        outputs: list[Any] = []
        if estimate.samples > 0:
            payload = estimate.published
            outputs.append(
                Publication(PAYLOAD, InertiaSample(estimate.stamp, payload.mass, payload.center_of_mass))
            )
        if estimate.invalidities != before:
            outputs += self.report(now)
        return outputs

    def status(self, now: float) -> Status:
        """Return the estimate, and why it is held if it is."""
        estimate = self.estimator.newest
        if estimate.valid:
            level, text = Level.OK, "estimating"
        else:
            causes = ", ".join(cause.value for cause in estimate.invalidities)
            level, text = Level.WARN, f"the estimate is held: {causes}"
        values = {
            "valid": str(estimate.valid).lower(),
            "invalidities": " ".join(cause.name.lower() for cause in estimate.invalidities),
            "samples": estimate.samples,
            "published_mass": f"{estimate.published.mass:z.3f}",
            "filtered_mass": f"{estimate.filtered_mass:z.3f}",
            "filtered_center_x": f"{estimate.filtered_center[0]:.4f}",
            "filtered_center_y": f"{estimate.filtered_center[1]:.4f}",
            "unusable_messages": self.unusable,
            "last_problem": self.problem,
        }
        if estimate.raw is not None:
            values |= {
                "raw_mass": f"{estimate.raw.mass:z.3f}",
                "raw_total_mass": f"{estimate.raw.total_mass:z.3f}",
            }
        return self._status(level, text, values)
