"""docs/operation.md and the program call everything by the same names."""

import ast
import re
from pathlib import Path

import pytest

from cspr_control.supervision.checks import FaultKind
from cspr_drivers.config.timeouts import Timeouts
from cspr_drivers.drives.torque_frames import CommandFault
from cspr_drivers.simulation.fault_injection import InjectedFault
from cspr_msgs_py.parameters.table import TABLE
from cspr_msgs_py.vocabulary import TrajectoryName

ROOT = Path(__file__).parents[2]
DRIVERS = ROOT / "src" / "cspr_drivers" / "cspr_drivers"
DOCUMENT = (ROOT / "docs" / "operation.md").read_text(encoding="utf-8")
WORDS = " ".join(DOCUMENT.split())


def section(title):
    """Return the text below a heading, up to the next one."""
    found = re.search(rf"^#+ {re.escape(title)}$\n(.*?)(?=^#|\Z)", DOCUMENT, re.MULTILINE | re.DOTALL)
    assert found, f"no section '{title}'"
    return found[1]


def rows(title):
    """Return the cells of each row of the table of a section, without its head."""
    lines = [line for line in section(title).splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def test_every_trajectory_is_described():
    described = re.findall(r"`([\w-]+)`", " ".join(row[0] for row in rows("Trajectories")))
    assert described == [name.value for name in TrajectoryName]


def test_the_parameters_of_the_recorder_are_described():
    described = {name: row[1] for row in rows("Recording") for name in re.findall(r"`(\w+)`", row[0])}
    for parameter in TABLE["recorder"]:
        assert parameter.name in DOCUMENT
        if parameter.default not in ("", [""]):
            assert re.match(rf"`?{parameter.default}", described[parameter.name].replace("0: never", "0.0"))


def test_every_fault_of_the_robot_has_meaning_and_remedy():
    table = {row[0]: row for row in rows("Faults of the robot, on `/robot_state`")}
    for kind in FaultKind:
        assert kind.value in table, f"'{kind.value}' is not in docs/operation.md"
    assert all(len(row) == 3 and all(row) for row in table.values())


def test_every_fault_on_purpose_is_named():
    named = set(re.findall(r"`(\w+)`", section("Faults on purpose")))
    assert {fault.value for fault in InjectedFault} - named == set(), "not in docs/operation.md"


def test_every_cause_has_meaning_and_remedy():
    assert all(len(row) == 3 and all(row) for row in rows("Causes from `can_drives`"))
    for fault in CommandFault:
        assert fault.value in section("Causes from `can_drives`")


TELLING = (
    "_fault_cause",
    "_why_not_at_rest",
    "answered",
    "problem",
    "position_problem",
    "speed_problem",
)  # functions that return what is wrong, in words


def causes(path):
    """Return the constant words of the texts with which a module latches, loses a drive or explains a fault."""
    for function in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(function, ast.FunctionDef):
            continue
        for node in ast.walk(function):
            texts = []
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
                if node.func.attr in ("_latch", "_stop", "quick_stop", "_reject"):
                    texts = node.args
            elif isinstance(node, ast.Return) and function.name in TELLING and node.value:
                texts = [node.value]
            for text in texts:
                for part in ast.walk(text):
                    if isinstance(part, ast.Constant) and isinstance(part.value, str):
                        yield part.value.strip(" ;:,")


@pytest.mark.parametrize(
    "module",
    [
        "drives/group.py",
        "drives/cycle.py",
        "drives/torque_watch.py",
        "drives/motion_watch.py",
        "devices/device.py",
    ],
)
def test_causes_in_the_program_are_in_the_document(module):
    table = " ".join(row[0] for row in rows("Causes from `can_drives`"))
    found = {words for words in causes(DRIVERS / module) if len(words) > 6 and " " in words}
    assert found, "nothing to compare"
    for words in found:
        fragment = re.sub(r"\s+", " ", words)
        assert any(piece in table for piece in (fragment, fragment.removeprefix("is ")))


def published_values():
    """Return the keys of the values that the drivers' nodes publish, as their modules write them."""
    modules = ("driver_messages.py", "nodes/simulated_robot.py")
    trees = [ast.parse((DRIVERS / name).read_text(encoding="utf-8")) for name in modules]
    for node in (node for tree in trees for node in ast.walk(tree)):
        if isinstance(node, ast.Dict):
            for key in node.keys:
                if isinstance(key, ast.Constant) and isinstance(key.value, str):
                    yield key.value
        elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Subscript):
            yield ast.literal_eval(node.targets[0].slice)


def test_values_on_diagnostics_are_those_of_the_document():
    documented = {
        name for row in rows("What `/diagnostics` says") for name in re.findall(r"`([a-z0-9_]+)`", row[1])
    }
    published = set(published_values())
    assert len(published) > 15
    assert published - documented == set(), "published, and not in docs/operation.md"
    assert documented - published == set(), "in docs/operation.md, and not published"


def test_times_that_the_document_names_exist():
    for name in (
        "command",
        "feedback",
        "supervisor",
        "rpdo",
        "heartbeat_consumer",
        "transition",
        "enable",
        "stop",
    ):
        assert f"`{name}`" in WORDS
        assert name in Timeouts.__dataclass_fields__
