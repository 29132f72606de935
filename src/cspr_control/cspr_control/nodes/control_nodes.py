"""The control nodes but for the motors': each puts one component of the graph to work, with its own parameters."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from cspr_control.components.component import Component
from cspr_control.components.feedforward import FeedforwardComponent
from cspr_control.components.payload import PayloadComponent
from cspr_control.components.pose import PoseComponent
from cspr_control.components.supervision import SupervisionComponent, watched_topics
from cspr_control.components.trajectory import TrajectoryComponent
from cspr_control.nodes.component_node import ComponentNode, executable
from cspr_control.nodes.publishers import doubled_topics
from cspr_control.parameters.settings import (
    estimator_settings,
    feedforward_settings,
    supervision_limits,
    trajectory_settings,
)
from cspr_control.supervision.verified_configuration import VerifiedConfiguration
from cspr_kinematics.warm_up import warm_up
from cspr_msgs_py.runtime.parameters import declare_all


class TrajectoryPublisher(ComponentNode):
    """trajectory_publisher: the reference of the platform, one point per control cycle."""

    def __init__(self, **options: Any) -> None:
        super().__init__("trajectory_publisher", **options)
        home = self.robot.home
        values = declare_all(self, move_position=home.position.tolist(), move_orientation=home.euler.tolist())
        settings = self.changeable(partial(trajectory_settings, self.robot))
        self.connect(TrajectoryComponent(self.robot, settings, 1.0 / values["control_rate"]))


class FeedforwardNode(ComponentNode):
    """feedforward: from the reference to the set-points of all motors."""

    def __init__(self, **options: Any) -> None:
        super().__init__("feedforward", **options)
        warm_up(self.robot)  # compiling takes long, and must not fall into a control cycle
        declare_all(self)
        settings = self.changeable(partial(feedforward_settings, self.robot.number_of_cables))
        self.connect(FeedforwardComponent(self.robot, settings))


class PoseEstimatorNode(ComponentNode):
    """pose_estimator: forward kinematics of motor angles and cable tensions."""

    def __init__(self, **options: Any) -> None:
        super().__init__("pose_estimator", **options)
        warm_up(self.robot)  # compiling takes long, and must not fall into a control cycle
        values = declare_all(self)
        self.connect(PoseComponent(self.robot, values["rate"], 1.0 / values["control_rate"]))


class MassEstimatorNode(ComponentNode):
    """mass_estimator: the payload from the cable tensions."""

    def __init__(self, **options: Any) -> None:
        super().__init__("mass_estimator", **options)
        warm_up(self.robot)  # compiling takes long, and must not fall into a control cycle
        declare_all(self)
        self.connect(PayloadComponent(self.robot, self.changeable(estimator_settings)))


class SupervisorNode(ComponentNode):
    """supervisor: enable, stop and faults of the robot as a whole."""

    def __init__(self, **options: Any) -> None:
        super().__init__("supervisor", **options)
        warm_up(self.robot)  # compiling takes long, and must not fall into a control cycle
        declare_all(self, length_misfit=self.robot.length_deviation)
        limits = self.changeable(partial(supervision_limits, self.robot))
        topics = watched_topics(self.robot.number_of_cables)
        doubled = partial(doubled_topics, self, topics)
        record = Path(self.get_parameter("robot_config").value).with_name("verified.json")
        verified = VerifiedConfiguration(record, self.robot)
        self.connect(SupervisionComponent(self.robot, limits, doubled, verified))


NODES: dict[type[Component], Any] = {
    TrajectoryComponent: TrajectoryPublisher,
    FeedforwardComponent: FeedforwardNode,
    PoseComponent: PoseEstimatorNode,
    PayloadComponent: MassEstimatorNode,
    SupervisionComponent: SupervisorNode,
}
"""The nodes by their components."""

trajectory_publisher = executable(TrajectoryPublisher)
feedforward = executable(FeedforwardNode)
pose_estimator = executable(PoseEstimatorNode)
mass_estimator = executable(MassEstimatorNode)
supervisor = executable(SupervisorNode)
