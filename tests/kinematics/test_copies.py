"""What crosses a process or is copied: arrays stay read-only, kernels compiled, errors with their data."""

from __future__ import annotations

import copy
import dataclasses
import pickle
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np
import pytest

from cspr_kinematics import (
    Acceleration,
    CableReachError,
    ConfigurationFileError,
    ForwardKinematicsError,
    InvalidInputError,
    KinematicsError,
    Payload,
    Pose,
    Robot,
    SingularWrenchMatrixError,
    Task,
    Twist,
    available_wrenches,
    cable_interference,
    cable_lengths,
    distribute_tensions,
    forward_kinematics,
    holding_tensions,
    inverse_kinematics,
    length_accelerations,
    required_wrench,
    solve_forward_kinematics,
)
from cspr_kinematics.dynamics._dynamics import required_wrenches
from cspr_kinematics.kinematics._forward import forward_at_poses
from cspr_kinematics.robot._cable_paths import cables_at_poses
from cspr_kinematics.tensions._batch import distribute_batch

KERNELS: tuple[Any, ...] = (cables_at_poses, required_wrenches, distribute_batch, forward_at_poses)
WAYS: dict[str, Callable[[Any], Any]] = {
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),
    "deepcopy": copy.deepcopy,
}


def arrays_of(value: object) -> list[np.ndarray]:
    """All arrays of an immutable object, those of its parts included."""
    if isinstance(value, np.ndarray):
        return [value]
    found: list[np.ndarray] = []
    if dataclasses.is_dataclass(value):
        for part in vars(value).values():
            found += arrays_of(part)
    return found


def feedforward(
    robot: Robot, pose: Pose, twist: Twist, acceleration: Acceleration, payload: Payload
) -> np.ndarray:
    """Tensions (m,) for a motion."""
    A, w = (
        inverse_kinematics(robot, pose).wrench_matrix,
        required_wrench(robot, pose, twist, acceleration, payload),
    )
    return distribute_tensions(A, w, robot.tension_min, robot.tension_max, "closest").tensions


@pytest.mark.parametrize("way", WAYS)
def test_copies_are_immutable_and_compile_nothing(robot_with_pulleys: Robot, way: str) -> None:
    robot, home, payload = robot_with_pulleys, robot_with_pulleys.home, Payload(50.0, [0.1, 0.0, 0.0])
    motion = home, Twist([0.1, 0.0, 0.0], [0.0, 0.1, 0.0]), Acceleration([0.0, 0.1, 0.0], [0.1, 0.0, 0.0])
    lengths = cable_lengths(robot, home)
    expected = feedforward(robot, *motion, payload)
    A = inverse_kinematics(robot, home).wrench_matrix
    forward_kinematics(robot, lengths, home)
    signatures = [list(kernel.signatures) for kernel in KERNELS]
    everything = (
        *(robot, payload, *motion, inverse_kinematics(robot, home), solve_forward_kinematics(robot, lengths)),
        *(Task(0.0, 1.0), available_wrenches(A, 50.0, 3000.0), cable_interference(robot, home)),
        robot.cables,
    )
    copies = [WAYS[way](value) for value in everything]
    for value in copies:
        assert arrays_of(value)
        assert not any(array.flags.writeable for array in arrays_of(value)), type(value)
    other, load, *moved = copies[:5]
    np.testing.assert_array_equal(feedforward(other, *moved, load), expected)
    np.testing.assert_array_equal(forward_kinematics(other, lengths, moved[0]).position, home.position)
    held, expected = holding_tensions(other, moved[0], load), holding_tensions(robot, home, payload)
    np.testing.assert_array_equal(held.tensions, expected.tensions)
    np.testing.assert_array_equal(other.motor_angles(lengths), robot.motor_angles(lengths))
    np.testing.assert_array_equal(length_accelerations(other, *moved), length_accelerations(robot, *motion))
    assert [list(kernel.signatures) for kernel in KERNELS] == signatures


@pytest.mark.parametrize(
    "error",
    [
        InvalidInputError("payload mass", -1.0, "must not be negative"),
        ConfigurationFileError("robot.yaml", "winch.drum_radius", 0, "must be positive"),
        CableReachError("no length", 3, np.zeros(3), np.eye(3), (1, 2)),
        SingularWrenchMatrixError("flat", np.zeros((6, 8)), np.zeros(6), (4,)),
        ForwardKinematicsError("no pose", np.ones(8), 7, np.array(False)),
    ],
)
@pytest.mark.parametrize("way", WAYS)
def test_errors_keep_message_and_data(error: KinematicsError, way: str) -> None:
    other = WAYS[way](error)
    assert type(other) is type(error)
    assert str(other) == str(error)
    assert vars(other).keys() == vars(error).keys()
    for name, value in vars(error).items():
        np.testing.assert_array_equal(vars(other)[name], value)


def _lengths(robot: Robot, pose: Pose) -> np.ndarray:
    return inverse_kinematics(robot, pose).lengths


def test_an_error_in_another_process_comes_back(robot: Robot) -> None:
    touching = Pose(robot.exit_points[2] - robot.anchor_points[2], np.eye(3))
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        np.testing.assert_array_equal(
            pool.submit(_lengths, robot, robot.home).result(), robot.winch.home_lengths
        )
        with pytest.raises(CableReachError, match="cable 3") as caught:
            pool.submit(_lengths, robot, touching).result()
    assert caught.value.cable == 3
