"""pose_estimator: forward kinematics of the motor angles."""

from __future__ import annotations

import sys
from typing import Any

from cspr_control.components.pose import PoseComponent
from cspr_control.nodes.component_node import ComponentNode, executable
from cspr_kinematics.warm_up import warm_up
from cspr_msgs_py.runtime.parameters import declare_all


class PoseEstimatorNode(ComponentNode):
    """Node of `PoseComponent`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("pose_estimator", **options)
        warm_up(self.robot)  # compiling takes long, and must not fall into a control cycle
        values = declare_all(self)
        self.connect(PoseComponent(self.robot, values["rate"], 1.0 / values["control_rate"]))


main = executable(PoseEstimatorNode)

if __name__ == "__main__":
    sys.exit(main())
