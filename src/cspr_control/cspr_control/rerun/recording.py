"""What a re-run takes from a bag: the inputs, what was recorded of the outputs, and the parameters in use."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePath
from typing import Any, TypeVar

from cspr_control.errors import ControlError, SettingError
from cspr_control.parameters.control_settings import robot_file
from cspr_control.parameters.settings import NoticedValues
from cspr_control.rerun.rerun import Schedule
from cspr_kinematics import Robot
from cspr_kinematics.configuration.yaml_file import parse_yaml
from cspr_msgs_py import topics
from cspr_msgs_py.bag.columns import JointStates
from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.errors import BagError, ParameterError
from cspr_msgs_py.parameters.file import ParameterFile, require_heard
from cspr_msgs_py.parameters.table import parameter_values
from cspr_msgs_py.wire.parameter_events import TOPIC as PARAMETER_EVENTS
from cspr_msgs_py.wire.parameter_events import ParameterEvent, decode_parameter_event

CONTROL_FILE = "control.yaml"

Settings = TypeVar("Settings")
Columns = TypeVar("Columns")


@dataclass(frozen=True, eq=False)
class Configuration:
    """Robot and parameters.

    Attributes
    ----------
    robot, parameters
        What the files say.
    files
        Content of the two files by their names.
    """

    robot: Robot
    parameters: ParameterFile
    files: dict[str, bytes]

    @staticmethod
    def from_files(files: Mapping[str, bytes], where: str) -> Configuration:
        """Read ``control.yaml`` and the robot's file that it names, by their base names.

        Parameters
        ----------
        files
            Contents by name or path.
        where
            What they come from, for errors.

        Raises
        ------
        ControlError, cspr_kinematics.KinematicsError
            If one is missing or does not hold what it should.
        """
        by_name = {PurePath(name).name: data for name, data in files.items()}
        control = _file(by_name, CONTROL_FILE, where)
        parameters = ParameterFile(control, f"{where}: {CONTROL_FILE}")
        robot_name = robot_file(parameters)
        text, source = _file(by_name, robot_name, where), f"{where}: {robot_name}"
        robot = Robot.from_mapping(parse_yaml(text, source), source)
        return Configuration(robot, parameters, {CONTROL_FILE: control, robot_name: text})

    @staticmethod
    def from_directory(directory: Path) -> Configuration:
        """Read the files of a configuration directory; raises as `from_files` does."""
        try:
            files = {path.name: path.read_bytes() for path in sorted(directory.glob("*.yaml"))}
        except OSError as error:
            raise ControlError(f"cannot read {directory}: {error.strerror}") from error
        return Configuration.from_files(files, str(directory))


def _file(files: Mapping[str, bytes], name: str, where: str) -> bytes:
    if name not in files:
        raise ControlError(
            f"{where} holds no {name}; name the directory of the configuration that was in use: --config DIR"
        )
    return files[name]


class Recording:
    """A bag open for a re-run.

    Parameters
    ----------
    bag
        The bag.
    configuration
        Used instead of the files inside the bag.

    Raises
    ------
    ControlError, cspr_kinematics.KinematicsError
        If there is no usable configuration.
    """

    def __init__(self, bag: Bag, configuration: Configuration | None = None) -> None:
        self._bag = bag
        if configuration is None:
            configuration = Configuration.from_files(bag.attachments, f"bag {bag.path}")
        self.configuration = configuration
        self.robot = configuration.robot

    def read(self, kind: Callable[[Bag, str], Columns], topic: str) -> Columns:
        """Return the columns of a topic as a method of `Bag` reads them; raises ControlError if there are none."""
        try:
            return kind(self._bag, topic)
        except BagError as error:
            raise ControlError(f"nothing to re-run: {error}") from error

    def joints(self, topic: topics.Topic, names: Sequence[str]) -> JointStates:
        """Return the joint states on a topic, in the order of the names; raises ControlError if there are none."""
        states = self.read(Bag.joint_states, topic.name)
        if sorted(states.names) != sorted(names):
            raise ControlError(
                f"{self._bag.path}: {topic.name} names {', '.join(states.names)}; "
                f"the robot of the configuration has {', '.join(names)}"
            )
        order = [states.names.index(name) for name in names]
        fields = {name: getattr(states, name) for name in ("position", "velocity", "effort")}
        # a field that the messages do not carry has no columns
        ordered = {name: values[:, order] if values.shape[1] else values for name, values in fields.items()}
        return replace(states, names=tuple(names), **ordered)

    def holds(self, topic: topics.Topic) -> bool:
        """Return whether there is a message on the topic."""
        return self._bag.counts.get(topic.name, 0) > 0

    def publish_times(self, topic: topics.Topic) -> list[int]:
        """Return when the messages on a topic were published, ns."""
        return [published for _, published, _ in self._bag.messages(topic.name)]

    def parameter_events(self, node: str) -> list[tuple[int, ParameterEvent]]:
        """Return receive time (ns) and content of what a node said of its parameters."""
        if self._bag.counts.get(PARAMETER_EVENTS, 0) == 0:
            return []
        try:
            events = [
                (time, decode_parameter_event(data)) for time, _, data in self._bag.messages(PARAMETER_EVENTS)
            ]
        except ValueError as error:
            raise ControlError(f"{self._bag.path}: {PARAMETER_EVENTS} cannot be read: {error}") from error
        return [(time, event) for time, event in events if event.node == node]


def schedule(
    recording: Recording,
    node: str,
    build: Callable[[Mapping[str, Any]], Settings],
    given: Mapping[str, Any],
) -> tuple[Schedule[Settings], dict[str, Any]]:
    """Return the settings of a node as it ran, with some parameters given otherwise.

    What the node declared and how it was changed while it ran counts, as far as it was recorded; before that the
    parameter file.

    Parameters
    ----------
    recording
        Where they come from.
    node
        Name of the node.
    build
        Makes the settings from the values.
    given
        Values that hold from the beginning to the end, whatever was recorded.

    Returns
    -------
    The settings over time, and the values at the start without the given ones.

    Raises
    ------
    ControlError
        If a value does not fit its parameter.
    """
    events = recording.parameter_events(node)
    declared: dict[str, Any] = {}
    for _, event in events:
        declared |= event.declared
    try:
        recorded = parameter_values(node, recording.configuration.parameters.of(node), declared)
        values = recorded
        first = NoticedValues(parameter_values(node, recorded, given))
        settings = [(0, build(first))]
        for name in given:
            require_heard("re-run", node, name, {node: first.names})
        for time, event in events:
            changed = {name: value for name, value in event.changed.items() if name in recorded}
            if changed:
                values = parameter_values(node, values, changed)
                settings.append((time, build(parameter_values(node, values, given))))
    except (ControlError, ParameterError) as error:
        raise SettingError(f"{node}: {error}") from error
    return settings, recorded
