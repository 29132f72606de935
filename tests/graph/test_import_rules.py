"""Who may import what: the layers of the four packages, and the places where ROS and CAN may appear."""

from __future__ import annotations

import ast
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src"
PACKAGES = ("cspr_kinematics", "cspr_msgs_py", "cspr_control", "cspr_drivers")
SIBLINGS = {
    "cspr_kinematics": set(),
    "cspr_msgs_py": set(),
    "cspr_control": {"cspr_kinematics", "cspr_msgs_py"},  # and cspr_drivers under closed_loop/
    "cspr_drivers": {"cspr_msgs_py"},  # and cspr_kinematics where KINEMATICS_IN_DRIVERS says
}
KINEMATICS_IN_DRIVERS = {"simulation", "commission", "config"}  # and nodes/simulated_robot.py
ROS = {"rclpy", "builtin_interfaces", "std_srvs", "rcl_interfaces", "ament_index_python", "rosidl_parser"}
CONVERSION_MODULES = {
    "conversions.py",
    "joint_state_conversion.py",
    "message_definitions.py",
    "qos.py",
    "reference_conversion.py",
}
ROSDEP_KEYS = {  # of what does not come from ROS itself: module, and the dependency that brings it
    "can": "python3-can",
    "canopen": "canopen-pip",
    "lz4": "mcap-ros2-support",
    "matplotlib": "python3-matplotlib",
    "mcap": "mcap-ros2-support",
    "mcap_ros2": "mcap-ros2-support",
    "msgspec": "python3-msgspec-pip",
    "mujoco": "python3-mujoco-pip",
    "numba": "python3-numba",
    "numpy": "python3-numpy",
    "scipy": "python3-scipy",
    "yaml": "python3-yaml",
    "zstandard": "mcap-ros2-support",
}
FORBIDDEN_NAMES = {"utils", "helpers", "common", "misc"}

MODULES = sorted(path for package in PACKAGES for path in (SOURCE / package / package).rglob("*.py"))


def imported(path: Path) -> Iterator[str]:
    """Top-level names of everything that a module imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module.split(".")[0]


def is_ros(name: str) -> bool:
    return name in ROS or name.endswith("_msgs")


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_imports(path: Path) -> None:
    relative = path.relative_to(SOURCE)
    package, inside = relative.parts[0], relative.parts[2:]
    names = set(imported(path)) - {package}
    allowed = set(SIBLINGS[package])
    if package == "cspr_drivers" and (
        inside[0] in KINEMATICS_IN_DRIVERS or inside == ("nodes", "simulated_robot.py")
    ):
        allowed.add("cspr_kinematics")
    if package == "cspr_control" and inside[0] == "closed_loop":
        allowed.add("cspr_drivers")
    assert not (names & set(PACKAGES)) - allowed, "imports a package of another layer"
    if inside[0] not in ("nodes", "runtime") and not (
        package == "cspr_msgs_py" and inside[-1] in CONVERSION_MODULES
    ):
        assert not {name for name in names if is_ros(name)}, (
            "ROS belongs in nodes/ and the conversion modules"
        )
    if package != "cspr_drivers":
        assert not names & {"can", "canopen"}, "CAN belongs in cspr_drivers"
    if inside[0] != "simulation":
        assert "mujoco" not in names, "MuJoCo is needed for the simulation alone"
    assert not FORBIDDEN_NAMES & {part.removesuffix(".py") for part in inside}


@pytest.mark.parametrize("package", PACKAGES)
def test_dependencies_are_declared(package: str) -> None:
    """What rosdep installs for a package is what its modules import: no less, and nothing that nobody needs."""
    manifest = ET.parse(SOURCE / package / "package.xml").getroot()
    declared = {
        element.text for kind in ("exec_depend", "test_depend") for element in manifest.findall(kind)
    } - {"python3-pytest"}
    names = {name for path in MODULES if path.is_relative_to(SOURCE / package) for name in imported(path)}
    imports = {ROSDEP_KEYS.get(name, name) for name in names - {package, *sys.stdlib_module_names}}
    by_name = {kind.split("/")[0] for kind in topic_types()}  # subscribed to, recorded and replayed by name
    needed = imports | by_name if package == "cspr_msgs_py" else imports
    assert needed <= declared <= needed | by_name


def topic_types() -> set[str]:
    from cspr_msgs_py import topics

    return {value.type for value in vars(topics).values() if isinstance(value, topics.Topic)}


def test_there_is_something_to_check() -> None:
    assert len(MODULES) > 40
    assert {path.relative_to(SOURCE).parts[0] for path in MODULES} == set(PACKAGES)


def test_rules_catch_an_offender(tmp_path: Path) -> None:
    offender = tmp_path / "offender.py"
    offender.write_text(
        "def late():\n    from sensor_msgs.msg import JointState\n    return JointState\n", encoding="utf-8"
    )
    assert {name for name in imported(offender) if is_ros(name)} == {"sensor_msgs"}
