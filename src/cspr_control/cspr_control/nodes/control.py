"""control: all control nodes in one process."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from rclpy.node import Node

from cspr_control.nodes.component_node import Wiring
from cspr_control.nodes.control_nodes import (
    FeedforwardNode,
    MassEstimatorNode,
    PoseEstimatorNode,
    SupervisorNode,
    TrajectoryPublisher,
)
from cspr_control.nodes.motor_control_gains import MotorControlGains
from cspr_msgs_py.runtime.process import run_nodes


def create_control_nodes(wiring: Wiring | None = None, **options: Any) -> Sequence[Node]:
    """Create the nodes, motor controllers first: their answers to a motor state are the most urgent."""
    options["wiring"] = wiring or Wiring()
    gains = MotorControlGains(**options)
    others = (TrajectoryPublisher, FeedforwardNode, PoseEstimatorNode, MassEstimatorNode, SupervisorNode)
    return [gains, *gains.controllers, *(node(**options) for node in others)]


def main() -> int:
    """Run all control nodes."""
    return run_nodes(create_control_nodes)


if __name__ == "__main__":
    sys.exit(main())
