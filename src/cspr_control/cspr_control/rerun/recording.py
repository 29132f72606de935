"""What a re-run takes from a bag: the inputs, what was recorded of the outputs, and the parameters in use."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePath
from typing import Any, TypeVar

from cspr_control.analysis.configuration import read_configuration
from cspr_control.analysis.recording import CONFIGURATION_DIRECTORY, robot_clock
from cspr_control.analysis.timeline import Clock, Timeline, read_timeline
from cspr_control.errors import ControlError, SettingError
from cspr_control.parameters.settings import NoticedValues
from cspr_control.rerun.rerun import Schedule
from cspr_msgs_py import topics
from cspr_msgs_py.bag.columns import JointStates
from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.errors import BagError, MessageError, ParameterError
from cspr_msgs_py.parameters.file import ParameterFile, require_heard
from cspr_msgs_py.parameters.table import node_parameters, parameter_values
from cspr_msgs_py.wire.parameter_events import TOPIC as PARAMETER_EVENTS
from cspr_msgs_py.wire.parameter_events import ParameterEvent, decode_parameter_event
from cspr_msgs_py.wire.topic_codecs import topic_codec

CONTROL_FILE = "control.yaml"

Settings = TypeVar("Settings")
Columns = TypeVar("Columns")


class Recording:
    """A bag open for a re-run.

    Parameters
    ----------
    bag
        The bag.
    directory
        Of a configuration to use instead of the files inside the bag.

    Attributes
    ----------
    robot, parameters
        What the configuration says.
    files
        Content of the files in use, by name.
    remarks
        Where the configuration inside the bag differs from the one on disk, one line each.
    speed
        Seconds of the machine in a second of the computer; durations and rates in `parameters` are stretched by it.

    Raises
    ------
    ControlError, ParameterError, OSError
        If there is no usable configuration.
    """

    def __init__(self, bag: Bag, directory: Path | None = None) -> None:
        self._bag = bag
        self._read: dict[tuple[Callable[..., Any], str], Any] = {}  # what several ask for is decoded once
        files, where = bag.attachments, bag.path
        if directory is not None:
            files, where = {path.name: path.read_bytes() for path in directory.glob("*.yaml")}, directory
        if CONTROL_FILE not in {PurePath(name).name for name in files}:
            raise ControlError(
                f"{where} holds no {CONTROL_FILE}; name the directory of the configuration in use: --config DIR"
            )
        used, remarks = read_configuration(files, where, None, directory or CONFIGURATION_DIRECTORY)
        self.remarks: tuple[str, ...] = () if directory is not None else remarks
        self.robot = used.robot
        self.parameters = ParameterFile(used.files[CONTROL_FILE], f"{where}: {CONTROL_FILE}")
        self.speed = float(self.parameters.values("simulated_robot")["speed"])
        if self.speed != 1.0:
            self.remarks += (
                f"the machine ran at {self.speed:g} of real time: parameters are given and shown as in real time",
            )
        names = {CONTROL_FILE, used.robot_file} & set(used.files)
        self.files = {name: used.files[name].encode() for name in names}

    def read(self, kind: Callable[[Bag, str], Columns], topic: str) -> Columns:
        """Return the columns of a topic as a method of `Bag` reads them; raises ControlError if there are none."""
        if (kind, topic) not in self._read:
            try:
                self._read[kind, topic] = kind(self._bag, topic)
            except BagError as error:
                raise ControlError(f"nothing to re-run: {error}") from error
        columns: Columns = self._read[kind, topic]
        return columns

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

    def story(self, tensions: JointStates) -> tuple[Clock, Timeline]:
        """Return the robot's clock, by its motor states or else by its tensions, and what happened on it."""
        states = (
            self.read(Bag.joint_states, topics.MOTOR_STATES.name)
            if self.holds(topics.MOTOR_STATES)
            else tensions
        )
        clock = robot_clock(states)
        return clock, read_timeline(self._bag, clock, int(states.time_ns[-1]))

    def publish_times(self, topic: topics.Topic) -> list[int]:
        """Return when the messages on a topic were published, ns."""
        return [published for _, published, _ in self._bag.messages(topic.name)]

    def samples(self, topic: topics.Topic) -> list[tuple[int, Any]]:
        """Return receive times (ns) and samples of a topic, if any; raises ControlError if they cannot be read."""
        if not self.holds(topic):
            return []
        decode = topic_codec(topic, self.robot.number_of_cables).decode
        try:
            return [(time, decode(data)) for time, _, data in self._bag.messages(topic.name)]
        except MessageError as error:
            raise ControlError(f"{self._bag.path}: {topic.name} cannot be read: {error}") from error

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
        Values that hold from the beginning to the end, whatever was recorded; as for a machine in real time.

    Returns
    -------
    The settings over time, and the values at the start without the given ones, as for a machine in real time.

    Raises
    ------
    ControlError
        If a value does not fit its parameter.
    """
    events = recording.parameter_events(node)
    given = _in_slow_motion(node, given, recording.speed)
    declared: dict[str, Any] = {}
    for _, event in events:
        declared |= event.declared
    try:
        recorded = parameter_values(node, recording.parameters.of(node), declared)
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
    return settings, _in_slow_motion(node, recorded, 1.0 / recording.speed)


def _in_slow_motion(node: str, values: Mapping[str, Any], speed: float) -> dict[str, Any]:
    """Return values of parameters as a machine at a speed of real time has them, rounded to 12 digits."""
    rows = node_parameters(node)
    return {
        name: float(f"{rows[name].in_slow_motion(value, speed):.12g}")
        if speed != 1.0 and rows[name].stretch
        else value
        for name, value in values.items()
    }
