from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from cspr_kinematics.so3 import (
    cross,
    orthonormalised,
    rotate,
    rotation_from_euler,
    rotation_from_vector,
    skew,
)

vectors = arrays(np.float64, 3, elements=st.floats(-10.0, 10.0))


@settings(max_examples=40, deadline=None)
@given(vectors, vectors)
def test_cross_and_skew_are_the_cross_product(a: np.ndarray, b: np.ndarray) -> None:
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=1e-12)
    np.testing.assert_allclose(rotate(skew(a), b), np.cross(a, b), atol=1e-12)


@settings(max_examples=40, deadline=None)
@given(vectors)
def test_rotation_from_vector_is_the_exponential(vector: np.ndarray) -> None:
    np.testing.assert_allclose(
        rotation_from_vector(vector), Rotation.from_rotvec(vector).as_matrix(), atol=1e-13
    )


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 1e-9, 1e-6, np.pi])
def test_rotation_from_vector_near_its_special_angles(angle: float) -> None:
    vector = angle * np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(
        rotation_from_vector(vector), Rotation.from_rotvec(vector).as_matrix(), rtol=0.0, atol=1e-15
    )


def test_opposite_rotations_cancel(rng: np.random.Generator) -> None:
    vector = rng.normal(size=(20, 3))
    product = rotation_from_vector(vector) @ rotation_from_vector(-vector)
    np.testing.assert_allclose(product, np.broadcast_to(np.eye(3), (20, 3, 3)), atol=1e-14)


def test_euler_is_z_then_y_then_x(rng: np.random.Generator) -> None:
    angles = rng.uniform(-np.pi, np.pi, (20, 3))
    np.testing.assert_allclose(
        rotation_from_euler(*angles.T), Rotation.from_euler("ZYX", angles).as_matrix(), atol=1e-14
    )


def test_orthonormalised_removes_a_small_defect(rng: np.random.Generator) -> None:
    Q = Rotation.random(10, random_state=np.random.RandomState(3)).as_matrix()
    cleaned = orthonormalised(Q + 1e-7 * rng.normal(size=Q.shape))
    np.testing.assert_allclose(
        cleaned @ cleaned.swapaxes(-1, -2), np.broadcast_to(np.eye(3), Q.shape), atol=1e-12
    )
    np.testing.assert_allclose(cleaned, Q, atol=1e-6)
