"""Files that people write: one YAML for all of them, and parameters as ROS itself reads them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node

from cspr_drivers.commission import program as commission
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.errors import DriverError
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_kinematics import KinematicsError, Robot
from cspr_kinematics.configuration.yaml_file import parse_yaml, read_yaml, write_yaml
from cspr_msgs_py.errors import ParameterError
from cspr_msgs_py.parameters.file import ParameterFile

CONFIG = Path(__file__).parents[2] / "config"
READERS: dict[str, Callable[[Path], object]] = {
    "robot.yaml": Robot.from_yaml,
    "can.yaml": CanConfig.from_yaml,
    "simulation.yaml": SimulationConfig.from_yaml,
    "control.yaml": ParameterFile.from_yaml,
    "answers.yaml": lambda path: commission.main(["--answers", str(path)]),
}
ANSWERS = b"home: yes\nwrite: no\n"


SPELLINGS = [
    "yes",
    "On",
    "off",
    "TRUE",
    "no",
    "y",
    "N",
    "'yes'",
    "word",
    "1",
    "+1",
    "0x10",
    "-0x1F",
    "017",
    "010",
    "1.0",
    ".5",
    "-1e-3",
    "1e3",
    "1.e3",
    "12e03",
    ".inf",
    "'1'",
]
SPELLINGS += [
    "1_000",
    "1.5_0",
    "0x1_0",
    "1:30",
    "12:30:00",
    "1:30.5",
    "2001-01-01",
    "0b11",
    "0o17",
    "08",
    "09.5",
    "=",
]
SPELLINGS += ["<<", "+.5", "-.5e3", "-017", "00", "1e", "tRue", "1.5.2"]
SPELLINGS += ["[1, 2]", "[1.0, 2e-1]", "[yes, off]", "[a, 'off']"]


@pytest.mark.parametrize("name", READERS)
@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"odd: {a: 1,\n  a: 2}\n", 'found duplicate key "a" with value "2" (original value: "1") (line '),
        (b"odd: [1, 2\n", "(line "),
        (b"---\nodd: 1\n", "found another document (line "),
        (b"odd: \0\n", "special characters are not allowed"),
        (b"odd: \xff\n", "invalid start byte"),
        (b"odd: &a {b: *a}\n", "found an alias; write out what it stands for (line "),
        (b"odd: " + b"[" * 2000, "maximum recursion depth"),
        (None, "map"),
    ],
    ids=["key twice", "open bracket", "two documents", "NUL", "not UTF-8", "endless", "deep", "no mapping"],
)
def test_what_is_no_mapping_of_unique_keys_is_refused(
    name: str, text: bytes | None, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shipped = CONFIG / name
    path = tmp_path / name
    path.write_bytes((shipped.read_bytes() if shipped.exists() else ANSWERS) + text if text else b"42\n")
    try:
        READERS[name](path)
        told = capsys.readouterr().err
    except (KinematicsError, DriverError, ParameterError) as error:
        told = str(error)
    assert name in told
    assert words in told


def test_parameters_are_read_and_written_as_ros_reads_them(tmp_path: Path) -> None:
    written, rewritten = tmp_path / "written.yaml", tmp_path / "rewritten.yaml"
    rows = "".join(f"\n    p{number}: {text}" for number, text in enumerate(SPELLINGS))
    written.write_text(f"probe:\n  ros__parameters:{rows}\n", encoding="utf-8")
    ours = ParameterFile.from_yaml(written)
    rewritten.write_text(ours.text(), encoding="utf-8")
    values = {name: (type(value), value) for name, value in ours.of("probe").items()}
    assert values == of_ros(written) == of_ros(rewritten)


ODD = [
    "null",
    "~",
    "''",
    "!!str 1",
    "!!float 1",
    "|\n  on",
]


@pytest.mark.parametrize("head", ["", "%YAML 1.2\n---\n"], ids=["plain", "says it is YAML 1.2"])
@pytest.mark.parametrize("text", [*SPELLINGS, *ODD])
@pytest.mark.filterwarnings("error")
def test_a_spelling_means_the_same_in_every_file(text: str, head: str) -> None:
    indented = text.replace("\n", "\n    ")
    parameters = ParameterFile(f"{head}probe:\n  ros__parameters:\n    p: {indented}\n", "control.yaml")
    ours = parameters.of("probe")["p"]
    if text == ".inf":  # other nodes may have such parameters
        assert ours == float("inf")
        return
    others = parse_yaml(f"{head}p: {text}\n", "robot.yaml")["p"]
    assert (type(ours), ours) == (type(others), others)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{q: 1, q: 2}", 'found duplicate key "q" with value "2" (original value: "1")'),
        ("[{q: 1, q: 2}]", 'found duplicate key "q" with value "2" (original value: "1")'),
        ("[&a [1], *a]", "found an alias; write out what it stands for (line "),
        ("{q: &a {r: 1}, s: {<<: *a}}", "found an alias; write out what it stands for (line "),
        ("[" + "[" * 2000, "maximum recursion depth"),
        ("!foo 1", "could not determine a constructor for the tag"),
        ("!!float word", "could not convert string to float"),
        ("!!python/object/apply:os.getcwd [1]", "could not determine a constructor for the tag"),
        ("!!timestamp 2001-99-99", "month must be in 1..12"),
        ('"a\\0b"', "found a NUL byte in a text (line "),
        ('["\\x00"]', "found a NUL byte in a text (line "),
        ("[1, 2", "expected ',' or ']'"),
    ],
)
def test_a_text_is_refused_in_every_file(text: str, words: str) -> None:
    with pytest.raises(ParameterError) as ours:
        ParameterFile(f"probe:\n  ros__parameters:\n    p: {text}\n", "control.yaml")
    with pytest.raises(KinematicsError) as others:
        parse_yaml(f"p: {text}\n", "robot.yaml")
    assert words in str(ours.value)
    assert words in str(others.value)


def test_what_is_written_is_read_as_it_was(tmp_path: Path) -> None:
    content = {"on": ["on", "010", "1:30", True, 8, None], "y": {"n": 1e-3}}
    write_yaml(tmp_path / "can.yaml", content)
    assert read_yaml(tmp_path / "can.yaml") == content


def of_ros(file: Path) -> dict[str, tuple[type, object]]:
    """Return the parameters that a node gets from a file, with their types."""
    context = Context()
    rclpy.init(args=["--ros-args", "--params-file", str(file)], context=context)
    try:
        node = Node("probe", context=context, automatically_declare_parameters_from_overrides=True)
        values = {
            name: parameter.value
            for name, parameter in node.get_parameters_by_prefix("").items()
            if name[0] == "p"
        }
        node.destroy_node()
    finally:
        rclpy.try_shutdown(context=context)
    lists = {name: list(value) if hasattr(value, "typecode") else value for name, value in values.items()}
    return {name: (type(value), value) for name, value in lists.items()}
