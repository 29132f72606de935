"""Static against dynamic model along the paper's trajectories: the tensions that each asks for (figures 8 to 10).

No plant: the feed-forward of the nodes answers the reference, once with each model, every 0.1 s as in the paper.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cspr_control.motors.feedforward import Feedforward, FeedforwardSettings
from cspr_control.reference.paper import paper_18, paper_19, paper_19_tilt
from cspr_control.reference.trajectory import Trajectory
from cspr_kinematics import Payload, Robot
from cspr_msgs_py.vocabulary import FeedforwardModel, PayloadSource

FloatArray = NDArray[np.float64]

SAMPLE_TIME = 0.1  # s
PAYLOAD = 200.0  # kg
ADDED = 100.0  # kg
ADDED_AT = 3.0  # s
SWITCH_18, SWITCH_19 = 10.0, 5.0  # s: until here the platform accelerates


def sample_times(trajectory: Trajectory) -> FloatArray:
    """Return the times of the samples along a trajectory (n,), s."""
    return np.arange(round(trajectory.duration / SAMPLE_TIME) + 1, dtype=np.float64) * SAMPLE_TIME


@dataclass(frozen=True)
class TensionStudy:
    """Tensions of both models along a trajectory; n samples, m cables."""

    name: str
    time: FloatArray  # (n,) s
    payload: FloatArray  # (n,) kg
    dynamic: FloatArray  # (n, m) N
    static: FloatArray  # (n, m) N
    feasible: bool  # whether the cables give both wrenches exactly everywhere

    @property
    def deviation(self) -> FloatArray:
        """Dynamic less static (n, m), N."""
        return self.dynamic - self.static

    def between(self, start: float, end: float) -> TensionStudy:
        """Return the samples from ``start`` up to, and not including, ``end``, s."""
        inside = (self.time >= start - 1e-9) & (self.time < end - 1e-9)
        columns = {name: getattr(self, name)[inside] for name in ("time", "payload", "dynamic", "static")}
        return replace(self, **columns)


def along(
    robot: Robot, trajectory: Trajectory, payload_at: Callable[[float], float], name: str
) -> TensionStudy:
    """Return the tensions of both models; ``payload_at`` gives the payload's mass (kg) at a time (s)."""
    time = sample_times(trajectory)
    payload = np.array([payload_at(t) for t in time])
    tensions, feasible = {}, True
    for model in (FeedforwardModel.DYNAMIC, FeedforwardModel.STATIC):
        settings = {
            mass: FeedforwardSettings(
                model,
                rope_weight=False,  # as in the paper
                payload_source=PayloadSource.NOMINAL,
                nominal_payload=Payload(mass, np.zeros(3)),
            )
            for mass in set(payload.tolist())
        }
        feedforward = Feedforward(robot, settings[payload[0]])
        rows = []
        for t, mass in zip(time.tolist(), payload.tolist(), strict=True):
            feedforward.configure(settings[mass])
            setpoint = feedforward.compute(t, trajectory.sample(t))
            rows.append(setpoint.tensions)
            feasible &= setpoint.feasible
        tensions[model] = np.array(rows)
    return TensionStudy(
        name, time, payload, tensions[FeedforwardModel.DYNAMIC], tensions[FeedforwardModel.STATIC], feasible
    )


def first_simulation(robot: Robot) -> TensionStudy:
    """Return the study of eq. 18, level, 200 kg of payload (figures 8 and 9)."""
    return along(robot, paper_18(robot.trajectory_center), lambda t: PAYLOAD, "(18)")


def level_simulation(robot: Robot) -> TensionStudy:
    """Return the study of eq. 19, level, 200 kg of payload: the second one without its rotation."""
    return along(robot, paper_19(robot.trajectory_center), lambda t: PAYLOAD, "(19), level")


def second_simulation(robot: Robot) -> TensionStudy:
    """Return the study of eq. 19 with 5 degrees about x and y, 200 kg of payload (figure 9)."""
    return along(robot, paper_19_tilt(robot.trajectory_center), lambda t: PAYLOAD, "(19), 5° about x and y")


def third_simulation(robot: Robot) -> TensionStudy:
    """Return the first part of the second simulation with 100 kg more from 3 s on (figure 10)."""
    return along(
        robot,
        paper_19_tilt(robot.trajectory_center),
        lambda t: PAYLOAD + (ADDED if t >= ADDED_AT - 1e-9 else 0.0),
        "(19), 5°, +100 kg at 3 s",
    ).between(0.0, SWITCH_19 + SAMPLE_TIME)
