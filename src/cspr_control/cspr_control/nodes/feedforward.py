"""feedforward: from the reference to the set-points of all motors."""

from __future__ import annotations

import sys
from functools import partial
from typing import Any

from cspr_control.components.feedforward import FeedforwardComponent
from cspr_control.nodes.component_node import ComponentNode, executable
from cspr_control.parameters.settings import feedforward_settings
from cspr_kinematics.warm_up import warm_up
from cspr_msgs_py.runtime.parameters import declare_all


class FeedforwardNode(ComponentNode):
    """Node of `FeedforwardComponent`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("feedforward", **options)
        warm_up(self.robot)  # compiling takes long, and must not fall into a control cycle
        declare_all(self)
        settings = self.changeable(partial(feedforward_settings, self.robot.number_of_cables))
        self.connect(FeedforwardComponent(self.robot, settings))


main = executable(FeedforwardNode)

if __name__ == "__main__":
    sys.exit(main())
