"""control: all control nodes in one process."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.node import Node

from cspr_control.components.component import Component
from cspr_control.components.feedforward import FeedforwardComponent
from cspr_control.components.motor import MotorComponent
from cspr_control.components.payload import PayloadComponent
from cspr_control.components.pose import PoseComponent
from cspr_control.components.supervision import SupervisionComponent
from cspr_control.components.trajectory import TrajectoryComponent
from cspr_control.graph import ORDER
from cspr_control.nodes.component_node import Wiring
from cspr_control.nodes.feedforward import FeedforwardNode
from cspr_control.nodes.mass_estimator import MassEstimatorNode
from cspr_control.nodes.motor_control_gains import MotorControlGains
from cspr_control.nodes.pose_estimator import PoseEstimatorNode
from cspr_control.nodes.supervisor import SupervisorNode
from cspr_control.nodes.trajectory_publisher import TrajectoryPublisher
from cspr_control.parameters.settings import one_control_rate
from cspr_msgs_py.parameters.table import CONTROL_RATE
from cspr_msgs_py.runtime.process import run_nodes

_NODES: Mapping[type[Component], Any] = {
    MotorComponent: MotorControlGains,  # which creates one controller for each motor
    TrajectoryComponent: TrajectoryPublisher,
    FeedforwardComponent: FeedforwardNode,
    PoseComponent: PoseEstimatorNode,
    PayloadComponent: MassEstimatorNode,
    SupervisionComponent: SupervisorNode,
}


def create_control_nodes(wiring: Wiring | None = None, **options: Any) -> Sequence[Node]:
    """Create the nodes of all components, in the order of these.

    Raises
    ------
    SettingError
        If they do not agree on the rate of the control cycle.
    """
    options["wiring"] = wiring or Wiring()
    gains, *others = nodes = [_NODES[component](**options) for component in ORDER]
    rated = [node for node in nodes if node.has_parameter(CONTROL_RATE.name)]
    one_control_rate({node.get_name(): node.get_parameter(CONTROL_RATE.name).value for node in rated})
    return [gains, *gains.controllers, *others]


def main() -> int:
    """Run all control nodes."""
    return run_nodes(create_control_nodes)


if __name__ == "__main__":
    sys.exit(main())
