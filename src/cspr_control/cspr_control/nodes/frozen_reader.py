"""A reader of the graph stands still: what the controllers notice of it, in a graph of real processes."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cspr_control.demo.scenario import Scenario
from cspr_control.nodes.demo_operator import DemoClient
from cspr_control.nodes.live_graph import LiveGraph, passing_graph
from cspr_msgs_py import topics
from cspr_msgs_py.message_definitions import message_class
from cspr_msgs_py.qos import qos_profile
from cspr_msgs_py.runtime.process import subscribe_samples
from cspr_msgs_py.vocabulary import RobotState, TrajectoryName
from cspr_msgs_py.wire.message_values import nanoseconds
from cspr_msgs_py.wire.samples import PoseSample

_PAYLOAD = 200.0  # kg
_FROZEN = 2.0  # s for which the reader stands still
_BETWEEN = 2.0  # s for which it runs again
_QUEUED = 2000  # commands that wait for a watcher that is held up itself


@dataclass(frozen=True)
class Freeze:
    """What the robot did while a reader stood still.

    Attributes
    ----------
    moving
        Whether it followed a trajectory.
    pause, pause_before
        Longest time between two torque commands, s, and in as long a time before that.
    cause
        Why it stopped; empty if it did not.
    drop, moved
        Height lost and movement of a robot that held still, m; not-a-number of one that moved.
    lowest_tension, highest_tension
        Of all cables, N.
    """

    moving: bool
    pause: float
    pause_before: float
    cause: str
    drop: float
    moved: float
    lowest_tension: float
    highest_tension: float


class _Watcher:
    """Hears commands, tensions and the true pose; times between commands are those of the cycles that they answer."""

    def __init__(self, client: DemoClient) -> None:
        self._last = 0
        self.forget()
        commands = replace(topics.motor_command(1), depth=_QUEUED)
        for topic, take in ((commands, self._on_command), (topics.CABLE_TENSIONS, self._on_tensions)):
            client.create_subscription(message_class(topic.type), topic.name, take, qos_profile(topic))
        subscribe_samples(client, topics.TRUE_POSE, self._on_pose)

    def forget(self) -> None:
        """Begin anew."""
        self.pause = 0.0
        self.tensions: list[float] = []
        self.places: list[np.ndarray] = []

    def _on_command(self, message: Any) -> None:
        stamp = nanoseconds(message.header.stamp)
        if self._last:
            self.pause = max(self.pause, (stamp - self._last) * 1e-9)
        self._last = stamp

    def _on_tensions(self, message: Any) -> None:
        self.tensions.extend(message.effort)

    def _on_pose(self, pose: PoseSample) -> None:
        self.places.append(np.array(pose.position))


def freezes(source: Path, times: int) -> Iterator[Freeze]:
    """Start a graph like that of the demo, let its recorder stand still again and again, and yield what came of it.

    First the robot holds 200 kg, then it moves them.

    Parameters
    ----------
    source
        Directory of the configuration.
    times
        How often, in all.

    Raises
    ------
    ControlError
        If a process ends, or the robot cannot be enabled.
    """
    scenario = Scenario(trajectory=TrajectoryName.SMOOTH_19, payload=_PAYLOAD, added=())
    with passing_graph("reader_frozen", scenario, source) as graph:
        watcher = _Watcher(graph.client)
        for index in range(times):
            moving = index >= times // 2
            graph.make_ready(moving)
            freeze = _freeze(graph, watcher, moving)
            graph.progress.end()
            yield freeze


def _freeze(graph: LiveGraph, watcher: _Watcher, moving: bool) -> Freeze:
    client = graph.client
    watcher.forget()
    graph.operator.pause("reader runs", _BETWEEN)
    before = watcher.pause
    watcher.forget()
    end = time.monotonic() + _FROZEN
    with graph.children.frozen("recorder"):
        while time.monotonic() < end and client.robot_state != RobotState.FAULT:
            time.sleep(0.01)
    places = np.array(watcher.places[:]) - watcher.places[0]
    tensions = watcher.tensions[:]
    return Freeze(
        moving,
        watcher.pause,
        before,
        client.robot_message if client.robot_state == RobotState.FAULT else "",
        math.nan if moving else -float(places[:, 2].min()),
        math.nan if moving else float(np.linalg.norm(places, axis=1).max()),
        min(tensions),
        max(tensions),
    )
