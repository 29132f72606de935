"""The set of available wrenches against the convex hull of its corners and against linear programming."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from cspr_kinematics import (
    InvalidInputError,
    SingularWrenchMatrixError,
    available_wrenches,
    distribute_tensions,
)


def random_cables(m: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(m, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    arms = rng.uniform(-0.5, 0.5, (m, 3))
    low = rng.uniform(0.0, 100.0, m)
    return (
        np.concatenate((directions, np.cross(arms, directions)), axis=1).T,
        low,
        low + rng.uniform(100, 900, m),
    )


@pytest.mark.parametrize("m", [6, 7, 8])
def test_faces_are_those_of_the_convex_hull_of_the_corners(m: int) -> None:
    A, low, high = random_cables(m, m)
    reach = available_wrenches(A, low, high)
    corners = np.array(list(itertools.product(*zip(low, high, strict=True)))) @ A.T
    equations = ConvexHull(corners).equations  # normal . w + offset <= 0
    distance = np.abs(equations[:, None, :6] - reach.normals).max(axis=-1)
    assert distance.min(axis=1).max() < 1e-6  # each face of the hull is one of ours
    assert distance.min(axis=0).max() < 1e-6  # and each of ours one of the hull's
    np.testing.assert_allclose(-equations[:, 6], reach.offsets[distance.argmin(axis=1)], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("m", [6, 8, 12])
def test_margin_is_the_way_to_the_border(m: int) -> None:
    A, low, high = random_cables(m, 10 + m)
    reach = available_wrenches(A, low, high)
    rng = np.random.default_rng(m)
    for _ in range(5):
        w = A @ rng.uniform(low, high)
        margin = float(reach.margin(w))
        assert margin >= 0.0
        nearest = int((reach.offsets - reach.normals @ w).argmin())
        unit = reach.normals[nearest]
        assert np.linalg.norm(unit) == pytest.approx(1.0)
        for more, within in ((-0.02, True), (0.02, False)):
            moved = w + (margin + more) * unit
            assert distribute_tensions(A, moved, low, high, "closest").feasible == within
            assert (
                linprog(np.zeros(m), A_eq=A, b_eq=moved, bounds=list(zip(low, high, strict=True))).status == 0
            ) is within
        direction = rng.normal(size=6)
        shortest = w + 0.999 * margin * direction / np.linalg.norm(direction)
        assert reach.margin(shortest) >= 0.0
    assert reach.margin(1e6 * np.ones((2, 3, 6))).shape == (2, 3)


def test_feasibility_by_faces_is_that_of_the_tensions() -> None:
    A, low, high = random_cables(8, 3)
    reach = available_wrenches(A, low, high)
    rng = np.random.default_rng(0)
    w = rng.uniform(low - 100.0, high + 100.0, (500, 8)) @ A.T
    inside = reach.margin(w) >= 0.0
    assert 0.05 < inside.mean() < 0.95
    result = distribute_tensions(A, w, low, high, "closest")
    np.testing.assert_array_equal(result.feasible, inside)
    # From outside the faces see at least a part of the distance.
    assert (-reach.margin(w)[~inside] <= result.residual[~inside] + 1e-9).all()


def test_input_is_checked() -> None:
    A, low, high = random_cables(8, 1)
    flat = A.copy()
    flat[5] = 0.0
    with pytest.raises(SingularWrenchMatrixError) as caught:
        available_wrenches(flat, low, high)
    np.testing.assert_array_equal(caught.value.wrench_matrix, flat)
    for arguments, name in (
        ((A[:, :5], 0.0, 1.0), "wrench_matrix"),
        ((np.full((6, 8), np.nan), 0.0, 1.0), "wrench_matrix"),
        ((A, 2.0, 1.0), "t_min"),
        ((A, np.zeros(7), 1.0), "t_min"),
        ((A, 0.0, np.inf), "t_max"),
    ):
        with pytest.raises(InvalidInputError) as wrong:
            available_wrenches(*arguments)
        assert wrong.value.name == name
    with pytest.raises(InvalidInputError, match="wrench"):
        available_wrenches(A, low, high).margin(np.zeros(5))
