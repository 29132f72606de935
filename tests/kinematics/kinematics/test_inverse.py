from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspr_kinematics import (
    Acceleration,
    CableProperties,
    CableReachError,
    InvalidInputError,
    KinematicsError,
    Pose,
    Robot,
    Twist,
    Winch,
    cable_lengths,
    distribute_tensions,
    inverse_kinematics,
    length_accelerations,
    motion_from_euler,
    static_wrench,
)

STEP = 1e-5


def with_cables(robot: Robot, order: list[int]) -> Robot:
    """The same robot with only the cables of `order`, in that order."""
    winch = Winch(robot.winch.drum_radius, robot.winch.gear_ratio, robot.winch.home_lengths[order])
    return dataclasses.replace(
        robot,
        exit_points=robot.exit_points[order],
        anchor_points=robot.anchor_points[order],
        winch=winch,
        tension_min=robot.tension_min[order],
        tension_max=robot.tension_max[order],
        cables=CableProperties(),
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


SECOND_DIFFERENCE = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])


@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys", "cogiro", "six_cables", "twelve_cables"])
@given(seed=st.integers(0, 2**32 - 1))
def test_accelerations_are_second_differences_of_the_lengths(
    robots: Callable[[str], Robot], name: str, seed: int
) -> None:
    """Along smooth motions through random poses, to eighth order in the step."""
    robot, rng, step = robots(name), np.random.default_rng(seed), 0.01
    time = step * np.arange(-4.0, 5.0)[:, None]
    speed, swing, phase = rng.uniform(-0.5, 0.5, (3, 6))
    center = np.concatenate(
        (rng.uniform(robot.workspace_min, robot.workspace_max), rng.uniform(-0.3, 0.3, 3))
    )
    angle = 2.0 * time + 6.0 * phase
    x = center + speed * time + swing * (np.sin(angle) - np.sin(6.0 * phase))  # up to 1.5 m/s and 2 m/s^2
    v, a = speed + 2.0 * swing * np.cos(angle), -4.0 * swing * np.sin(angle)
    motion = motion_from_euler(*(each[:, :3] for each in (x, v, a)), *(each[:, 3:] for each in (x, v, a)))
    differences = SECOND_DIFFERENCE @ cable_lengths(robot, motion.pose) / step**2
    computed = length_accelerations(robot, *motion)
    np.testing.assert_allclose(computed[4], differences, rtol=1e-9, atol=1e-9)
    assert np.abs(differences).max() > 0.01


def test_a_pulley_swivels_under_a_cable_that_goes_around_it(robot_with_pulleys: Robot) -> None:
    """Around the swivel axis at a constant speed no length changes, whatever the curvature of the path."""
    robot, speed = robot_with_pulleys, 0.7
    radius = robot.home.position + robot.anchor_points[2] - robot.exit_points[2]
    spin = np.array([0.0, 0.0, speed])
    velocity = np.cross(spin, radius)
    around = Twist(velocity, np.zeros(3)), Acceleration(np.cross(spin, velocity), np.zeros(3))
    assert length_accelerations(robot, robot.home, *around)[2] == pytest.approx(0.0, abs=1e-14)


def test_accelerations_of_batches_that_broadcast(
    robot_with_pulleys: Robot, random_pose: Callable[..., Pose]
) -> None:
    robot, pose, rng = robot_with_pulleys, random_pose(4), np.random.default_rng(3)
    twist, acceleration = Twist(*rng.normal(size=(2, 3, 1, 3))), Acceleration(*rng.normal(size=(2, 3)))
    every = length_accelerations(robot, pose, twist, acceleration)
    assert every.shape == (3, 4, 8)
    one = Pose(pose.position[2], pose.rotation[2])
    same = length_accelerations(robot, one, Twist(twist.linear[1, 0], twist.angular[1, 0]), acceleration)
    np.testing.assert_array_equal(every[1, 2], same)
    still = length_accelerations(robot, pose, Twist.zero(), acceleration)
    np.testing.assert_allclose(
        still, inverse_kinematics(robot, pose).jacobian @ acceleration.vector, atol=1e-13
    )
    with pytest.raises(InvalidInputError, match="do not broadcast"):
        length_accelerations(robot, pose, Twist(np.zeros((3, 3)), np.zeros(3)), acceleration)
    inside = Pose(np.stack((robot.home.position, robot.exit_points[1] - robot.anchor_points[1])), np.eye(3))
    with pytest.raises(CableReachError, match="cable 2: ") as caught:
        length_accelerations(robot, inside, Twist(np.zeros((3, 1, 3)), np.zeros(3)), acceleration)
    assert caught.value.index == (0, 1)


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
