"""No parameter is given in vain: for each one of the table, a value is used where it is given, or refused."""

from __future__ import annotations

import functools
import os
import types
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

pytest.importorskip("mujoco")

from cspr_control.errors import ControlError
from cspr_control.nodes.control import create_control_nodes
from cspr_control.nodes.control_nodes import (
    FeedforwardNode,
    MassEstimatorNode,
    PoseEstimatorNode,
    SupervisorNode,
    TrajectoryPublisher,
)
from cspr_control.nodes.motor_control_gains import MotorControlGains
from cspr_control.nodes.motor_controller import MotorControllerNode
from cspr_control.nodes.robot_markers import RobotMarkers
from cspr_control.parameters.control_settings import control_settings, robot_file
from cspr_drivers.nodes.can_drives import CanDrives
from cspr_drivers.nodes.load_cells import LoadCells
from cspr_drivers.nodes.simulated_robot import SimulatedRobot
from cspr_kinematics import Robot
from cspr_msgs_py.errors import ParameterError
from cspr_msgs_py.nodes.recorder import Recorder
from cspr_msgs_py.parameters.file import ParameterFile, check_arguments
from cspr_msgs_py.parameters.row import NodeParameter
from cspr_msgs_py.parameters.table import ALL_NODES, TABLE

ROOT = Path(__file__).parents[2]
CONTROL_FILE = ROOT / "config" / "control.yaml"
ALONE: dict[str, Callable[..., Node]] = {
    "trajectory_publisher": TrajectoryPublisher,
    "feedforward": FeedforwardNode,
    "motor_control_gains": MotorControlGains,
    "motor_controller_K": functools.partial(MotorControllerNode, 3),
    "pose_estimator": PoseEstimatorNode,
    "mass_estimator": MassEstimatorNode,
    "supervisor": SupervisorNode,
    "robot_markers": RobotMarkers,
    "can_drives": CanDrives,
    "load_cells": LoadCells,
    "simulated_robot": SimulatedRobot,
    "recorder": Recorder,
}
ASKED_LATER = ("fault", "mark_text")
"""Read when a service is called; the tests of these services set them."""

FITTING = {"length_misfit": 0.001, "allowed_drop": 0.03}
"""Values that the other defaults of their node allow."""

OF_OTHER_PROCESSES = (
    "motor_controller",
    "robot_markers",
    "can_drives",
    "load_cells",
    "simulated_robot",
    "recorder",
)
"""Nodes that simulated time is without, and to which the same file may speak."""

ROWS = [pytest.param(node, row, id=f"{node}.{row.name}") for node, rows in TABLE.items() for row in rows]


def another(row: NodeParameter) -> Any:
    """Return a value that is allowed and is not the default."""
    if row.name in FITTING:
        return FITTING[row.name]
    if row.name == "attach":
        return [str(CONTROL_FILE)]
    if row.choices:
        return next(str(choice) for choice in row.choices if choice != row.default)
    if row.is_list:
        return ["/setpoint"] if row.kind is str else [0.05, 0.04, 0.9]
    if row.kind is bool:
        return not row.default
    if row.kind is int:
        return row.default + 1
    if row.kind is float:
        default = 200.0 if row.default is float else row.default
        return 0.9 * default if default else min(1.5, row.maximum or 1.5)
    return "nowhere.yaml"


@pytest.fixture(autouse=True)
def root(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)  # the defaults of the files' paths are relative


# In the node


def held(thing: Any, path: str, seen: dict[int, Any]) -> Iterator[tuple[str, str]]:
    """Yield all values that an object of ours has hold of, with the way to them; `seen` are those before, by id."""
    parts: dict[str, Any] = {}
    if isinstance(thing, np.ndarray | bytes | str | int | float | Path | None):
        yield path, repr(thing)
    elif id(thing) in seen:
        return
    elif isinstance(thing, Mapping):
        parts = {str(key): value for key, value in thing.items()}
    elif isinstance(thing, list | tuple | set | frozenset | deque):
        parts = {str(place): value for place, value in enumerate(thing)}
        parts["maxlen"] = getattr(thing, "maxlen", None)
    elif isinstance(thing, functools.partial):
        parts = {"function": thing.func, "arguments": (thing.args, thing.keywords)}
    elif isinstance(thing, types.MethodType):
        parts = {"self": thing.__self__}
    elif isinstance(thing, types.FunctionType):
        parts = {str(place): cell.cell_contents for place, cell in enumerate(thing.__closure__ or ())}
    elif isinstance(thing, Node):
        own = {name: value for name, value in vars(thing).items() if not name.startswith("_Node__")}
        parts = {name: value for name, value in own.items() if name not in OF_RCLPY}
        parts["services"] = [service.callback for service in thing.services]
        parts["timers"] = [(timer.callback, timer.timer_period_ns) for timer in thing.timers]
    elif type(thing).__module__.startswith("cspr_"):
        yield path, type(thing).__name__
        slots = [name for kind in type(thing).__mro__ for name in getattr(kind, "__slots__", ())]
        parts = {name: getattr(thing, name, None) for name in slots} | getattr(thing, "__dict__", {})
    seen[id(thing)] = thing
    for name, part in parts.items():
        yield from held(part, f"{path}.{name}", seen)


OF_RCLPY: frozenset[str] = frozenset()


@pytest.fixture(scope="module")
def context() -> Iterator[Context]:
    global OF_RCLPY
    context = Context()
    rclpy.init(args=[], context=context)
    plain = Node("plain", context=context)
    OF_RCLPY = frozenset(vars(plain))
    plain.destroy_node()
    yield context
    rclpy.try_shutdown(context=context)


class Held:
    """What nodes hold, as they are made with parameters."""

    def __init__(self, context: Context, directory: Path) -> None:
        self._context = context
        self._directory = directory
        self._made = 0
        self._usual: dict[str, dict[str, str]] = {}

    def by(self, name: str, given: Mapping[str, Any]) -> dict[str, str]:
        """Return all that a node holds with these parameters."""
        self._made += 1
        usual = {"recorder": {"output": str(self._directory / f"bag{self._made}")}}
        values = usual.get(name, {}) | ({"autostart": False} if name in ("can_drives", "load_cells") else {})
        overrides = [Parameter(each, value=value) for each, value in (values | given).items()]
        before = os.getpriority(os.PRIO_PROCESS, 0)
        node = ALONE[name](context=self._context, parameter_overrides=overrides)
        try:
            return dict(held(node, "", {})) | {"nice level": str(os.getpriority(os.PRIO_PROCESS, 0))}
        finally:
            os.setpriority(os.PRIO_PROCESS, 0, before)
            getattr(node, "make_safe", lambda: None)()
            node.destroy_node()

    def usual(self, name: str) -> dict[str, str]:
        """Return what a node holds each time that it is made."""
        if name not in self._usual:
            first, second = self.by(name, {}), self.by(name, {})
            self._usual[name] = {path: value for path, value in first.items() if second.get(path) == value}
        return self._usual[name]


@pytest.fixture(scope="module")
def holding(context: Context, tmp_path_factory: pytest.TempPathFactory) -> Held:
    return Held(context, tmp_path_factory.mktemp("nodes"))


@pytest.mark.parametrize(("name", "row"), [each for each in ROWS if each.values[0] != "motor_controller"])
def test_a_node_uses_what_it_is_given(holding: Held, name: str, row: NodeParameter) -> None:
    if row.name in ASKED_LATER:
        assert row.changeable
        return
    usual = holding.usual(name)
    assert len(usual) > 10
    special = {"output": str(holding._directory / "other"), "control_rate": 20.0, "autostart": True}
    value = special.get(row.name, another(row))
    refusal, found = "", {}
    try:
        found = holding.by(name, {row.name: value})
    except (
        Exception
    ) as error:  # the file is not there, there is no such bus, gains are too large for the rate
        refusal = str(error)
    if refusal:
        assert str(value) in refusal or {"autostart": "can0", "control_rate": "kd"}[row.name] in refusal
    elif row.name == "output":
        assert any(value in each for each in found.values())
    else:
        assert any(found.get(path) != each for path, each in usual.items()), f"{name} does not use {row.name}"


# In simulated time


@functools.cache
def shipped() -> tuple[Robot, ParameterFile, str]:
    """Return the robot, control.yaml, and the settings that these make."""
    robot, parameters = Robot.from_yaml(ROOT / "config" / "robot.yaml"), ParameterFile.from_yaml(CONTROL_FILE)
    return robot, parameters, repr(control_settings(robot, parameters))


@pytest.mark.parametrize(("name", "row"), ROWS)
@pytest.mark.parametrize("how", ["changed", "in the file"])
def test_simulated_time_uses_or_refuses_what_it_is_given(name: str, row: NodeParameter, how: str) -> None:
    robot, plain, usual = shipped()
    node, value = name.replace("_K", "_3"), another(row)
    refusal, used = "", False
    try:
        if how == "changed":
            given = deepcopy(plain)
            given.change(node, {row.name: value})
        else:
            given = ParameterFile(f"{node}:\n  ros__parameters: {{{row.name}: {value!r}}}", "mine.yaml")
        settings = control_settings(robot, given)
        used = repr(settings) != usual or robot_file(given) != robot_file(plain)
    except (ParameterError, ControlError) as error:
        refusal = str(error)
    if refusal:
        assert row.name in refusal or f"{node} is not here" in refusal
        assert how == "changed" or "mine.yaml" in refusal or "must be the same for all" in refusal
    else:
        assert used or (how == "in the file" and name in OF_OTHER_PROCESSES)


@pytest.mark.parametrize("name", ["robot_config", "control_rate", "kp", "setpoint_timeout", "max_payload"])
def test_simulated_time_uses_what_is_given_to_all(name: str) -> None:
    robot, plain, usual = shipped()
    given = deepcopy(plain)
    row = next(row for rows in TABLE.values() for row in rows if row.name == name)
    given.change(ALL_NODES, {name: another(row)})
    settings = control_settings(robot, given)
    assert repr(settings) != usual or robot_file(given) != robot_file(plain)


def test_the_set_point_timeout_of_one_motor_is_that_motor_s() -> None:
    parameters = ParameterFile.from_yaml(CONTROL_FILE)
    parameters.change("motor_controller_3", {"setpoint_timeout": 0.25})
    settings = control_settings(Robot.from_yaml(ROOT / "config" / "robot.yaml"), parameters)
    assert settings.setpoint_timeouts == (0.1, 0.1, 0.25, *(0.1,) * 5)


# In a process


@pytest.fixture(scope="module")
def control(context: Context) -> dict[str, set[str]]:
    """Return the parameters of the nodes of `control`, by node."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        nodes = create_control_nodes(context=context)
    declared = {node.get_name(): set(node.get_parameters_by_prefix("")) for node in nodes}
    for node in nodes:
        node.destroy_node()
    return declared


@pytest.mark.parametrize(("name", "row"), ROWS)
def test_a_process_refuses_what_no_node_of_it_takes(
    control: dict[str, set[str]], name: str, row: NodeParameter, tmp_path: Path
) -> None:
    node, value = name.replace("_K", "_3"), another(row)
    file = tmp_path / "mine.yaml"
    file.write_text(f"{node}:\n  ros__parameters: {{{row.name}: {value!r}}}\n", encoding="utf-8")
    taken = row.name in control.get(node, ())
    for arguments, passed in (
        (["--params-file", str(file)], taken or node not in control),
        (["-p", f"{node}:{row.name}:={value}"], taken),
        (["-p", f"/**:{row.name}:={value}"], any(row.name in names for names in control.values())),
        (["-p", f"{row.name}:={value}"], any(row.name in names for names in control.values())),
    ):
        if passed:
            check_arguments(arguments, control)
            continue
        with pytest.raises(
            ParameterError, match=rf"{row.name} here; |{node} is not here; the nodes here are "
        ):
            check_arguments(arguments, control)


@pytest.mark.parametrize("motor", [3, 12])
def test_gains_of_one_motor_are_refused_where_all_motors_share_them(
    control: dict[str, set[str]], motor: int, tmp_path: Path
) -> None:
    file = tmp_path / "control.yaml"
    file.write_text(
        f"/**: {{ros__parameters: {{kp: 3.0, trail: 9.0}}}}\n"
        f"motor_controller_{motor}:\n  ros__parameters:\n    kp: 4.0\n",
        encoding="utf-8",
    )
    with pytest.raises(ParameterError) as refusal:
        check_arguments(["--params-file", str(file)], control)
    remedy = "takes no kp here; motor_control_gains does" if motor == 3 else "is not here; the nodes here are"
    assert f"{file}, line 4: motor_controller_{motor} {remedy}" in str(refusal.value)
    check_arguments(["--params-file", str(file)], {f"motor_controller_{motor}": {"kp"}})
