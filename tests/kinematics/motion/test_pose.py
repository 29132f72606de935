from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cspr_kinematics import Acceleration, InvalidInputError, Pose, Twist

ORIGIN = np.zeros(3)


def test_euler_matches_the_product_of_equation_4(rng: np.random.Generator) -> None:
    alpha, beta, gamma = rng.uniform(-1.5, 1.5, (3, 4, 5))
    product = (
        Rotation.from_euler("z", alpha.reshape(-1, 1))
        * Rotation.from_euler("y", beta.reshape(-1, 1))
        * Rotation.from_euler("x", gamma.reshape(-1, 1))
    )
    pose = Pose.from_euler(ORIGIN, alpha, beta, gamma)
    assert pose.batch_shape == (4, 5)
    np.testing.assert_allclose(pose.rotation, product.as_matrix().reshape(4, 5, 3, 3), atol=1e-14)
    np.testing.assert_allclose(pose.euler, np.stack([alpha, beta, gamma], -1), atol=1e-12)


def test_rotation_maps_platform_to_base() -> None:
    quarter_turn_about_z = Pose.from_euler(ORIGIN, np.pi / 2, 0.0, 0.0)
    np.testing.assert_allclose(quarter_turn_about_z.rotation @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


def test_quaternion_round_trip(rng: np.random.Generator) -> None:
    quaternion = rng.normal(size=(6, 2, 4))
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    pose = Pose.from_quaternion(np.ones(3), quaternion)
    expected = np.where(quaternion[..., 3:] < 0.0, -quaternion, quaternion)
    assert pose.quaternion.shape == (6, 2, 4)
    np.testing.assert_allclose(pose.quaternion, expected, atol=1e-12)


def test_quaternion_is_in_the_order_of_ros() -> None:
    pose = Pose.from_euler(ORIGIN, 0.0, 0.0, 0.4)
    np.testing.assert_allclose(pose.quaternion, [np.sin(0.2), 0.0, 0.0, np.cos(0.2)], atol=1e-15)


@pytest.mark.parametrize(
    ("position", "rotation", "name"),
    [
        ([0.0, np.nan, 0.0], np.eye(3), "position"),
        ([0.0, 0.0], np.eye(3), "position"),
        (["a", "b", "c"], np.eye(3), "position"),
        (ORIGIN, np.full((3, 3), np.inf), "rotation"),
        (ORIGIN, np.eye(2), "rotation"),
        (ORIGIN, 1.001 * np.eye(3), "rotation"),
        (ORIGIN, np.diag([1.0, 1.0, -1.0]), "rotation"),
        (np.zeros((2, 3)), np.broadcast_to(np.eye(3), (3, 3, 3)), "batch axes"),
    ],
)
def test_what_is_no_pose_is_refused(position: object, rotation: object, name: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        Pose(position, rotation)
    assert caught.value.name == name
    assert caught.value.value is not None


@pytest.mark.parametrize("quaternion", [np.zeros(4), [0.0, 0.0, 0.0, 2.0], [np.nan] * 4, [0.0, 0.0, 1.0]])
def test_what_is_no_quaternion_is_refused(quaternion: object) -> None:
    with pytest.raises(InvalidInputError, match="quaternion_xyzw"):
        Pose.from_quaternion(ORIGIN, quaternion)


@pytest.mark.parametrize("vector", [Twist, Acceleration])
def test_what_is_no_twist_is_refused(vector: type) -> None:
    with pytest.raises(InvalidInputError, match="linear"):
        vector([0.0, np.inf, 0.0], ORIGIN)
    with pytest.raises(InvalidInputError, match="angular"):
        vector(ORIGIN, [0.0, 1.0])
    assert vector.zero().batch_shape == ()


def test_axes_of_the_batch_broadcast() -> None:
    pose = Pose(np.zeros((4, 3)), np.eye(3))
    assert pose.rotation.shape == (4, 3, 3)
    twist = Twist(ORIGIN, np.ones((2, 3)))
    assert twist.linear.shape == (2, 3)


def test_a_twist_is_one_vector_too() -> None:
    twist = Twist([[1.0, 2.0, 3.0]], [4.0, 5.0, 6.0])
    np.testing.assert_array_equal(twist.vector, [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]])
    np.testing.assert_array_equal(twist.linear, [[1.0, 2.0, 3.0]])
    np.testing.assert_array_equal(twist.angular, [[4.0, 5.0, 6.0]])


def test_arrays_are_copies_that_cannot_be_written() -> None:
    position = np.zeros(3)
    pose = Pose(position, np.eye(3))
    position[0] = 1.0
    assert pose.position[0] == 0.0
    for array in (pose.position, pose.rotation, Twist.zero().linear):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_an_error_is_one_line() -> None:
    with pytest.raises(InvalidInputError) as caught:
        Pose(ORIGIN, np.diag([1.0, 1.0, -1.0]))
    assert "\n" not in str(caught.value)


def test_a_read_only_quaternion_will_do() -> None:
    quaternion = np.array([0.0, 0.0, 0.0, 1.0])
    quaternion.setflags(write=False)
    np.testing.assert_array_equal(Pose.from_quaternion(ORIGIN, quaternion).rotation, np.eye(3))
