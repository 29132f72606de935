"""A node alone, without a parameter file, has the parameters that it has in `control` with config/control.yaml."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.node import Node

from cspr_control.nodes.control import create_control_nodes
from cspr_control.nodes.control_nodes import NODES
from cspr_control.nodes.motor_control_gains import MotorControlGains
from cspr_control.nodes.motor_controller import MotorControllerNode
from cspr_control.nodes.robot_markers import RobotMarkers
from cspr_msgs_py.parameters.table import TABLE, node_parameters

ROOT = Path(__file__).parents[2]
OF_ROS = ("use_sim_time", "start_type_description_service")
ALONE: list[Callable[[], Node]] = [*NODES.values(), lambda: MotorControllerNode(3)]


def declared(node: Node) -> dict[str, Any]:
    """Return value and description of every parameter of a node by name."""
    names = [name for name in node._parameters if name not in OF_ROS]
    values = {name: node.get_parameter(name).value for name in names}
    return {name: (values[name], str(node.describe_parameter(name))) for name in names}


def run(create: Callable[[], Sequence[Node]], *arguments: str) -> dict[str, dict[str, Any]]:
    rclpy.init(args=["--ros-args", *arguments])
    nodes: list[Node] = []
    try:
        nodes += create()
        return {node.get_name(): declared(node) for node in nodes}
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


@pytest.fixture(scope="module", autouse=True)
def root() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)  # the defaults of the files' paths are relative
        yield


@pytest.fixture(scope="module")
def composed() -> dict[str, dict[str, Any]]:
    return run(create_control_nodes, "--params-file", "config/control.yaml")


@pytest.mark.parametrize("create", ALONE)
def test_alone_as_in_control(composed: dict[str, dict[str, Any]], create: Callable[[], Node]) -> None:
    ((name, alone),) = run(lambda: [create()]).items()
    together = composed[name]
    if name.startswith("motor_controller"):  # the gains are shared there
        together = composed["motor_control_gains"] | together
    assert alone == together
    assert set(alone) == {row.name for row in TABLE[name.replace("_3", "_K")]}


def test_the_gains_alone_and_the_markers_have_what_the_table_says(
    composed: dict[str, dict[str, Any]],
) -> None:
    nodes = run(lambda: [MotorControlGains(), RobotMarkers()])
    assert nodes["motor_control_gains"] == composed["motor_control_gains"]
    for name, parameters in nodes.items():
        rows = node_parameters(name)
        assert {each: value for each, (value, _) in parameters.items()} == {
            each.name: each.default for each in TABLE[name]
        }
        assert all(rows[each].description in text for each, (_, text) in parameters.items())
