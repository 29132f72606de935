"""Predicted tensions against the functions that the feed-forward node calls, one reference at a time."""

from __future__ import annotations

import numpy as np
import pytest

from cspr_control.analysis.numbers.predicted_tensions import predict_tensions
from cspr_control.motors.feedforward import Feedforward, FeedforwardSettings
from cspr_control.reference.paper import paper_19_tilt
from cspr_kinematics import Robot
from cspr_msgs_py.bag.columns import Inertias, References
from cspr_msgs_py.vocabulary import FeedforwardModel, PayloadSource

START = 1_790_000_000_000_000_000


@pytest.mark.parametrize("model", [FeedforwardModel.DYNAMIC, FeedforwardModel.STATIC])
def test_same_as_the_feedforward_sample_by_sample(robot: Robot, model: FeedforwardModel) -> None:
    trajectory = paper_19_tilt(robot.trajectory_center)
    times = np.arange(0.0, 10.0, 0.25)
    points = [trajectory.sample(float(t)) for t in times]
    stamps = START + np.rint(times * 1e9).astype(np.int64)
    references = References(
        START, stamps, stamps, times,
        np.array([p.pose.position for p in points]),
        np.array([p.pose.quaternion for p in points]),
        np.array([p.twist.linear for p in points]),
        np.array([p.twist.angular for p in points]),
        np.array([p.acceleration.linear for p in points]),
        np.array([p.acceleration.angular for p in points]),
    )  # fmt: skip
    mass, center = np.array([100.0, 200.0]), np.array([[0.0, 0.0, 0.0], [0.02, -0.03, -0.2]])
    changes = np.array([START - 10**9, START + 3 * 10**9])
    predicted = predict_tensions(robot, references, Inertias(START, changes, changes, mass, center))
    settings = FeedforwardSettings(
        model=model, payload_source=PayloadSource.ESTIMATED, payload_timeout=100.0, switch_slew=1e9
    )
    feedforward = Feedforward(robot, settings)
    tensions = predicted.dynamic if model is FeedforwardModel.DYNAMIC else predicted.static
    for k, point in enumerate(points):
        carried = int(times[k] >= 3.0)
        feedforward.set_estimate(float(times[k]), float(mass[carried]), center[carried])
        np.testing.assert_allclose(
            tensions[k], feedforward.compute(float(times[k]), point).tensions, rtol=1e-9
        )


def test_between_two_references_it_is_linear(robot: Robot) -> None:
    stamps = START + np.array([0, 10_000_000])
    zero = np.zeros((2, 3))
    level = np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))
    position = np.array([[0.0, 0.0, 1.0], [0.1, 0.0, 1.0]])
    references = References(START, stamps, stamps, stamps * 1e-9, position, level, zero, zero, zero, zero)
    predicted = predict_tensions(robot, references, None)
    middle = predicted.dynamic_at(np.array([START + 5_000_000]))
    np.testing.assert_allclose(middle[0], predicted.dynamic.mean(axis=0))
    np.testing.assert_allclose(predicted.dynamic, predicted.static)
