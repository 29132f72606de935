"""The payload estimator and the feed-forward re-run over what was recorded, sample by sample.

The components of the control graph, fed in the order and at the times at which the messages arrived. Nothing here
depends on the computer's clock or load: the same recording gives the same numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from heapq import merge
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from cspr_control.components.component import NOTHING, Outputs, Publication
from cspr_control.components.feedforward import FeedforwardComponent
from cspr_control.components.payload import PayloadComponent
from cspr_control.estimation.payload import EstimatorSettings
from cspr_control.graph import ControlGraph
from cspr_control.motors.feedforward import FeedforwardSettings
from cspr_kinematics import Payload, Robot
from cspr_msgs_py import topics
from cspr_msgs_py.bag.columns import Inertias, JointStates, References
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.reference import VECTORS, ReferenceSample
from cspr_msgs_py.wire.samples import InertiaSample, Status, WrenchSample

Settings = TypeVar("Settings")

Progress = Callable[[float], None]
Stream = tuple[Sequence[int], Callable[[float, int], Outputs]]
"""Times in ns, and what happens at one of them: called with monotonic time in s and the index of the time."""

Schedule = Sequence[tuple[int, Settings]]
"""Settings and the receive times, ns, from which they hold, in the order of time; the first from the start."""

_SECOND = 1e-9  # s in a nanosecond


def rerun_estimator(
    robot: Robot,
    settings: Schedule[EstimatorSettings],
    states: JointStates,
    tensions: JointStates,
    in_use: Inertias | None,
    initial: Payload | None = None,
    progress: Progress = lambda share: None,
    robot_states: Sequence[tuple[int, Status]] = (),
) -> Inertias:
    """Estimate the payload from recorded motor states and tensions.

    Parameters
    ----------
    robot, settings
        As the node had them, or others.
    states, tensions
        Of all motors and cables, in the order of the robot.
    in_use
        What the feed-forward said that it counts on; None if it was not recorded.
    initial
        Where the estimate begins if that is not known from ``in_use``.
    progress
        Called now and then with the share that is done.
    robot_states
        Receive times, ns, and states of the robot; if there are none, torques of the motors do not count.
    """
    component = PayloadComponent(robot, settings[0][1])
    graph = ControlGraph((component,))
    begin = min(int(states.log_time_ns[0]), int(tensions.log_time_ns[0]))
    if initial is not None:
        graph.deliver(topics.PAYLOAD_IN_USE, 0.0, InertiaSample(0, initial.mass, initial.center_of_mass))

    def take(topic: topics.Topic, joints: JointStates) -> Stream:
        return joints.log_time_ns.tolist(), lambda now, index: graph.deliver(
            topic, now, _joint_state(joints, index)
        )

    def take_payload_in_use(now: float, index: int) -> Outputs:
        assert in_use is not None  # it gave the times of these calls
        sample = InertiaSample(
            int(in_use.time_ns[index]), float(in_use.mass[index]), in_use.center_of_mass[index]
        )
        return graph.deliver(topics.PAYLOAD_IN_USE, now, sample)

    published = _published(
        topics.PAYLOAD,
        begin,
        progress,
        _changes(settings[1:], component.configure),
        _samples(graph, topics.ROBOT_STATE, robot_states),
        ([] if in_use is None else in_use.log_time_ns.tolist(), take_payload_in_use),
        take(topics.MOTOR_STATES, states),
        take(topics.CABLE_TENSIONS, tensions),
    )
    return Inertias(tensions.start_ns, **_columns(published, mass=(), center_of_mass=(3,)))


def heard_by_estimator(
    robot: Robot,
    settings: Schedule[EstimatorSettings],
    states: JointStates,
    tensions: JointStates,
    first: int,
) -> tuple[JointStates, JointStates]:
    """Return those of the recorded motor states and tensions that a late estimator can have heard.

    A node that was started after the recorder has heard less than is recorded. Its first estimate came as long after
    the first cycle that it heard as that of one which has heard all.

    Parameters
    ----------
    robot, settings, states, tensions
        As for `rerun_estimator`, the settings as they were.
    first
        Stamp of its first estimate, ns.
    """
    inputs = states, tensions
    early_states, early_tensions = (_of_stamps(joints, joints.time_ns < first) for joints in inputs)
    if not (len(early_states) and len(early_tensions)):
        return inputs
    early = rerun_estimator(robot, settings, early_states, early_tensions, None)
    if len(early) == 0:
        return inputs
    since = first - (int(early.time_ns[0]) - int(states.time_ns[0]))
    return _of_stamps(states, states.time_ns >= since), _of_stamps(tensions, tensions.time_ns >= since)


def _of_stamps(joints: JointStates, chosen: NDArray[np.bool_]) -> JointStates:
    """Return the chosen ones of joint states."""
    columns = ("time_ns", "log_time_ns", "position", "velocity", "effort")
    return replace(joints, **{name: getattr(joints, name)[chosen] for name in columns})


def rerun_feedforward(
    robot: Robot,
    settings: Schedule[FeedforwardSettings],
    references: References,
    payloads: Inertias | None,
    initial: Payload | None = None,
    progress: Progress = lambda share: None,
    tensions: JointStates | None = None,
    robot_states: Sequence[tuple[int, Status]] = (),
    wrenches: Sequence[tuple[int, WrenchSample]] = (),
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
    tensions
        Of all cables, where set-points begin with the stretch; None if there are none.
    robot_states
        Receive times, ns, and states of the robot; if there are none, the motors follow from the first reference on.
    wrenches
        Receive times, ns, and what the payload did not explain, by which its swing is damped.
    """
    component = FeedforwardComponent(robot, settings[0][1])
    component.feedforward.following = not robot_states
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

    def take_tensions(now: float, index: int) -> Outputs:
        assert tensions is not None  # as above
        return graph.deliver(topics.CABLE_TENSIONS, now, _joint_state(tensions, index))

    begin = [] if tensions is None or not robot_states else tensions.log_time_ns.tolist()
    published = _published(
        topics.SETPOINT,
        int(references.log_time_ns[0]),
        progress,
        _changes(settings[1:], component.configure),
        _samples(graph, topics.ROBOT_STATE, robot_states),
        (begin, take_tensions),
        ([] if payloads is None else payloads.log_time_ns.tolist(), take_payload),
        _samples(graph, topics.EXTERNAL_WRENCH, wrenches),
        (references.log_time_ns.tolist(), answer),
    )
    m = robot.number_of_cables
    columns = _columns(published, position=(m,), velocity=(m,), effort=(m,))
    return JointStates(references.start_ns, names=topics.motor_names(m), **columns)


def arriving_as_recorded(payloads: Inertias, stamps: Sequence[int], published: Sequence[int]) -> Inertias:
    """Let re-run estimates arrive no sooner than the recorded ones of the same stamps were published.

    A re-run takes no time to estimate. A robot does, so that it answers a reference before the estimate of its cycle.

    Parameters
    ----------
    payloads
        The re-run estimates.
    stamps, published
        Of the recorded estimates, in the order of time, ns.
    """
    first: dict[int, int] = {}
    for stamp, time in zip(stamps, published, strict=True):
        first.setdefault(stamp, time)  # a held estimate comes again and again with its stamp
    times = [
        max(time, first.get(stamp, time))
        for stamp, time in zip(payloads.time_ns.tolist(), payloads.log_time_ns.tolist(), strict=True)
    ]
    return replace(payloads, log_time_ns=np.array(times, dtype=np.int64))


def with_those_before(
    payloads: Inertias, recorded: Inertias, published: Sequence[int], begin: int
) -> Inertias:
    """Return re-run estimates after the recorded ones of which the inputs were not recorded.

    A recorder that meets an input late has the estimates that came of it before, and set-points that count on them.

    Parameters
    ----------
    payloads
        The re-run estimates, by the time at which they arrive.
    recorded, published
        The recorded ones, and when they were published, ns.
    begin
        Stamp of the first cycle whose inputs are recorded, ns.
    """
    if not (len(recorded) and len(payloads)) or recorded.time_ns[0] >= begin:
        return payloads
    early = recorded.time_ns < payloads.time_ns[0]
    times = np.minimum(np.asarray(published, dtype=np.int64)[early], payloads.log_time_ns[0])
    return replace(
        payloads,
        time_ns=np.concatenate((recorded.time_ns[early], payloads.time_ns)),
        log_time_ns=np.concatenate((times, payloads.log_time_ns)),
        mass=np.concatenate((recorded.mass[early], payloads.mass)),
        center_of_mass=np.concatenate((recorded.center_of_mass[early], payloads.center_of_mass)),
    )


def _samples(graph: ControlGraph, topic: topics.Topic, samples: Sequence[tuple[int, Any]]) -> Stream:
    return [time for time, _ in samples], lambda now, index: graph.deliver(topic, now, samples[index][1])


def _changes(schedule: Schedule[Settings], configure: Callable[[Settings], None]) -> Stream:
    def change(now: float, index: int) -> Outputs:
        configure(schedule[index][1])
        return NOTHING

    return [time for time, _ in schedule], change


def _columns(published: Sequence[tuple[int, Any]], **fields: tuple[int, ...]) -> dict[str, NDArray[Any]]:
    """Return stamps, times (both ns) and some fields of published samples, with their shapes, as columns."""
    samples = [sample for _, sample in published]
    columns: dict[str, NDArray[Any]] = {
        "time_ns": np.array([sample.stamp_ns for sample in samples], dtype=np.int64),
        "log_time_ns": np.array([time for time, _ in published], dtype=np.int64),
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
) -> list[tuple[int, Any]]:
    """Let the streams act in the order of time; at one time, earlier streams first.

    Returns
    -------
    Time (ns) and sample of all that is published on the topic.
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
                published.append((time, output.sample))
    progress(1.0)
    return published
