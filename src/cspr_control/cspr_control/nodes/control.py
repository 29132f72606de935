"""control: all control nodes in one process."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from rclpy.node import Node

from cspr_control.nodes.feedforward import FeedforwardNode
from cspr_control.nodes.mass_estimator import MassEstimatorNode
from cspr_control.nodes.motor_control_gains import MotorControlGains
from cspr_control.nodes.pose_estimator import PoseEstimatorNode
from cspr_control.nodes.supervisor import SupervisorNode
from cspr_control.nodes.trajectory_publisher import TrajectoryPublisher
from cspr_msgs_py.runtime.process import run_nodes, shared_subscriptions


def create_control_nodes() -> Sequence[Node]:
    """Create the nodes, motor controllers first: their answers to a motor state are the most urgent."""
    with shared_subscriptions():
        gains = MotorControlGains()
        return [
            gains,
            *gains.controllers,
            TrajectoryPublisher(),
            FeedforwardNode(),
            PoseEstimatorNode(),
            MassEstimatorNode(),
            SupervisorNode(),
        ]


def main() -> int:
    """Run all control nodes."""
    return run_nodes(create_control_nodes)


if __name__ == "__main__":
    sys.exit(main())
