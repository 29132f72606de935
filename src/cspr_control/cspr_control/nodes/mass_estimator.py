"""mass_estimator: the payload from the cable tensions."""

from __future__ import annotations

import sys
from typing import Any

from cspr_control.components.payload import PayloadComponent
from cspr_control.nodes.component_node import ComponentNode, executable
from cspr_control.parameters.settings import estimator_settings
from cspr_kinematics.warm_up import warm_up
from cspr_msgs_py.runtime.parameters import declare_all


class MassEstimatorNode(ComponentNode):
    """Node of `PayloadComponent`."""

    def __init__(self, **options: Any) -> None:
        super().__init__("mass_estimator", **options)
        warm_up(self.robot)  # compiling takes long, and must not fall into a control cycle
        declare_all(self)
        self.connect(PayloadComponent(self.robot, self.changeable(estimator_settings)))


main = executable(MassEstimatorNode)

if __name__ == "__main__":
    sys.exit(main())
