"""The rigid motion between two frames, against scipy's own solution of the same problem."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cspr_control.analysis.alignment import align
from cspr_control.errors import ControlError

TURN = Rotation.from_euler("xyz", [20.0, -35.0, 140.0], degrees=True)
MOVE = np.array([500_000.0, -12.0, 3.0])


def curve(n: int = 200) -> np.ndarray:
    t = np.linspace(0.0, 1.0, n)
    return np.stack([np.cos(3.0 * t), t**2, 0.3 * t], axis=-1)


def test_a_frame_is_found_that_was_turned_and_moved() -> None:
    wanted = curve()
    measured = TURN.inv().apply(wanted - MOVE)
    found = align(measured, wanted)
    np.testing.assert_allclose(found.apply(measured), wanted, atol=1e-8)
    np.testing.assert_allclose(found.rotation.as_matrix(), TURN.as_matrix(), atol=1e-9)
    assert found.residual_rms_mm < 1e-4
    assert "turned by the rotation vector" in str(found)


def test_it_fits_noise_as_scipy_does() -> None:
    rng = np.random.default_rng(4)
    wanted = curve()
    measured = TURN.inv().apply(wanted) + rng.normal(0.0, 0.01, wanted.shape)
    found = align(measured, wanted)
    theirs, distance = Rotation.align_vectors(wanted - wanted.mean(axis=0), measured - measured.mean(axis=0))
    np.testing.assert_allclose(found.rotation.as_matrix(), theirs.as_matrix(), atol=1e-9)
    assert found.residual_rms_mm == pytest.approx(1e3 * distance / len(wanted) ** 0.5)


def test_a_plane_path_is_not_mirrored() -> None:
    wanted = curve() * [1.0, 1.0, 0.0]
    found = align(TURN.inv().apply(wanted), wanted)
    assert np.linalg.det(found.rotation.as_matrix()) == pytest.approx(1.0)
    np.testing.assert_allclose(found.rotation.as_matrix(), TURN.as_matrix(), atol=1e-9)


def test_points_in_a_plane_determine_the_rotation_although_errors_leave_it() -> None:
    rng = np.random.default_rng(6)
    angle = np.linspace(0.0, 2.0 * np.pi, 300)
    wanted = np.stack([0.6 * np.cos(angle), 0.1 * np.sin(angle), np.full(300, 1.0)], axis=-1)
    true = wanted + rng.normal(0.0, 0.005, wanted.shape) + [0.0, 0.0, -0.02]
    found = align(TURN.inv().apply(true), wanted)
    assert np.degrees((found.rotation * TURN.inv()).magnitude()) < 1.0
    assert found.residual_rms_mm < 10.0


def test_a_platform_that_sags_along_a_line_is_not_turned_over() -> None:
    """Down where it should be up: a turn by 180 degrees about the line would explain all of it."""
    t = np.linspace(-1.0, 1.0, 101)
    wanted = np.stack([t, np.zeros(101), 0.045 * t**2], axis=-1)
    with pytest.raises(ControlError, match="cannot be told from an error of the platform"):
        align(wanted * [1.0, 1.0, -1.0], wanted)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.linspace(0.0, 1.0, 50)[:, None] * [1.0, 2.0, 3.0], "lies on one line to within 0 mm"),
        (np.ones((50, 3)), "lies on one line to within 0 mm"),
        (curve(2), "there are 2 positions"),
    ],
)
def test_what_leaves_a_rotation_open_is_refused(points: np.ndarray, words: str) -> None:
    with pytest.raises(ControlError, match=words):
        align(points, points)
