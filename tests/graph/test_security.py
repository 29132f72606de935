"""What each process has in the graph is exactly what its policy lets it have."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Sequence
from importlib.metadata import entry_points
from pathlib import Path

import pytest
import rclpy
from rclpy.node import Node

from cspr_control.nodes import demo_operator
from cspr_control.nodes.control import create_control_nodes
from cspr_control.nodes.control_nodes import (
    FeedforwardNode,
    MassEstimatorNode,
    PoseEstimatorNode,
    SupervisorNode,
    TrajectoryPublisher,
)
from cspr_control.nodes.demo_operator import DemoClient
from cspr_control.nodes.motor_controller import MotorControllerNode
from cspr_control.nodes.robot_markers import RobotMarkers
from cspr_control.programs import demo
from cspr_drivers.nodes import drivers, simulated_robot
from cspr_drivers.nodes.can_drives import CanDrives
from cspr_drivers.nodes.load_cells import LoadCells
from cspr_drivers.nodes.simulated_robot import SimulatedRobot
from cspr_msgs_py.nodes.recorder import Recorder
from cspr_msgs_py.runtime.process import LEAN_NODE
from cspr_msgs_py.security.access import EVERYTHING, Access, processes
from cspr_msgs_py.security.discovery import RANGE

ROOT = Path(__file__).parents[2]
PROCESSES = processes(8)
PEOPLE = {"viewer", "operator", "maintenance"}
HOW = "grant it in cspr_msgs_py/security/access.py, then: python -m cspr_msgs_py.programs.security"
ASK = {
    "publishes": Node.get_publisher_names_and_types_by_node,
    "hears": Node.get_subscriber_names_and_types_by_node,
    "offers": Node.get_service_names_and_types_by_node,
    "calls": Node.get_client_names_and_types_by_node,
}


def one_motor() -> Sequence[Node]:
    """Return the controller of a motor and, as before it, the node that reads which one is meant."""
    return [Node("motor_controller", **LEAN_NODE), MotorControllerNode(3)]


def recorder() -> Sequence[Node]:
    """Return the recorder, and the node that holds its subscriptions and that it destroys itself."""
    node = Recorder()
    return [node._intake._node, node]


FACTORIES: dict[str, Callable[[], Sequence[Node]]] = {
    "control": create_control_nodes,
    "trajectory_publisher": lambda: [TrajectoryPublisher()],
    "feedforward": lambda: [FeedforwardNode()],
    "pose_estimator": lambda: [PoseEstimatorNode()],
    "mass_estimator": lambda: [MassEstimatorNode()],
    "supervisor": lambda: [SupervisorNode()],
    "motor_controller_3": one_motor,
    "drivers": drivers.create_nodes,
    "can_drives": lambda: [CanDrives()],
    "load_cells": lambda: [LoadCells()],
    "simulated_robot": simulated_robot.create_nodes,
    "emulated_robot": lambda: [SimulatedRobot()],  # on virtual buses: there are no others here
    "recorder": recorder,
    "robot_markers": lambda: [RobotMarkers()],
    "demo": lambda: [DemoClient()],
}


def union(process: str) -> Access:
    """Return what a process may do: all that its nodes may."""
    nodes = PROCESSES[process].values()
    return Access(*(frozenset[str]().union(*(getattr(node, right) for node in nodes)) for right in ASK))


def present(process: str, directory: Path) -> tuple[set[str], Access]:
    """Return the names of a process's nodes, and what they have in the graph."""
    parameters = ["-p", "autostart:=false", "-p", f"output:={directory / 'bag'}"]
    rclpy.init(args=["--ros-args", "--params-file", "config/control.yaml", *parameters])
    nodes: list[Node] = []
    try:
        nodes += FACTORIES[process]()
        names = {node.get_name() for node in nodes}
        found = (
            frozenset(each for name in names for each, _ in ask(nodes[0], name, "/")) for ask in ASK.values()
        )
        return names, Access(*found)
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.try_shutdown()


@pytest.mark.parametrize("process", FACTORIES)
def test_a_process_has_in_the_graph_what_its_policy_says(
    process: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv(RANGE, "OFF")  # nodes of the same names that other tests have left are not these
    names, has = present(process, tmp_path)
    may = union(process)
    assert names == set(PROCESSES[process])
    for right in ASK:
        found, granted = getattr(has, right), getattr(may, right)
        if EVERYTHING in granted:
            continue
        if process == "demo" and right == "calls":  # it creates its clients when it asks
            found = called_by_the_demo()
        assert sorted(found - granted) == [], f"{process} {right} what it may not; {HOW}"
        assert sorted(granted - found) == [], f"{process} may, and does not: {right}; {HOW}"


def called_by_the_demo() -> frozenset[str]:
    """Return what the operator of the demo asks for, as its source has it."""
    source = inspect.getsource(demo) + inspect.getsource(demo_operator)
    return frozenset(re.findall(r'"(/\w+/(?:enable|stop|start|reset))"', source))


def test_every_executable_that_is_a_node_has_a_policy() -> None:
    executables = {
        each.name
        for each in entry_points(group="console_scripts")
        if re.match(r"cspr_\w+\.nodes\.", each.value)
    }
    families = {re.sub(r"_\d+$", "", process) for process in PROCESSES}
    assert executables == families - PEOPLE - {"demo"}
    assert {re.sub(r"_\d+$", "", process) for process in FACTORIES} == families - PEOPLE


def test_the_document_tells_what_each_enclave_may() -> None:
    text = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    table = text[text.index("| enclave, below `/cspr` |") : text.index("What a policy cannot say")]
    named = {
        name
        for row in re.findall(r"^\|([^|]+)\|", table, re.MULTILINE)
        for name in re.findall(r"`(\w+)`", row)
    }
    assert named == {re.sub(r"_\d+$", "_K", process) for process in PROCESSES}
