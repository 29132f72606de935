"""What can be held and accelerated, against linear programming over tensions and payload."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from scipy.optimize import linprog

from cspr_kinematics import (
    Acceleration,
    InvalidInputError,
    Payload,
    Pose,
    Robot,
    Task,
    Twist,
    assess_task,
    available_wrenches,
    inverse_kinematics,
    required_wrench,
    rope_wrench,
    static_wrench,
)

CENTER = [0.05, -0.02, -0.1]


@pytest.fixture(params=["robot", "cogiro"])
def machine(request: pytest.FixtureRequest) -> Robot:
    return request.getfixturevalue(request.param)


def poses(robot: Robot, count: int) -> Pose:
    rng = np.random.default_rng(1)
    position = rng.uniform(robot.workspace_min, robot.workspace_max, (count, 3))
    return Pose.from_euler(position, *rng.uniform(-0.15, 0.15, (3, count)))


def extreme(robot: Robot, A: np.ndarray, w: np.ndarray, slope: np.ndarray, sign: float) -> float:
    """Largest (sign 1) or smallest x with A t = w + x slope for feasible t, NaN if there is none."""
    m = A.shape[1]
    answer = linprog(
        np.append(np.zeros(m), -sign),
        A_eq=np.column_stack((A, -slope)),
        b_eq=w,
        bounds=[*zip(robot.tension_min, robot.tension_max, strict=True), (None, None)],
    )
    return float(answer.x[-1]) if answer.status == 0 else math.nan


def test_payload_limits_at_rest(machine: Robot) -> None:
    pose = poses(machine, 20)
    result = assess_task(machine, pose, Task(center_of_mass=CENTER))
    for k in range(20):
        one = Pose(pose.position[k], pose.rotation[k])
        cables = inverse_kinematics(machine, one)
        A, w = cables.wrench_matrix, static_wrench(machine, one)
        per_kg = static_wrench(machine, one, Payload(1.0, CENTER)) - w
        w = w + rope_wrench(machine, cables)
        largest, smallest = (extreme(machine, A, w, per_kg, sign) for sign in (1.0, -1.0))
        if math.isnan(largest) or largest < 0.0:
            assert np.isnan(result.payload_max[k])
            assert np.isnan(result.payload_min[k])
        else:
            assert result.payload_max[k] == pytest.approx(largest, rel=1e-6, abs=1e-6)
            assert result.payload_min[k] == pytest.approx(max(0.0, smallest), rel=1e-6, abs=1e-6)
    assert np.isfinite(result.payload_max).any()


def test_a_light_platform_needs_a_payload(robot: Robot) -> None:
    """Cables at a high lower limit would lift the empty platform."""
    pose = robot.home
    stiff = dataclasses.replace(robot, tension_min=400.0)
    result = assess_task(stiff, pose)
    assert result.margin < 0.0
    assert 0.0 < result.payload_min < result.payload_max
    assert assess_task(stiff, pose, Task(result.payload_min + 1e-6, result.payload_max - 1e-6)).feasible


def test_margin_is_the_worst_of_all_corners_of_the_task(machine: Robot) -> None:
    task = Task(10.0, 80.0, CENTER, [1.0, 0.5, 0.8], [0.2, 0.0, 0.3])
    pose = poses(machine, 4)
    result = assess_task(machine, pose, task, lever=0.5)
    lowest, metric = np.full(4, np.inf), np.repeat([1.0, 0.5], 3)
    for k in range(4):
        one = Pose(pose.position[k], pose.rotation[k])
        cables = inverse_kinematics(machine, one)
        A = cables.wrench_matrix / metric[:, None]
        reach = available_wrenches(A, machine.tension_min, machine.tension_max)
        for mass, *signs in itertools.product((10.0, 80.0), *[(-1.0, 1.0)] * 6):
            acceleration = Acceleration(
                signs[:3] * task.linear_acceleration, signs[3:] * task.angular_acceleration
            )
            w = required_wrench(machine, one, Twist.zero(), acceleration, Payload(mass, CENTER))
            w = w + rope_wrench(machine, cables)
            lowest[k] = min(lowest[k], reach.margin(w / metric))
    np.testing.assert_allclose(result.margin, lowest, atol=1e-7)
    np.testing.assert_array_equal(result.feasible, lowest >= 0.0)


def test_payloads_of_an_accelerated_task_are_the_border_of_its_margin(machine: Robot) -> None:
    box = ([0.6, 0.5, 0.8], [0.2, 0.1, 0.3])
    pose = Pose(0.5 * (machine.workspace_min + machine.workspace_max), np.eye(3))
    largest = float(assess_task(machine, pose, Task(0.0, 0.0, CENTER, *box)).payload_max)
    assert largest > 0.0
    for mass, possible in ((0.9999 * largest, True), (1.0001 * largest, False)):
        assert assess_task(machine, pose, Task(mass, mass, CENTER, *box)).feasible == possible
    assert largest < assess_task(machine, pose, Task(center_of_mass=CENTER)).payload_max


def test_batches(robot: Robot) -> None:
    pose = poses(robot, 12)
    task = Task(0.0, 100.0, linear_acceleration=[1.0, 1.0, 1.0])
    one = assess_task(robot, pose, task)
    folded = Pose(pose.position.reshape(3, 4, 3), pose.rotation.reshape(3, 4, 3, 3))
    np.testing.assert_array_equal(assess_task(robot, folded, task).margin.ravel(), one.margin)
    single = assess_task(robot, Pose(pose.position[5], pose.rotation[5]), task)
    assert single.margin.shape == ()
    assert single.margin == one.margin[5]


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ({"payload_min": -1.0}, "payload_min"),
        ({"payload_max": -1.0}, "payload_max"),
        ({"payload_min": 2.0, "payload_max": 1.0}, "payload_min"),
        ({"payload_max": np.nan}, "payload_max"),
        ({"center_of_mass": [0.0, 0.0]}, "center_of_mass"),
        ({"center_of_mass": np.zeros((2, 3))}, "center_of_mass"),
        ({"linear_acceleration": [-1.0, 0.0, 0.0]}, "linear_acceleration"),
        ({"angular_acceleration": [np.inf, 0.0, 0.0]}, "angular_acceleration"),
    ],
)
def test_task_is_checked(arguments: dict[str, object], name: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        Task(**arguments)
    assert caught.value.name == name


def test_input_is_checked(robot: Robot) -> None:
    with pytest.raises(InvalidInputError, match="lever"):
        assess_task(robot, robot.home, lever=-1.0)
