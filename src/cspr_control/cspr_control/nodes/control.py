"""control: all control nodes in one process."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from rclpy.node import Node

from cspr_control.components.motor import MotorComponent
from cspr_control.graph import ORDER
from cspr_control.nodes.component_node import Wiring
from cspr_control.nodes.control_nodes import NODES
from cspr_control.nodes.motor_control_gains import MotorControlGains
from cspr_control.parameters.settings import require_same
from cspr_msgs_py.parameters.table import CONTROL_RATE, ROBOT_CONFIG
from cspr_msgs_py.runtime.process import run_nodes


def create_control_nodes(wiring: Wiring | None = None, **options: Any) -> Sequence[Node]:
    """Create the nodes of all components, in the order of these.

    Raises
    ------
    SettingError
        If they do not agree on the robot, or on the rate of the control cycle.
    """
    options["wiring"] = wiring or Wiring()
    kinds = {**NODES, MotorComponent: MotorControlGains}
    gains, *others = nodes = [kinds[component](**options) for component in ORDER]
    for name in (ROBOT_CONFIG.name, CONTROL_RATE.name):
        has = [node for node in nodes if node.has_parameter(name)]
        require_same(name, {node.get_name(): node.get_parameter(name).value for node in has})
    return [gains, *gains.controllers, *others]


def main() -> int:
    """Run all control nodes."""
    return run_nodes(create_control_nodes)


if __name__ == "__main__":
    sys.exit(main())
