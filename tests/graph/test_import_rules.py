"""Who may import what: the layers of the four packages, and the places where ROS and CAN may appear."""

from __future__ import annotations

import ast
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src"
PACKAGES = ("cspr_kinematics", "cspr_msgs_py", "cspr_control", "cspr_drivers")
SIBLINGS = {  # a place in a package: what it may import of the others; the longest place that fits counts
    "cspr_kinematics": (),
    "cspr_msgs_py": (),
    "cspr_control": ("cspr_kinematics", "cspr_msgs_py"),
    "cspr_control.closed_loop": ("cspr_kinematics", "cspr_msgs_py", "cspr_drivers"),
    "cspr_control.calibration": ("cspr_kinematics", "cspr_msgs_py", "cspr_drivers.config"),
    "cspr_drivers": ("cspr_msgs_py",),
    "cspr_drivers.simulation": ("cspr_msgs_py", "cspr_kinematics"),
    "cspr_drivers.commission": ("cspr_msgs_py", "cspr_kinematics"),
    "cspr_drivers.config": ("cspr_msgs_py", "cspr_kinematics"),
    "cspr_drivers.nodes.simulated_robot": ("cspr_msgs_py", "cspr_kinematics"),
}
BESIDE_THE_PRODUCT = ("benchmarks", "studies", "tests")
ROS = {"rclpy", "builtin_interfaces", "std_srvs", "rcl_interfaces", "ament_index_python", "rosidl_parser"}
CONVERSION_MODULES = {
    "conversion",
    "message_definitions",
    "qos",
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
    "ruamel": "python3-ruamel.yaml",
    "scipy": "python3-scipy",
    "yaml": "python3-yaml",
    "zstandard": "mcap-ros2-support",
}
FORBIDDEN_NAMES = {"utils", "helpers", "common", "misc"}

MODULES = sorted(path for package in PACKAGES for path in (SOURCE / package / package).rglob("*.py"))


LARGEST_ROOM = 12  # modules
LONG = 300  # lines


def name_of(path: Path) -> str:
    """Return the name under which a module of a package is imported."""
    return ".".join(path.relative_to(SOURCE).with_suffix("").parts[1:])


def imported(path: Path) -> Iterator[str]:
    """Yield the full name of everything that a module imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def within(name: str, places: Iterable[str]) -> bool:
    """Return whether a name is one of the places, or inside of one."""
    return any(f"{name}.".startswith(f"{place}.") for place in places)


def is_ros(name: str) -> bool:
    top = name.split(".")[0]
    return top in ROS or top.endswith("_msgs")


def offences(module: str, names: Iterable[str]) -> list[str]:
    """Return what a module of the product imports and must not."""
    package, *inside = module.split(".")
    place = max((place for place in SIBLINGS if within(module, [place])), key=len)
    ros = inside[:1] in (["nodes"], ["runtime"]) or (
        package == "cspr_msgs_py" and bool({*inside[-1:]} & CONVERSION_MODULES)
    )
    return [
        name
        for name in names
        if (within(name, PACKAGES) and not within(name, (package, *SIBLINGS[place])))
        or (is_ros(name) and not ros)
        or (within(name, ("can", "canopen")) and package != "cspr_drivers")
        or (within(name, ["mujoco"]) and not within(module, ["cspr_drivers.simulation"]))
        or within(name, BESIDE_THE_PRODUCT)
    ]


@pytest.mark.parametrize("path", MODULES, ids=name_of)
def test_a_module_imports_what_its_place_allows(path: Path) -> None:
    assert not offences(name_of(path), imported(path))
    assert not FORBIDDEN_NAMES & set(name_of(path).split("."))


@pytest.mark.parametrize(
    ("module", "name"),
    [
        ("cspr_kinematics.robot.robot", "cspr_msgs_py.topics"),
        ("cspr_control.motors.feedforward", "cspr_drivers.config.can_config"),
        ("cspr_control.calibration.scale", "cspr_drivers.drives.master"),
        ("cspr_control.nodes.control", "cspr_drivers.clock"),
        ("cspr_drivers.drives.cycle", "cspr_kinematics.Robot"),
        ("cspr_drivers.simulation.plant.plant", "cspr_control.graph"),
        ("cspr_control.motors.feedforward", "sensor_msgs.msg.JointState"),
        ("cspr_control.closed_loop.loop", "rclpy"),
        ("cspr_msgs_py.bag.reader", "can"),
        ("cspr_drivers.config.can_config", "mujoco"),
        ("cspr_control.closed_loop.loop", "benchmarks.faults"),
    ],
)
def test_the_rules_catch_an_offender(module: str, name: str) -> None:
    assert offences(module, [name, "numpy"]) == [name]


def test_imports_inside_of_functions_count(tmp_path: Path) -> None:
    late = tmp_path / "late.py"
    late.write_text("def late():\n    from can import Bus\n    return Bus\n", encoding="utf-8")
    assert list(imported(late)) == ["can.Bus"]


def test_tests_use_benchmarks_and_studies_only_to_test_these() -> None:
    tests = ROOT / "tests"
    apart = [
        path for path in tests.rglob("*.py") if path.relative_to(tests).parts[0] not in BESIDE_THE_PRODUCT
    ]
    assert {
        path.relative_to(tests).as_posix(): name
        for path in apart
        for name in imported(path)
        if within(name, ("benchmarks", "studies"))
    } == {}


def rooms() -> dict[str, list[Path]]:
    """Return the public modules of each folder of the packages."""
    found: dict[str, list[Path]] = {}
    for path in MODULES:
        found.setdefault(name_of(path.parent), []).extend([path] * (not path.name.startswith("_")))
    return found


def test_a_room_holds_a_dozen_modules_and_has_its_place_in_the_document() -> None:
    assert {room: len(paths) for room, paths in rooms().items() if len(paths) > LARGEST_ROOM} == {}
    document = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    missing = [room for room in rooms() if "." in room and f"{room.rpartition('.')[2]}/" not in document]
    assert not missing, "rooms that docs/architecture.md does not name"


def test_most_modules_are_short() -> None:
    lines = {name_of(path): len(path.read_text(encoding="utf-8").splitlines()) for path in MODULES}
    long = {
        name: number for name, number in sorted(lines.items(), key=lambda item: -item[1]) if number > LONG
    }
    assert len(long) < len(lines) / 10, f"more than a tenth has over {LONG} lines: {long}"


@pytest.mark.parametrize("package", PACKAGES)
def test_dependencies_are_declared(package: str) -> None:
    """What rosdep installs for a package is what its modules import: no less, and nothing that nobody needs."""
    manifest = ET.parse(SOURCE / package / "package.xml").getroot()
    declared = {
        element.text for kind in ("exec_depend", "test_depend") for element in manifest.findall(kind)
    } - {"python3-pytest"}
    names = {
        name.split(".")[0]
        for path in MODULES
        if path.is_relative_to(SOURCE / package)
        for name in imported(path)
    }
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
