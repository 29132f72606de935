from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspr_kinematics import (
    InvalidInputError,
    KinematicsError,
    Pose,
    Robot,
    Winch,
    distribute_tensions,
    inverse_kinematics,
    static_wrench,
)

STEP = 1e-5


def with_cables(robot: Robot, order: list[int]) -> Robot:
    """The same robot with only the cables of `order`, in that order."""
    winch = Winch(robot.winch.drum_radius, robot.winch.gear_ratio, robot.winch.home_lengths[order])
    return dataclasses.replace(
        robot, exit_points=robot.exit_points[order], anchor_points=robot.anchor_points[order], winch=winch
    )


def test_cable_one_at_home_by_hand(robot: Robot) -> None:
    cables = inverse_kinematics(robot, robot.home)
    vector = np.array([-2.4 - 0.1325, -1.5 + 0.1175, 3.0 - 1.0 + 0.11])
    assert cables.lengths[0] == pytest.approx(np.linalg.norm(vector))
    np.testing.assert_allclose(cables.directions[0], vector / np.linalg.norm(vector))
    np.testing.assert_allclose(cables.arms[0], [0.1325, -0.1175, -0.11])
    np.testing.assert_allclose(
        cables.wrench_matrix[:, 0],
        np.concatenate((cables.directions[0], np.cross(cables.arms[0], cables.directions[0]))),
    )


def test_cables_span_anchor_to_exit(robot: Robot, random_pose: Callable[..., Pose]) -> None:
    pose = random_pose(50)
    cables = inverse_kinematics(robot, pose)
    ends = pose.position[:, None] + cables.arms + cables.lengths[..., None] * cables.directions
    np.testing.assert_allclose(ends, np.broadcast_to(robot.exit_points, ends.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(cables.directions, axis=-1), 1.0)


def test_jacobian_by_finite_differences_of_the_lengths(
    robot: Robot, random_pose: Callable[..., Pose]
) -> None:
    pose = random_pose(30, tilt=1.0)
    differences = np.empty((30, 8, 6))
    for axis in range(6):
        change = np.zeros(6)
        change[axis] = STEP
        ahead, behind = (
            Pose(
                pose.position + s * change[:3],
                Rotation.from_rotvec(s * change[3:]).as_matrix() @ pose.rotation,
            )
            for s in (1.0, -1.0)
        )
        lengths_ahead = inverse_kinematics(robot, ahead).lengths
        differences[..., axis] = (lengths_ahead - inverse_kinematics(robot, behind).lengths) / (2.0 * STEP)
    np.testing.assert_allclose(inverse_kinematics(robot, pose).jacobian, differences, atol=1e-9)


@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys", "cogiro", "six_cables", "twelve_cables"])
@given(seed=st.integers(0, 2**32 - 1))
def test_virtual_work(robots: Callable[[str], Robot], name: str, seed: int) -> None:
    """Work of the cables' wrench on a small displacement equals what their shortening yields."""
    robot, rng, n = robots(name), np.random.default_rng(seed), 20
    pose = Pose.from_euler(
        rng.uniform(robot.workspace_min, robot.workspace_max, (n, 3)), *rng.uniform(-0.3, 0.3, (3, n))
    )
    tensions = rng.uniform(50.0, 3000.0, (n, robot.number_of_cables))
    half = 1e-5 * rng.normal(size=(n, 6))
    behind, ahead = (
        Pose(
            pose.position + s * half[:, :3], Rotation.from_rotvec(s * half[:, 3:]).as_matrix() @ pose.rotation
        )
        for s in (-1.0, 1.0)
    )
    shortening = inverse_kinematics(robot, behind).lengths - inverse_kinematics(robot, ahead).lengths
    wrench = (inverse_kinematics(robot, pose).wrench_matrix @ tensions[..., None])[..., 0]
    work = 2.0 * np.einsum("ni,ni->n", wrench, half)
    np.testing.assert_allclose(np.einsum("ni,ni->n", tensions, shortening), work, rtol=1e-6, atol=1e-6)


def test_batches_equal_loops(robot: Robot, random_pose: Callable[..., Pose]) -> None:
    poses = random_pose(3, 4)
    batch = inverse_kinematics(robot, poses)
    for index in np.ndindex(3, 4):
        single = inverse_kinematics(robot, Pose(poses.position[index], poses.rotation[index]))
        for field in dataclasses.fields(single):
            np.testing.assert_allclose(
                getattr(batch, field.name)[index], getattr(single, field.name), atol=1e-14
            )


def test_an_empty_batch_gives_empty_results(robot: Robot) -> None:
    cables = inverse_kinematics(robot, Pose(np.zeros((0, 3)), np.zeros((0, 3, 3))))
    assert cables.jacobian.shape == (0, 8, 6)


def test_relabelling_the_cables_relabels_the_results(robot: Robot, random_pose: Callable[..., Pose]) -> None:
    order = [3, 0, 7, 1, 6, 2, 5, 4]
    pose = random_pose(5)
    cables, permuted = (inverse_kinematics(r, pose) for r in (robot, with_cables(robot, order)))
    np.testing.assert_allclose(permuted.lengths, cables.lengths[:, order])
    np.testing.assert_allclose(permuted.jacobian, cables.jacobian[:, order])
    w = static_wrench(robot, pose)
    plain, other = (distribute_tensions(c.wrench_matrix, w, 50.0, 3000.0) for c in (cables, permuted))
    np.testing.assert_allclose(other.tensions, plain.tensions[:, order])


@pytest.mark.parametrize("count", [6, 7])
def test_fewer_cables(robot: Robot, count: int) -> None:
    cables = inverse_kinematics(with_cables(robot, list(range(count))), robot.home)
    assert cables.wrench_matrix.shape == (6, count)


def test_an_anchor_on_its_exit_point_is_refused(robot: Robot) -> None:
    touching = Pose(robot.exit_points[2] - robot.anchor_points[2], np.eye(3))
    with pytest.raises(InvalidInputError, match="coincides"):
        inverse_kinematics(robot, touching)
    assert issubclass(InvalidInputError, KinematicsError)


def test_results_cannot_be_written(robot: Robot) -> None:
    cables = inverse_kinematics(robot, robot.home)
    for field in dataclasses.fields(cables):
        with pytest.raises(ValueError, match="read-only"):
            getattr(cables, field.name)[0] = 0.0


def test_the_wrench_matrix_is_the_negative_transpose(any_robot: Robot) -> None:
    cables = inverse_kinematics(any_robot, any_robot.home)
    np.testing.assert_array_equal(cables.jacobian, -cables.wrench_matrix.T)
