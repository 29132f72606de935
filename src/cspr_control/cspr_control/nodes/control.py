"""control: all control nodes in one process."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from rclpy.node import Node

from cspr_control.components.motor import MotorComponent
from cspr_control.errors import StabilityError
from cspr_control.graph import ORDER
from cspr_control.nodes.component_node import Wiring
from cspr_control.nodes.control_nodes import NODES
from cspr_control.nodes.motor_control_gains import MotorControlGains
from cspr_control.parameters.settings import require_same
from cspr_control.stability.guard import StabilityGuard
from cspr_control.stability.loop_configuration import LoopConfiguration
from cspr_msgs_py.parameters.table import CONTROL_RATE, ROBOT_CONFIG
from cspr_msgs_py.runtime.process import run_nodes
from cspr_msgs_py.vocabulary import Level


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


def loop_of(nodes: Sequence[Node]) -> LoopConfiguration:
    """Return what the stability of the loop depends on, of all control nodes."""
    by_name: dict[str, Any] = {node.get_name(): node for node in nodes}
    gains = by_name["motor_control_gains"]
    return LoopConfiguration(
        by_name["feedforward"].robot,
        gains.gains,
        by_name["feedforward"].component.feedforward.settings,
        by_name["mass_estimator"].component.estimator.settings,
        gains.get_parameter(CONTROL_RATE.name).value,
    )


def guard_gains(nodes: Sequence[Node]) -> Sequence[Node]:
    """Let the gains of the nodes be guarded, and return the nodes; waits until the stability of the loop is known.

    Raises
    ------
    StabilityError
        If it is not enough.
    """
    gains: Any = next(node for node in nodes if node.get_name() == "motor_control_gains")
    loop = loop_of(nodes)
    guard = StabilityGuard(loop)
    gains.guard_with(guard)
    if guard.verdict.level is Level.STALE:
        gains.get_logger().info(
            "computing the stability of the loop, once for this configuration: some seconds"
        )
    try:
        judged = guard.wait()
        if judged.refused:
            raise StabilityError(f"{judged} (cspr stability shows all margins)")
    except BaseException:
        guard.close()
        raise
    if judged.level is Level.WARN:
        gains.get_logger().warning(str(judged))
    return nodes


def main() -> int:
    """Run all control nodes."""
    return run_nodes(lambda: guard_gains(create_control_nodes()))


if __name__ == "__main__":
    sys.exit(main())
