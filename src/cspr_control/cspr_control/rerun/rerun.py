"""The payload estimator and the feed-forward re-run over what was recorded, sample by sample.

The components of the control graph, fed in the order and at the times at which the messages arrived. Nothing here
depends on the computer's clock or load: the same recording gives the same numbers.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from heapq import merge
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cspr_control.components.component import NOTHING, Outputs, Publication
from cspr_control.components.feedforward import FeedforwardComponent
from cspr_control.components.payload import PayloadComponent
from cspr_control.estimation.payload import UPDATE_PERIOD, EstimatorSettings
from cspr_control.graph import ControlGraph
from cspr_control.motors.feedforward import FeedforwardSettings
from cspr_kinematics import Payload, Robot
from cspr_msgs_py import topics
from cspr_msgs_py.bag.columns import Inertias, JointStates, Poses, References
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.reference import VECTORS, ReferenceSample
from cspr_msgs_py.wire.samples import InertiaSample, PoseSample

Times = NDArray[np.int64]
Settings = TypeVar("Settings")

Progress = Callable[[float], None]
Stream = tuple[Sequence[int], Callable[[float, int], Outputs]]
"""Times in ns, and what happens at one of them: called with monotonic time in s and the index of the time."""

Schedule = Sequence[tuple[int, Settings]]
"""Settings and the receive times, ns, from which they hold, in the order of time; the first from the start."""

_SECOND = 1e-9  # s in a nanosecond
_PERIOD = round(UPDATE_PERIOD * 1e9)  # ns


@dataclass(frozen=True)
class EstimatedPayloads(Inertias):
    """Published estimates; `update` is the index of the update that each came of, shape (n,)."""

    update: Times


def update_times(
    tensions: JointStates, poses: Poses, recorded: Inertias | None, publish_times: Sequence[int]
) -> list[int]:
    """Return the times at which the estimator estimated, ns, as far as the recording tells.

    Each message on ``/payload`` came of one update and was published at once. Where its stamp, that of the newest
    input that took part, shows that inputs arrived in between, the update is put before them. Where no message was
    recorded, there is an update every `UPDATE_PERIOD`.

    Parameters
    ----------
    tensions, poses
        The inputs.
    recorded, publish_times
        The n messages on ``/payload`` and when they were published, ns; None and nothing if there are none.
    """
    if recorded is None:
        first = int(min(tensions.log_time_ns[0], poses.log_time_ns[0]))
        last = int(max(tensions.log_time_ns[-1], poses.log_time_ns[-1]))
        return list(range(first + _PERIOD, last + _PERIOD, _PERIOD))
    arrivals = sorted(
        (int(stamp), int(arrival))
        for inputs in (tensions, poses)
        for stamp, arrival in zip(inputs.time_ns, inputs.log_time_ns, strict=True)
    )
    stamps = [stamp for stamp, _ in arrivals]
    # earliest arrival of an input with this stamp or a later one
    earliest = np.minimum.accumulate([arrival for _, arrival in arrivals][::-1])[::-1].tolist()
    times: list[int] = []
    previous = 0
    published = np.minimum(recorded.log_time_ns, publish_times).tolist()
    for stamp, time in zip(recorded.time_ns.tolist(), published, strict=True):
        later = bisect_right(stamps, stamp)
        # while the estimate is held its stamp stays, and says nothing about the inputs since
        known = stamp != previous and later < len(stamps)
        times.append(min(time, earliest[later] - 1) if known else time)
        previous = stamp
    return times


def rerun_estimator(
    robot: Robot,
    settings: Schedule[EstimatorSettings],
    tensions: JointStates,
    poses: Poses,
    updates: Sequence[int],
    initial: Payload | None = None,
    first: int = 0,
    progress: Progress = lambda share: None,
) -> EstimatedPayloads:
    """Estimate the payload from recorded tensions and poses.

    Parameters
    ----------
    robot, settings
        As the node had them, or others.
    tensions
        Of all cables, in the order of the robot.
    poses
        Of the platform.
    updates
        Times of the estimates, ns; see `update_times`.
    initial
        Published at the first update. A recording may begin when the estimator has been at work for long; its
        first message tells where the rate limit stood.
    first
        Index of the first update that is made; of those before, the recording may not have the inputs.
    progress
        Called now and then with the share that is done.
    """
    component = PayloadComponent(robot, settings[0][1], initial)
    graph = ControlGraph((component,))
    begin = updates[first]

    def observe_tensions(now: float, index: int) -> Outputs:
        if tensions.log_time_ns[index] <= begin - _PERIOD:  # part of an update before the first one known
            return NOTHING
        return graph.deliver(topics.CABLE_TENSIONS, now, _joint_state(tensions, index))

    def observe_pose(now: float, index: int) -> Outputs:
        stamp = int(poses.time_ns[index])
        sample = PoseSample(stamp, poses.position[index], poses.quaternion_xyzw[index])
        return graph.deliver(topics.PLATFORM_POSE, now, sample)

    published = _published(
        topics.PAYLOAD,
        begin,
        progress,
        _changes(settings[1:], component.configure),
        (tensions.log_time_ns.tolist(), observe_tensions),
        (poses.log_time_ns.tolist(), observe_pose),
        (updates[first:], lambda now, index: component.update(now)),
    )
    return EstimatedPayloads(
        tensions.start_ns,
        **_columns(published, mass=(), center_of_mass=(3,)),
        update=np.array([first + index for _, index, _ in published], dtype=np.int64),
    )


def rerun_feedforward(
    robot: Robot,
    settings: Schedule[FeedforwardSettings],
    references: References,
    payloads: Inertias | None,
    initial: Payload | None = None,
    progress: Progress = lambda share: None,
) -> JointStates:
    """Answer recorded references with set-points; each is published when its reference has arrived.

    Parameters
    ----------
    robot, settings
        As the node had them, or others.
    references
        What the motors were to follow.
    payloads
        Recorded or re-run estimates; None if there are none.
    initial
        Estimate that had arrived before the first reference.
    progress
        Called now and then with the share that is done.
    """
    component = FeedforwardComponent(robot, settings[0][1])
    graph = ControlGraph((component,))
    if initial is not None:
        graph.deliver(topics.PAYLOAD, 0.0, InertiaSample(0, initial.mass, initial.center_of_mass))

    def take_payload(now: float, index: int) -> Outputs:
        assert payloads is not None  # it gave the times of these calls
        stamp, mass = int(payloads.time_ns[index]), float(payloads.mass[index])
        sample = InertiaSample(stamp, mass, payloads.center_of_mass[index])
        return graph.deliver(topics.PAYLOAD, now, sample)

    def answer(now: float, index: int) -> Outputs:
        vectors = {name: getattr(references, name)[index] for name in VECTORS}
        stamp, elapsed = int(references.time_ns[index]), float(references.time_from_start[index])
        return graph.deliver(topics.REFERENCE, now, ReferenceSample(stamp, elapsed, **vectors))

    published = _published(
        topics.SETPOINT,
        int(references.log_time_ns[0]),
        progress,
        _changes(settings[1:], component.configure),
        ([] if payloads is None else payloads.log_time_ns.tolist(), take_payload),
        (references.log_time_ns.tolist(), answer),
    )
    m = robot.number_of_cables
    columns = _columns(published, position=(m,), velocity=(m,), effort=(m,))
    return JointStates(references.start_ns, names=topics.motor_names(m), **columns)


def _changes(schedule: Schedule[Settings], configure: Callable[[Settings], None]) -> Stream:
    def change(now: float, index: int) -> Outputs:
        configure(schedule[index][1])
        return NOTHING

    return [time for time, _ in schedule], change


def _columns(published: Sequence[tuple[int, int, Any]], **fields: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    """Return stamps, times (both ns) and some fields of published samples, with their shapes, as columns."""
    samples = [sample for _, _, sample in published]
    columns: dict[str, NDArray[Any]] = {
        "time_ns": np.array([sample.stamp_ns for sample in samples], dtype=np.int64),
        "log_time_ns": np.array([time for time, _, _ in published], dtype=np.int64),
    }
    for name, shape in fields.items():
        values = np.array([getattr(sample, name) for sample in samples], dtype=float)
        columns[name] = values.reshape(len(samples), *shape)
    return columns


def _joint_state(states: JointStates, index: int) -> JointStateSample:
    fields = (states.position, states.velocity, states.effort)
    return JointStateSample(int(states.time_ns[index]), *(field[index] for field in fields))


def _published(
    topic: topics.Topic, begin: int, progress: Progress, *streams: Stream
) -> list[tuple[int, int, Any]]:
    """Let the streams act in the order of time; at one time, earlier streams first.

    Returns
    -------
    Time (ns), index of the action in its stream, and sample of all that is published on the topic.
    """
    total = sum(len(times) for times, _ in streams)
    ordered = merge(
        *(
            sorted((time, number, index) for index, time in enumerate(times))
            for number, (times, _) in enumerate(streams)
        )
    )
    published = []
    for done, (time, number, index) in enumerate(ordered):
        if done % 1000 == 0:
            progress(done / total)
        for output in streams[number][1]((time - begin) * _SECOND, index):
            if isinstance(output, Publication) and output.topic is topic:
                published.append((time, index, output.sample))
    progress(1.0)
    return published
