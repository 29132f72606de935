"""The configuration that a run was recorded with, and where it differs from another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from cspr_control.errors import ControlError
from cspr_kinematics import ConfigurationFileError, KinematicsError, Robot
from cspr_kinematics.configuration.yaml_file import parse_yaml
from cspr_msgs_py.errors import ParameterError
from cspr_msgs_py.json_file import plain
from cspr_msgs_py.parameters.file import ParameterFile

ROBOT_FILE = "robot.yaml"
_CONTROL_FILE = "control.yaml"
_SAME_MACHINE = (
    "name",
    "exit_points",
    "anchor_points",
    "pulleys",
    "frame_size",
    "platform_size",
    "winch",
    "home",
)
"""Keys of robot.yaml that make it another robot: with another of these, motor angles mean something else."""
_SHOWN = 3  # differences that a note names


@dataclass(frozen=True)
class Configuration:
    """Configuration files by name, and the robot that they describe.

    Attributes
    ----------
    files : mapping of str to str
        Text by the file's name without directory; empty if the bag has none.
    robot : Robot
    robot_file : str
        Where the robot comes from: the name among `files`, or a path on disk.
    """

    files: Mapping[str, str]
    robot: Robot
    robot_file: str


def read_configuration(
    attachments: Mapping[str, bytes], bag: Path, robot_file: Path | None, directory: Path
) -> tuple[Configuration, tuple[str, ...]]:
    """Read the configuration from a bag, and compare it with the files on disk.

    Parameters
    ----------
    attachments
        The bag's, by the names under which they were attached.
    bag
        Its path, for messages.
    robot_file
        A robot to use in place of the attached one.
    directory
        Where the configuration lies on disk: a bag without one is read with its robot.yaml. Need not exist.

    Returns
    -------
    configuration, remarks
        Remarks that say what differs, one line each.

    Raises
    ------
    ControlError
        If there is no robot, or not one that can be used.
    """
    files = {
        PurePosixPath(name).name: data.decode("utf-8", errors="replace")
        for name, data in attachments.items()
        if name.endswith((".yaml", ".yml"))
    }
    remarks: list[str] = []
    try:
        if robot_file is not None:
            robot, source = Robot.from_yaml(robot_file), str(robot_file)
        else:
            source = _name_of_robot_file(files)
            if source in files:
                name = f"{source} in {bag}"
                robot = Robot.from_mapping(parse_yaml(files[source], name), name)
            else:
                source = str(directory / ROBOT_FILE)
                robot = Robot.from_yaml(source)
                remarks.append(f"{bag} has no {ROBOT_FILE} attached: {source} is used in its place")
    except KinematicsError as error:
        raise ControlError(
            f"{bag}: no robot to work with: {error} (name one: analyze --robot FILE, rerun --config DIR)"
        ) from error
    remarks += _compare_with_disk(files, bag, directory)
    return Configuration(files, robot, source), tuple(remarks)


def _name_of_robot_file(files: Mapping[str, str]) -> str:
    """Return the name of the robot file that the recorded parameters name."""
    for node in _mappings(parsed(files.get(_CONTROL_FILE, ""))):
        name = node.get("robot_config")
        if isinstance(name, str) and PurePosixPath(name).name in files:
            return PurePosixPath(name).name
    return ROBOT_FILE


def _mappings(content: Any) -> Iterator[Mapping[str, Any]]:
    if isinstance(content, Mapping):
        yield content
        for value in content.values():
            yield from _mappings(value)


def _compare_with_disk(files: Mapping[str, str], bag: Path, directory: Path) -> Iterator[str]:
    for name in sorted(files):
        path = directory / name
        if path.is_file():
            text, at = path.read_text(encoding="utf-8", errors="replace"), ""
            if name == _CONTROL_FILE:
                text, at = _as_slow(text, files[name])
            found = differences(parsed(files[name]), parsed(text))
            if found:
                yield (
                    f"{name} in {bag} differs from {path}{at}: {describe(found, 'recorded', 'on disk')}; "
                    "the recorded one is used"
                )


def _as_slow(control: str, recorded: str) -> tuple[str, str]:
    """Return a control.yaml as a demo stretches it for the speed of a recorded one, and that speed in words."""
    try:
        speed = float(ParameterFile(recorded, "").values("simulated_robot")["speed"])
        if speed != 1.0:
            file = ParameterFile(control, "")
            file.slow_down(speed)
            return file.text(), f" as stretched for {speed:g} of real time"
    except ParameterError:  # of another version: compared as it is
        pass
    return control, ""


def require_one_robot(configurations: Mapping[str, Configuration]) -> tuple[str, ...]:
    """Make sure that runs, by name, are of one and the same robot.

    Returns
    -------
    tuple of str
        Remarks on the robots' other values that differ: masses, limits, friction.

    Raises
    ------
    ControlError
        If geometry or transmission differ: then there is nothing to compare.
    """
    if not configurations:
        return ()
    (first_name, first), *others = configurations.items()
    remarks = []
    for name, other in others:
        found = differences(_robot_values(first.robot), _robot_values(other.robot))
        if any(key.split(".")[0].split("[")[0] in _SAME_MACHINE for key in found):
            raise ControlError(
                f"{first_name} and {name} are runs of two different robots and cannot be compared: "
                f"{describe(found, 'first', 'second')}"
            )
        if found:
            remarks.append(
                f"the robots of {first_name} and {name} differ: {describe(found, 'first', 'second')}"
            )
    return tuple(remarks)


def _robot_values(robot: Robot) -> dict[str, Any]:
    values: dict[str, Any] = plain(robot)
    del values["winch"]["home_lengths"]  # they follow from the others
    values["cables"] = {name: _said_once(each) for name, each in values["cables"].items()}
    values |= {name: _said_once(values[name]) for name in ("tension_min", "tension_max")}
    return values | {"home": {"position": plain(robot.home.position), "euler": plain(robot.home.euler)}}


def _said_once(per_cable: list[Any]) -> Any:
    """Return a value that is the same for all cables as one."""
    return per_cable[0] if len(set(per_cable)) == 1 else per_cable


def differences(first: Any, second: Any, path: str = "") -> dict[str, tuple[Any, Any]]:
    """Return where two nested structures differ: both values by dotted key; None where one has no such key."""
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        one, other = first, second
        if any("." in str(key) for key in (*first, *second)):
            one, other = _dotted(first), _dotted(second)
        parts = [(f".{key}", one.get(key), other.get(key)) for key in dict.fromkeys((*one, *other))]
    elif isinstance(first, list) and isinstance(second, list) and len(first) == len(second):
        parts = [(f"[{index}]", *pair) for index, pair in enumerate(zip(first, second, strict=True))]
    else:
        return {} if first == second else {path.removeprefix("."): (first, second)}
    found: dict[str, tuple[Any, Any]] = {}
    for part, mine, theirs in parts:
        found |= differences(mine, theirs, path + part)
    return found


def _dotted(content: Mapping[Any, Any]) -> dict[str, Any]:
    """Return values by dotted key: parameters may be written as ``a: {b: 1}`` and as ``a.b: 1``."""
    found: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, Mapping) and value:
            found |= {f"{key}.{name}": each for name, each in _dotted(value).items()}
        else:
            found[str(key)] = value
    return found


def describe(found: Mapping[str, tuple[Any, Any]], first: str, second: str) -> str:
    """Return differences as a phrase: ``platform.mass is 153 recorded, 160 on disk``; the first few of many."""
    shown = [
        f"{key or 'the content'} is {_short(a)} {first}, {_short(b)} {second}"
        for key, (a, b) in found.items()
    ]
    more = f"; and {len(shown) - _SHOWN} more" if len(shown) > _SHOWN else ""
    return "; ".join(shown[:_SHOWN]) + more


def _short(value: Any) -> str:
    text = "absent" if value is None else f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def parsed(text: str) -> Any:
    """Return the mapping that YAML text holds; the text itself, or `None` for no text, where it holds none."""
    try:
        return parse_yaml(text, "")
    except ConfigurationFileError:
        return text or None
