"""What happened when: states of the robot, trajectories, faults and marked events, from the messages in a bag."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.sample_memory import SampleMemory
from cspr_msgs_py import topics
from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.topics import Topic
from cspr_msgs_py.vocabulary import UNDER_WAY, DriverState, Level, RobotState, TrajectoryPhase
from cspr_msgs_py.wire.samples import Status

Clock = Callable[[NDArray[np.int64]], NDArray[np.int64]]
_WARNING, _ERROR = 30, 40  # levels of rcl_interfaces/Log


class EventKind(Enum):
    """What sort of event it is; faults and marks are what one looks for first."""

    FAULT = "fault"
    MARK = "mark"
    PAYLOAD = "payload"
    WARNING = "warning"
    STATE = "state"


@dataclass(frozen=True)
class Event:
    """Something that happened at one moment, ROS time in ns."""

    time_ns: int
    kind: EventKind
    text: str


@dataclass(frozen=True)
class Span:
    """A stretch of time in which the robot was in one state or on one trajectory, by its name; ROS time in ns."""

    start_ns: int
    end_ns: int
    name: str


@dataclass(frozen=True)
class Timeline:
    """The story of a recording.

    Attributes
    ----------
    states : tuple of Span
        Of the supervisor, without gaps from the first one known.
    trajectories : tuple of Span
        Those that were started, each to its end or to where it was aborted.
    events : tuple of Event
        In the order of time.
    diagnostics : dict of str to tuple
        Of each node, by its name: times (ns) and statuses.
    """

    states: tuple[Span, ...]
    trajectories: tuple[Span, ...]
    events: tuple[Event, ...]
    diagnostics: dict[str, tuple[tuple[int, Status], ...]]

    def counts(self, time_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which times are on a trajectory, and so count for the numbers; all of them if there was none."""
        inside = np.full(time_ns.shape, not self.trajectories)
        for run in self.trajectories:
            inside |= (time_ns >= run.start_ns) & (time_ns <= run.end_ns)
        return inside


def read_timeline(bag: Bag | SampleMemory, clock: Clock, end_ns: int) -> Timeline:
    """Read the status messages of a bag; topics that it lacks are left out.

    Parameters
    ----------
    bag
    clock
        Turns times of the recorder (n,) into those of the robot, ns.
    end_ns
        When the measurements end, on the robot's clock.

    Raises
    ------
    BagError
        If a message is not what its topic promises.
    """

    def read(topic: str) -> list[tuple[int, Any]]:
        if not counts.get(topic):
            return []
        found = bag.read(topic)
        return list(zip(clock(found.log_time_ns).tolist(), found.messages, strict=True))

    counts = bag.counts

    def statuses(topic: Topic) -> list[tuple[int, Status]]:
        messages = read(topic.name)
        if topic.type == topics.DIAGNOSTIC_ARRAY:
            messages = [(t, status) for t, array in messages for status in array.status]
        return [(t, _status(message)) for t, message in messages]

    robot, trajectory = statuses(topics.ROBOT_STATE), statuses(topics.TRAJECTORY_STATE)
    diagnostics: dict[str, list[tuple[int, Status]]] = {}
    for t, status in statuses(topics.DIAGNOSTICS):
        diagnostics.setdefault(status.name.rsplit("/", 1)[-1], []).append((t, status))
    events = [
        *_state_events(robot),
        *_drive_events(statuses(topics.DRIVE_STATES)),
        *_trajectory_events(trajectory),
        *(Event(t, EventKind.MARK, message.data) for t, message in read(topics.EVENTS.name)),
        *_log_events(read(topics.ROSOUT.name)),
    ]
    return Timeline(
        _spans(robot, end_ns),
        _trajectories(trajectory, end_ns),
        tuple(sorted(events, key=lambda event: event.time_ns)),
        {name: tuple(entries) for name, entries in diagnostics.items()},
    )


def _status(message: Any) -> Status:
    values = {pair.key: pair.value for pair in message.values}
    return Status(message.name, Level(min(message.level, Level.STALE)), message.message, values)


def _spans(statuses: Sequence[tuple[int, Status]], end_ns: int) -> tuple[Span, ...]:
    spans: list[Span] = []
    for index, (time_ns, status) in enumerate(statuses):
        until = statuses[index + 1][0] if index + 1 < len(statuses) else max(end_ns, time_ns)
        if spans and spans[-1].name == status.message:
            spans[-1] = Span(spans[-1].start_ns, until, status.message)
        else:
            spans.append(Span(time_ns, until, status.message))
    return tuple(spans)


def _trajectories(statuses: Sequence[tuple[int, Status]], end_ns: int) -> tuple[Span, ...]:
    runs: list[Span] = []
    for index, (_, status) in enumerate(statuses):
        start, end = (int(status.values.get(key, "0") or 0) for key in ("start_time", "end_time"))
        if status.message not in UNDER_WAY or start == 0 or (runs and runs[-1].start_ns == start):
            continue
        left = next((entry for entry in statuses[index + 1 :] if entry[1].message not in UNDER_WAY), None)
        if left is not None and left[1].message != TrajectoryPhase.FINISHED:  # aborted
            end = min(end, left[0])
        end = min(end, end_ns)
        if end > start:  # not one that was aborted on the way to its start
            runs.append(Span(start, end, status.values.get("trajectory", "")))
    return tuple(runs)


def _state_events(statuses: Iterable[tuple[int, Status]]) -> Iterable[Event]:
    for time_ns, status in statuses:
        cause = status.values.get("cause") or status.values.get("remark") or ""
        text = f"robot {status.message}" + (f": {cause}" if cause else "")
        yield Event(time_ns, EventKind.FAULT if status.message == RobotState.FAULT else EventKind.STATE, text)


def _drive_events(statuses: Iterable[tuple[int, Status]]) -> Iterable[Event]:
    """Yield each error of a drive once, when it appears."""
    present: dict[str, str] = {}
    for time_ns, status in statuses:
        error = status.values.get("error_code", "0x0000")
        trouble = status.message if DriverState.FAULT in status.message else ""
        if error not in ("0x0000", ""):
            trouble = f"{status.message}, error {error}"
        if trouble and present.get(status.name) != trouble:
            yield Event(time_ns, EventKind.FAULT, f"{status.name}: {trouble}")
        present[status.name] = trouble


def _trajectory_events(statuses: Iterable[tuple[int, Status]]) -> Iterable[Event]:
    for time_ns, status in statuses:
        name = status.values.get("trajectory", "")
        named = f" {name}" if name and status.message in (*UNDER_WAY, TrajectoryPhase.FINISHED) else ""
        yield Event(time_ns, EventKind.STATE, f"trajectory{named}: {status.message}")


def _log_events(lines: Iterable[tuple[int, Any]]) -> Iterable[Event]:
    for time_ns, line in lines:
        if line.level >= _WARNING:
            kind = EventKind.FAULT if line.level >= _ERROR else EventKind.WARNING
            yield Event(time_ns, kind, f"{line.name}: {line.msg}")
