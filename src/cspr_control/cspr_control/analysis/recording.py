"""A recorded run in memory: the columns of its topics, its configuration and its story."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.alignment import Alignment
from cspr_control.analysis.configuration import Configuration, read_configuration
from cspr_control.analysis.pose_track import PoseTrack
from cspr_control.analysis.sample_memory import SampleMemory
from cspr_control.analysis.timeline import Span, Timeline, read_timeline
from cspr_control.errors import ControlError
from cspr_kinematics import Robot
from cspr_msgs_py import topics
from cspr_msgs_py.bag.columns import Inertias, JointStates, Poses, References
from cspr_msgs_py.bag.reader import Bag, find_bag
from cspr_msgs_py.errors import BagError, BagWarning
from cspr_msgs_py.topics import Topic
from cspr_msgs_py.vocabulary import Controller, controller_label

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
T = TypeVar("T")

CONFIGURATION_DIRECTORY = Path("config")
TRUE_POSE = "true pose"


def recorded_time(time_ns: int) -> str:
    """Return a ROS time in ns as people read it, in UTC, to the millisecond."""
    return datetime.fromtimestamp(time_ns * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S.%f")[:-3]


@dataclass(frozen=True)
class Window:
    """The stretch of time that a number covers: its name, and from when to when, s since time zero."""

    name: str
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class ActualPose:
    """Where the platform was, to judge it by.

    Attributes
    ----------
    source
        `TRUE_POSE`, or the topic or file of what measured it.
    track
        In base.
    point
        Whose position it is, in platform (3,), m.
    alignment
        What was done to a measured pose before; None if nothing was.
    """

    source: str
    track: PoseTrack
    point: Floats
    alignment: Alignment | None = None


@dataclass(frozen=True, eq=False)
class Recording:
    """What a bag holds of one run; None for a topic that it lacks or has no message of.

    Columns are in the order of their stamps, joints in the order of the robot's motors.

    Attributes
    ----------
    path : Path
        The bag.
    configuration : Configuration
    timeline : Timeline
    states, setpoints, tensions : JointStates
    command_torque : ndarray, shape (n, m), or None
        What the controllers answered to each of the n motor states, N m; NaN where they did not.
    references : References or None
    poses : Poses or None
        As estimated.
    actual : ActualPose or None
        True pose of a simulated robot, or what measured it in its place.
    estimate, truth : Inertias or None
        The payload as estimated and, of a simulated robot, as it is; the log times are on the robot's clock.
    outcome : dict
        ``summary.json`` beside the bag, where the demo wrote one; else empty.
    information : dict of str to str
        How the recording was made.
    remarks : tuple of str
        What is missing or odd, in one line each.
    """

    path: Path
    configuration: Configuration
    timeline: Timeline
    states: JointStates
    setpoints: JointStates | None
    tensions: JointStates | None
    command_torque: Floats | None
    references: References | None
    poses: Poses | None
    actual: ActualPose | None
    estimate: Inertias | None
    truth: Inertias | None
    outcome: dict[str, Any]
    information: dict[str, str]
    remarks: tuple[str, ...]

    @property
    def robot(self) -> Robot:
        """The robot as the controller believed it to be."""
        return self.configuration.robot

    def cable_lengths(self) -> Floats:
        """Return the lengths of the cables (n, m) at the motor states, m, stretch included.

        Under the measured tensions, or where there are none under those of the home pose.
        """
        states, tensions = self.states, self.tensions
        if tensions is None or not self.robot.cables.stretch:
            return self.robot.cable_lengths(states.position)
        columns = [np.interp(states.time_ns, tensions.time_ns, column) for column in tensions.effort.T]
        return self.robot.cable_lengths(states.position, np.maximum(np.stack(columns, axis=-1), 0.0))

    @property
    def trajectories(self) -> tuple[Span, ...]:
        """The trajectories that were followed."""
        return self.timeline.trajectories

    @cached_property
    def origin_ns(self) -> int:
        """Time zero of every figure: the start of the first trajectory, or of the recording without one."""
        return self.trajectories[0].start_ns if self.trajectories else int(self.states.time_ns[0])

    def seconds(self, time_ns: Times) -> Floats:
        """Return ROS times in ns as seconds since time zero."""
        return np.asarray((time_ns - self.origin_ns) * 1e-9)

    @cached_property
    def window(self) -> Window:
        """The stretch that the numbers of the run cover: its trajectories; all of the recording if there was none."""
        first, last = int(self.states.time_ns[0]), int(self.states.time_ns[-1])
        if self.trajectories:
            first, last = self.trajectories[0].start_ns, self.trajectories[-1].end_ns
        start, end = self.seconds(np.array([first, last])).tolist()
        return Window("trajectory" if self.trajectories else "recording", start, end)

    def in_window(self, time_ns: Times) -> NDArray[np.bool_]:
        """Return which times are on a trajectory, and so count for the numbers; all of them if there was none."""
        return self.timeline.counts(time_ns)

    @property
    def trajectory(self) -> str:
        """Names of the trajectories, in the order in which they were followed."""
        return ", ".join(dict.fromkeys(run.name for run in self.trajectories if run.name)) or "no trajectory"

    @cached_property
    def controller(self) -> str:
        """The controller by its name in the demo, or ``feed-forward not recorded``."""
        if "simulated" in self.information:
            return self.information["simulated"]
        if "controller" in self.outcome:
            return controller_label(self.outcome["controller"], bool(self.outcome.get("exact_mass")))
        entries = self.timeline.diagnostics.get("feedforward", ())
        values = entries[-1][1].values if entries else {}
        found = Controller.of(values.get("model", ""), values.get("payload_source", ""))
        return found or "feed-forward not recorded"


def robot_clock(states: JointStates) -> Callable[[Times], Times]:
    """Return what turns the recorder's times into those of the robot, ns.

    Messages carry the robot's time; a simulated robot may run slower than the wall clock. Messages without a time of
    their own are placed by when they arrived among the motor states, outside of which the two clocks run alike.
    """
    order = np.argsort(states.log_time_ns, kind="stable")
    log_origin, origin = int(states.log_time_ns[order[0]]), int(states.time_ns[order[0]])
    logs = (states.log_time_ns[order] - log_origin).astype(float)
    times = (states.time_ns[order] - origin).astype(float)

    def robot_time(log_time_ns: Times) -> Times:
        log = (log_time_ns - log_origin).astype(float)
        inside = np.clip(log, logs[0], logs[-1])
        time = np.interp(inside, logs, times) + (log - inside)
        return np.asarray(np.rint(time).astype(np.int64) + origin)

    return robot_time


def read_recording(
    path: Path, robot_file: Path | None = None, configuration_directory: Path = CONFIGURATION_DIRECTORY
) -> Recording:
    """Read a bag.

    Parameters
    ----------
    path
        A bag, or the directory of a run of the demo.
    robot_file
        A robot to use in place of the attached one.
    configuration_directory
        Where the configuration lies on disk, to say where the recorded one differs.

    Raises
    ------
    ControlError
        If the bag cannot be read, has no motor states, or its robot does not fit them.
    """
    path = find_bag(path)
    try:
        with (
            warnings.catch_warnings(record=True, action="always", category=BagWarning) as caught,
            Bag(path) as bag,
        ):
            recording = recording_of(bag, robot_file, configuration_directory)
    except BagError as error:
        raise ControlError(str(error)) from error
    damage = tuple(str(warning.message) for warning in caught if issubclass(warning.category, BagWarning))
    object.__setattr__(recording, "remarks", (*damage, *recording.remarks))
    return recording


def recording_of(
    bag: Bag | SampleMemory, robot_file: Path | None = None, directory: Path = CONFIGURATION_DIRECTORY
) -> Recording:
    """Return the recording in an open bag, or of samples in memory; otherwise as `read_recording`."""
    path, counts = bag.path, bag.counts
    if not counts.get(topics.MOTOR_STATES.name):
        known = ", ".join(sorted(name for name, count in counts.items() if count)) or "nothing at all"
        raise ControlError(
            f"{path} has no messages on {topics.MOTOR_STATES.name}, without which there is no run to analyse; "
            f"it has {known}"
        )
    configuration, notes = read_configuration(bag.attachments, path, robot_file, directory)
    remarks = list(notes)

    def optional(topic: Topic, read: Callable[[str], T], purpose: str) -> T | None:
        if counts.get(topic.name):
            return read(topic.name)
        remarks.append(f"{path} has no messages on {topic.name}: {purpose}")
        return None

    def joints(topic: str) -> JointStates:
        return _sorted(bag.joint_states(topic))

    states = joints(topics.MOTOR_STATES.name)
    m = configuration.robot.number_of_cables
    if states.position.shape[1] != m:
        raise ControlError(
            f"{path}: {topics.MOTOR_STATES.name} is of {states.position.shape[1]} motors, "
            f"{configuration.robot_file} describes {m}: name the robot that was recorded with --robot FILE"
        )
    setpoints = optional(topics.SETPOINT, joints, "no motor position and velocity errors")
    tensions = optional(topics.CABLE_TENSIONS, joints, "no measured tensions")
    references = optional(
        topics.REFERENCE, lambda topic: _sorted(bag.references(topic)), "no tensions of the model"
    )
    poses = optional(
        topics.PLATFORM_POSE,
        lambda topic: _sorted(bag.poses(topic)),
        "the platform is not shown where it was",
    )
    actual = None
    if counts.get(topics.TRUE_POSE.name):
        actual = ActualPose(TRUE_POSE, PoseTrack.of(bag.poses(topics.TRUE_POSE.name)), np.zeros(3))
    clock = robot_clock(states)

    def arrived(topic: str) -> Inertias:
        payload = bag.inertias(topic)
        return replace(payload, log_time_ns=clock(payload.log_time_ns))

    estimate = optional(topics.PAYLOAD, arrived, "no estimated payload")
    truth = optional(topics.SIMULATED_PAYLOAD, arrived, "the true payload is not known")
    return Recording(
        path,
        configuration,
        read_timeline(bag, clock, int(states.time_ns[-1])),
        states,
        setpoints,
        tensions,
        _commands(bag, counts, states, m, remarks),
        references,
        poses,
        actual,
        estimate,
        truth,
        _outcome(path),
        bag.metadata.get("recording", {}),
        tuple(remarks),
    )


def _commands(
    bag: Bag | SampleMemory, counts: dict[str, int], states: JointStates, m: int, remarks: list[str]
) -> Floats | None:
    """Return the torque that answered each motor state: a command bears the stamp of the state it answers."""
    missing = [k for k in range(1, m + 1) if not counts.get(topics.motor_command(k).name)]
    if missing:
        remarks.append(
            f"{bag.path} has no messages on {topics.motor_command(missing[0]).name}"
            f"{f' and {len(missing) - 1} others' if len(missing) > 1 else ''}: no saturation, no unanswered cycles"
        )
        return None
    torque = np.full((states.time_ns.size, m), np.nan)
    for k in range(m):
        commands = bag.joint_states(topics.motor_command(k + 1).name)
        place = np.searchsorted(states.time_ns, commands.time_ns)
        place = np.minimum(place, states.time_ns.size - 1)
        answered = states.time_ns[place] == commands.time_ns
        torque[place[answered], k] = commands.effort[answered, 0]
    return torque


def _sorted(columns: T) -> T:
    """Return columns in the order of their stamps."""
    values = vars(columns)
    order = np.argsort(values["time_ns"], kind="stable")
    if np.array_equal(order, np.arange(order.size)):
        return columns
    return type(columns)(
        **{name: value[order] if isinstance(value, np.ndarray) else value for name, value in values.items()}
    )


def _outcome(path: Path) -> dict[str, Any]:
    try:
        content = json.loads((path.parent / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
