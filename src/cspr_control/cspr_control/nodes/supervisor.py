"""supervisor: enable, stop and faults of the robot as a whole."""

from __future__ import annotations

import sys
from typing import Any

from cspr_control.components.supervision import SupervisionComponent
from cspr_control.nodes.component_node import ComponentNode, executable
from cspr_control.parameters.settings import supervision_limits
from cspr_msgs_py.runtime.parameters import declare_all


class SupervisorNode(ComponentNode):
    """Node of `SupervisionComponent`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("supervisor", **options)
        limits = supervision_limits(self.robot, declare_all(self))
        self.connect(SupervisionComponent(self.robot.number_of_cables, limits))


main = executable(SupervisorNode)

if __name__ == "__main__":
    sys.exit(main())
