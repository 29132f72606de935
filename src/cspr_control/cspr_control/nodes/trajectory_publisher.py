"""trajectory_publisher: the reference of the platform, one point a control cycle."""

from __future__ import annotations

import sys
from functools import partial
from typing import Any

from cspr_control.components.trajectory import TrajectoryComponent
from cspr_control.nodes.component_node import ComponentNode, executable
from cspr_control.parameters.settings import trajectory_settings
from cspr_msgs_py.runtime.parameters import declare_all


class TrajectoryPublisher(ComponentNode):
    """Node of `TrajectoryComponent`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("trajectory_publisher", **options)
        home = self.robot.home
        values = declare_all(self, move_position=home.position.tolist(), move_orientation=home.euler.tolist())
        settings = self.changeable(partial(trajectory_settings, self.robot))
        self.connect(TrajectoryComponent(self.robot, settings, 1.0 / values["control_rate"]))


main = executable(TrajectoryPublisher)

if __name__ == "__main__":
    sys.exit(main())
