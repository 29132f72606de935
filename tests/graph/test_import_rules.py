"""Who may import what: the layers of the four packages, and the places where ROS and CAN may appear."""

from __future__ import annotations

import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import NamedTuple

import pytest
from tests.graph.import_graph import ImportGraph, module_name, within

ROOT = Path(__file__).parents[2]
SOURCE = ROOT / "src"
PACKAGES = ("cspr_kinematics", "cspr_msgs_py", "cspr_control", "cspr_drivers")
BESIDE_THE_PRODUCT = ("benchmarks", "studies", "tests")
GRAPH = ImportGraph.of(
    [*(SOURCE / name / name for name in PACKAGES), *(ROOT / name for name in (*BESIDE_THE_PRODUCT, "docs"))]
)
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
}
ROS = ("rclpy", "builtin_interfaces", "std_srvs", "rcl_interfaces", "ament_index_python", "rosidl_parser")
NODES = tuple(f"{package}.nodes" for package in PACKAGES)
CONVERSION = ("cspr_msgs_py.runtime", "cspr_msgs_py.wire.conversion", "cspr_msgs_py.qos")
LIVE = ("cspr_control.programs.demo", "cspr_control.programs.faults")
SIMULATION = ("cspr_drivers.simulation", "cspr_drivers.commission")


class Rule(NamedTuple):
    """Modules of some places, `but` for some, never import others, nor anything that brings them along."""

    places: tuple[str, ...]
    never: tuple[str, ...]
    but: tuple[str, ...] = ()


RULES = (
    Rule(PACKAGES, ("ROS",), (*NODES, *CONVERSION, *LIVE)),
    Rule(PACKAGES, NODES, (*NODES, *LIVE)),
    Rule(PACKAGES, (*BESIDE_THE_PRODUCT, "docs")),
    Rule(
        ("cspr_control",),
        ("cspr_drivers",),
        (*(f"cspr_control.{name}closed_loop" for name in ("", "programs.")), "cspr_control.calibration",
         "cspr_control.programs.faults"),
    ),
    Rule(
        ("cspr_drivers",),
        SIMULATION,
        (*SIMULATION, "cspr_drivers.nodes.simulated_robot", "cspr_drivers.nodes.emulated_robot"),
    ),
    Rule(("benchmarks", "studies", "docs"), ("tests",)),
    Rule(("tests", "docs"), ("benchmarks", "studies"), ("tests.benchmarks", "tests.studies")),
)  # fmt: skip
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
    return module_name(path, SOURCE / path.relative_to(SOURCE).parts[0])


def is_one_of(name: str, places: tuple[str, ...]) -> bool:
    """Return whether a name is inside of one of the places, of which ROS is one."""
    top = name.split(".")[0]
    return within(name, places) or ("ROS" in places and (top in ROS or top.endswith("_msgs")))


def offences(graph: ImportGraph, module: str) -> list[str]:
    """Return how a module imports what it must not, directly or by what it imports."""
    package = module.split(".")[0]
    place = max((place for place in SIBLINGS if within(module, [place])), key=len, default="")
    direct = [
        f"{module} -> {name}"
        for name in (graph.imports[module] if place else ())
        if (within(name, PACKAGES) and not within(name, (package, *SIBLINGS[place])))
        or (within(name, ("can", "canopen")) and package != "cspr_drivers")
        or (within(name, ["mujoco"]) and not within(module, ["cspr_drivers.simulation"]))
    ]
    rules = [rule for rule in RULES if within(module, rule.places) and not within(module, rule.but)]
    ways = [graph.way(module, lambda name, rule=rule: is_one_of(name, rule.never)) for rule in rules]
    return direct + [way for way in ways if way]


@pytest.mark.parametrize("module", GRAPH.imports)
def test_a_module_imports_what_its_place_allows(module: str) -> None:
    assert offences(GRAPH, module) == []
    assert not FORBIDDEN_NAMES & set(module.split("."))


@pytest.mark.parametrize(
    ("module", "statement", "offence"),
    [
        # what a place must not import
        ("cspr_kinematics.robot.robot", "from cspr_msgs_py import topics", "cspr_msgs_py"),
        ("cspr_control.motors.feedforward", "from cspr_drivers.config import can_config", "cspr_drivers.config"),
        ("cspr_control.calibration.scale", "from cspr_drivers.drives import master", "cspr_drivers.drives"),
        ("cspr_control.nodes.control", "from cspr_drivers import clock", "cspr_drivers"),
        ("cspr_drivers.drives.cycle", "from cspr_kinematics import Robot", "cspr_kinematics"),
        ("cspr_drivers.nodes.simulated_robot", "import cspr_kinematics", "cspr_kinematics"),
        ("cspr_drivers.simulation.plant.plant", "import cspr_control.graph", "cspr_control"),
        ("cspr_control.motors.feedforward", "from sensor_msgs.msg import JointState", "sensor_msgs"),
        ("cspr_msgs_py.bag.reader", "def late():\n    from can import Bus", "can"),
        ("cspr_drivers.config.can_config", "import mujoco", "mujoco"),
        ("cspr_control.closed_loop.loop", "from benchmarks import timing", "benchmarks"),
        ("studies.paper", "from tests import messages", "tests"),
        ("docs.robot_picture", "import benchmarks.timing", "benchmarks"),
        # by a call
        ("cspr_control.motors.motor_control", "importlib.import_module('cspr_drivers.clock')", "cspr_drivers"),
        ("cspr_control.motors.motor_control", "exec('import cspr_drivers')", "cspr_drivers"),
        ("cspr_control.supervision.checks", "__import__('rclpy')", "rclpy"),
        ("cspr_control.programs.analyze", "runpy.run_module(mod_name='benchmarks')", "benchmarks"),
        ("tests.msgs.test_topics", "import_module('benchmarks.timing')", "benchmarks"),
        # by what is imported
        ("cspr_control.reference.player", "import cspr_msgs_py.runtime.process", "cspr_msgs_py.runtime.process"),
        ("cspr_control.estimation.payload", "import cspr_control.nodes", "cspr_control.nodes"),
        ("cspr_control.estimation.payload", "from ..nodes import control", "cspr_control.nodes"),
        ("cspr_msgs_py.bag.reader", "from cspr_msgs_py.nodes import recorder", "cspr_msgs_py.nodes"),
        ("cspr_control.rerun.rerun", "from cspr_control.closed_loop import robot", "cspr_drivers"),
        ("cspr_control.closed_loop.loop", "import cspr_drivers.nodes.simulated_robot", "cspr_drivers.nodes"),
        ("cspr_drivers.drives.cycle", "from cspr_drivers.simulation import plant", "cspr_drivers.simulation"),
    ],
)  # fmt: skip
def test_the_rules_catch_an_offender(module: str, statement: str, offence: str) -> None:
    found = offences(GRAPH.with_statement(module, statement), module)
    assert any(f" -> {offence}" in way for way in found), found


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
        for name in GRAPH.imports[name_of(path)]
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
