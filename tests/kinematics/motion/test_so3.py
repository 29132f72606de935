from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from cspr_kinematics import Pose
from cspr_kinematics.motion._rotation import turn
from cspr_kinematics.motion.so3 import cross, rotation_from_euler

vectors = arrays(np.float64, 3, elements=st.floats(-10.0, 10.0))


@given(vectors, vectors)
def test_cross_is_the_cross_product(a: np.ndarray, b: np.ndarray) -> None:
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=1e-12)


def by_vector(v: np.ndarray) -> np.ndarray:
    rotation = np.empty((3, 3))
    turn(*v, np.eye(3), rotation)
    return rotation


@given(vectors)
def test_turning_by_a_vector_is_the_exponential(vector: np.ndarray) -> None:
    np.testing.assert_allclose(by_vector(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-13)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 1e-9, 1e-6, np.pi])
def test_turning_by_special_angles(angle: float) -> None:
    vector = angle * np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(
        by_vector(vector), Rotation.from_rotvec(vector).as_matrix(), rtol=0.0, atol=1e-15
    )


def by_euler(v: np.ndarray) -> np.ndarray:
    return Pose.from_euler(np.zeros(3), *v).rotation


def by_quaternion(v: np.ndarray) -> np.ndarray:
    q = np.append(v, 1.0)
    return Pose.from_quaternion(np.zeros(3), q / np.linalg.norm(q)).rotation


@pytest.mark.parametrize("rotation", [by_vector, by_euler, by_quaternion])
@given(vectors, vectors, vectors)
def test_axioms_of_rotations(
    rotation: Callable[[np.ndarray], np.ndarray], v: np.ndarray, a: np.ndarray, b: np.ndarray
) -> None:
    """Lengths, angles and handedness stay; the transpose takes back; two in a row are one."""
    Q, R = rotation(v), rotation(a)
    np.testing.assert_allclose(Q @ Q.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(Q.T @ Q, np.eye(3), atol=1e-14)
    assert np.linalg.det(Q) == pytest.approx(1.0, abs=1e-13)
    np.testing.assert_allclose((Q @ a) @ (Q @ b), a @ b, atol=1e-11)
    np.testing.assert_allclose(cross(Q @ a, Q @ b), Q @ cross(a, b), atol=1e-11)
    np.testing.assert_allclose(Q @ R @ b, Q @ (R @ b), atol=1e-12)
    Pose(np.zeros(3), Q @ R)  # which refuses what is no rotation


@given(vectors, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))
def test_rotations_about_one_axis_add_up(v: np.ndarray, s: float, t: float) -> None:
    np.testing.assert_allclose(by_vector(s * v) @ by_vector(t * v), by_vector((s + t) * v), atol=1e-13)


@given(
    st.floats(-np.pi, np.pi),
    st.floats(-np.pi / 2, np.pi / 2) | st.sampled_from([np.pi / 2, -np.pi / 2]),
    st.floats(-np.pi, np.pi),
)
def test_euler_angles_and_quaternions_lead_back(alpha: float, beta: float, gamma: float) -> None:
    """Where beta is a right angle the angles are others, and the rotation the same."""
    pose = Pose.from_euler(np.zeros(3), alpha, beta, gamma)
    np.testing.assert_allclose(Pose.from_euler(np.zeros(3), *pose.euler).rotation, pose.rotation, atol=3e-7)
    np.testing.assert_allclose(
        Pose.from_quaternion(np.zeros(3), pose.quaternion).rotation, pose.rotation, atol=1e-14
    )
    assert pose.quaternion[3] >= 0.0
    if np.cos(beta) > 1e-3:
        np.testing.assert_allclose(np.sin(pose.euler), np.sin([alpha, beta, gamma]), atol=1e-11)
        np.testing.assert_allclose(np.cos(pose.euler), np.cos([alpha, beta, gamma]), atol=1e-11)


def test_euler_is_z_then_y_then_x(rng: np.random.Generator) -> None:
    angles = rng.uniform(-np.pi, np.pi, (20, 3))
    np.testing.assert_allclose(
        rotation_from_euler(*angles.T), Rotation.from_euler("ZYX", angles).as_matrix(), atol=1e-14
    )
