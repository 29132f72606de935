"""The payload estimator and the feed-forward once more over what was recorded, sample by sample.

The very objects that the nodes call, fed in the order and at the times at which the messages arrived. Nothing here
depends on the machine's clock or load: the same recording gives the same numbers.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from heapq import merge
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from cspr_control.errors import MeasurementError, PayloadError
from cspr_control.estimation.payload import UPDATE_PERIOD, EstimatorSettings, PayloadEstimator
from cspr_control.motors.feedforward import Feedforward, FeedforwardSettings
from cspr_control.reference.reference_point import ReferencePoint
from cspr_kinematics import KinematicsError, Payload, Pose, Robot
from cspr_msgs_py.bag.reader import Inertias, JointStates, Poses, References
from cspr_msgs_py.wire.reference import VECTORS, ReferenceSample

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
Settings = TypeVar("Settings")

Progress = Callable[[float], None]

_SECOND = 1e-9  # s in a nanosecond
_PERIOD = round(UPDATE_PERIOD * 1e9)  # ns


def _silent(share: float) -> None:
    """Show no progress."""


@dataclass(frozen=True)
class Schedule(Generic[Settings]):
    """Settings and the times from which they hold.

    Attributes
    ----------
    first
        What holds from the start.
    changes
        Receive time (ns) and what holds from then on, in the order of time.
    """

    first: Settings
    changes: tuple[tuple[int, Settings], ...] = ()


@dataclass(frozen=True, eq=False)
class EstimatedPayloads:
    """Published estimates: n of them, as messages on ``/payload``.

    Attributes
    ----------
    update
        Index of the update that each came of, (n,).
    time_ns, log_time_ns
        Stamp in the message, and when it was published; (n,).
    mass, center_of_mass
        kg (n,), and m (n, 3) in platform.
    valid
        Whether the newest measurement was used; (n,).
    """

    update: NDArray[np.int64]
    time_ns: Times
    log_time_ns: Times
    mass: Floats
    center_of_mass: Floats
    valid: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Setpoints:
    """Set-points of all m motors: n of them, as messages on ``/setpoint``.

    Attributes
    ----------
    time_ns, log_time_ns
        Stamp in the message, and when the reference that it answers had arrived; (n,).
    position, velocity, effort
        rad, rad/s and N m; (n, m).
    feasible
        Whether the cables can give the wrench; (n,).
    """

    time_ns: Times
    log_time_ns: Times
    position: Floats
    velocity: Floats
    effort: Floats
    feasible: NDArray[np.bool_]


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
    progress: Progress = _silent,
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
    estimator = PayloadEstimator(robot, settings.first, initial)
    begin = updates[first]
    rows: list[tuple[int, int, int, float, Floats, bool]] = []

    def change(time: int, index: int) -> None:
        estimator.settings = settings.changes[index][1]

    def observe_tensions(time: int, index: int) -> None:
        if time <= begin - _PERIOD:  # they took part in an update before the first one known
            return
        stamp = int(tensions.time_ns[index])
        try:
            estimator.observe_tensions((time - begin) * _SECOND, stamp, tensions.effort[index])
        except MeasurementError:  # the node, too, passes over it
            return

    def observe_pose(time: int, index: int) -> None:
        try:
            pose = Pose.from_quaternion(poses.position[index], poses.quaternion_xyzw[index])
        except KinematicsError:
            return
        estimator.observe_pose((time - begin) * _SECOND, int(poses.time_ns[index]), pose)

    def update(time: int, index: int) -> None:
        estimate = estimator.update((time - begin) * _SECOND)
        if estimate.samples > 0:
            payload = estimate.published
            rows.append(
                (first + index, estimate.stamp, time, payload.mass, payload.center_of_mass, estimate.valid)
            )

    changes = [time for time, _ in settings.changes]
    arrivals = (tensions.log_time_ns, poses.log_time_ns)
    handlers = (change, observe_tensions, observe_pose, update)
    for time, handler, index in _in_order(
        progress, changes, *(times.tolist() for times in arrivals), updates[first:]
    ):
        handlers[handler](time, index)
    indices, stamps, times, masses, centers, valid = _columns(rows, 6)
    return EstimatedPayloads(
        np.array(indices, dtype=np.int64),
        np.array(stamps, dtype=np.int64),
        np.array(times, dtype=np.int64),
        np.array(masses, dtype=float),
        np.array(centers, dtype=float).reshape(-1, 3),
        np.array(valid, dtype=bool),
    )


def rerun_feedforward(
    robot: Robot,
    settings: Schedule[FeedforwardSettings],
    references: References,
    payloads: Inertias | EstimatedPayloads | None,
    initial: Payload | None = None,
    progress: Progress = _silent,
) -> Setpoints:
    """Answer recorded references with set-points.

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
    feedforward = Feedforward(robot, settings.first)
    begin = int(references.log_time_ns[0])
    if initial is not None:
        feedforward.set_estimate(0.0, initial.mass, initial.center_of_mass)
    rows: list[tuple[int, int, Floats, Floats, Floats, bool]] = []

    def change(time: int, index: int) -> None:
        feedforward.configure(settings.changes[index][1])

    def take_payload(time: int, index: int) -> None:
        assert payloads is not None  # it gave the times of these calls
        try:
            feedforward.set_estimate(
                (time - begin) * _SECOND, float(payloads.mass[index]), payloads.center_of_mass[index]
            )
        except PayloadError:  # the node, too, keeps the previous one
            return

    def answer(time: int, index: int) -> None:
        vectors = {name: getattr(references, name)[index] for name in VECTORS}
        stamp = int(references.time_ns[index])
        sample = ReferenceSample(stamp, float(references.time_from_start[index]), **vectors)
        try:
            setpoint = feedforward.compute((time - begin) * _SECOND, ReferencePoint.of_sample(sample))
        except KinematicsError:  # the node, too, stays silent
            return
        rows.append((stamp, time, setpoint.position, setpoint.velocity, setpoint.effort, setpoint.feasible))

    changes = [time for time, _ in settings.changes]
    estimates: list[int] = [] if payloads is None else payloads.log_time_ns.tolist()
    handlers = (change, take_payload, answer)
    for time, handler, index in _in_order(progress, changes, estimates, references.log_time_ns.tolist()):
        handlers[handler](time, index)
    stamps, times, positions, velocities, efforts, feasible = _columns(rows, 6)
    m = robot.number_of_cables
    return Setpoints(
        np.array(stamps, dtype=np.int64),
        np.array(times, dtype=np.int64),
        np.array(positions, dtype=float).reshape(-1, m),
        np.array(velocities, dtype=float).reshape(-1, m),
        np.array(efforts, dtype=float).reshape(-1, m),
        np.array(feasible, dtype=bool),
    )


def _in_order(progress: Progress, *streams: Sequence[int]) -> Iterator[tuple[int, int, int]]:
    """Yield time, number of the stream and index in it, in the order of time; at one time, earlier streams first."""
    total = sum(map(len, streams))
    ordered = merge(
        *(
            sorted((time, number, index) for index, time in enumerate(stream))
            for number, stream in enumerate(streams)
        )
    )
    for done, event in enumerate(ordered):
        if done % 1000 == 0:
            progress(done / total)
        yield event
    progress(1.0)


def _columns(rows: list[Any], number: int) -> list[tuple[Any, ...]]:
    return list(zip(*rows, strict=True)) if rows else [()] * number
