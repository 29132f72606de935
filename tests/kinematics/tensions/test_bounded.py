"""Every tension distribution against the conditions of optimality, and against scipy's linear programming."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import null_space
from scipy.optimize import linprog, lsq_linear
from scipy.spatial import ConvexHull, Delaunay, HalfspaceIntersection

from cspr_kinematics import TensionResult, TensionStatus, distribute_tensions
from cspr_kinematics.compiled import kernel_input
from cspr_kinematics.tensions._active_set import (
    CAPPED,
    DUAL_STEPS_PER_CABLE,
    EMPTY,
    FOUND,
    nearest_feasible_kernel,
)
from cspr_kinematics.tensions._bounded import CENTER_STEPS
from cspr_kinematics.tensions._least_squares import LEAST_SQUARES_STEPS_PER_CABLE

BOUNDED = ("closest", "centroid", "analytic_center")


@dataclass(frozen=True)
class Problem:
    A: np.ndarray
    w: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @property
    def m(self) -> int:
        return self.A.shape[1]

    @property
    def scale(self) -> float:
        return float(self.high.max() * np.linalg.norm(self.A, axis=0).max())

    def solve(self, method: str) -> TensionResult:
        return distribute_tensions(self.A, self.w, self.low, self.high, method)

    def feasible_by_linprog(self) -> bool:
        answer = linprog(
            np.zeros(self.m), A_eq=self.A, b_eq=self.w, bounds=np.column_stack((self.low, self.high))
        )
        assert answer.status in (0, 2)
        return bool(answer.status == 0)


def make_problem(m: int, kind: str, seed: int) -> Problem:
    """Cables in random directions, most of them upwards, and a wrench inside, anywhere, or at the border."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(m, 3))
    directions[:, 2] = np.abs(directions[:, 2]) + 0.3
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    arms = rng.uniform(-0.5, 0.5, (m, 3))
    if kind == "twins":  # neighbouring cables that do the same
        directions[1::2], arms[1::2] = directions[: m // 2 * 2 : 2], arms[: m // 2 * 2 : 2]
        directions[-1] = rng.normal(size=3)
        directions[-1] /= np.linalg.norm(directions[-1])
    A = np.concatenate((directions, np.cross(arms, directions)), axis=1).T
    low = rng.uniform(0.0, 100.0, m)
    high = low + rng.uniform(100.0, 3000.0, m)
    if kind == "inside":
        w = A @ rng.uniform(low, high)
    elif kind == "border":
        middle = 0.5 * (low + high)
        normal = rng.normal(size=6)
        corner = np.where(normal @ A > 0.0, high, low)
        w = A @ (middle + (corner - middle) * (1.0 + rng.choice([-1.0, 1.0]) * 10.0 ** rng.uniform(-12, -2)))
    else:
        w = 1000.0 * rng.normal(size=6)
    return Problem(A, w, low, high)


problems = st.builds(
    make_problem,
    st.integers(6, 16),
    st.sampled_from(["inside", "border", "anywhere"]),
    st.integers(0, 2**32 - 1),
)
eight_cables = st.builds(
    make_problem, st.just(8), st.sampled_from(["inside", "border"]), st.integers(0, 2**32 - 1)
)


def stationarity_defect(problem: Problem, t: np.ndarray, gradient: np.ndarray) -> float:
    """How far `gradient` is from A^T y + multipliers of the right signs at the active limits."""
    near = 1e-9 * problem.high.max()
    at_low, at_high = t <= problem.low + near, t >= problem.high - near
    columns = [problem.A.T, np.eye(problem.m)[:, at_low], -np.eye(problem.m)[:, at_high]]
    matrix = np.concatenate(columns, axis=1)
    lower = np.concatenate((np.full(6, -np.inf), np.zeros(matrix.shape[1] - 6)))
    answer = lsq_linear(matrix, gradient, (lower, np.full(matrix.shape[1], np.inf)), tol=1e-14, method="bvls")
    return float(np.linalg.norm(matrix @ answer.x - gradient))


@given(problems)
def test_closest_satisfies_the_conditions_of_optimality(problem: Problem) -> None:
    result = problem.solve("closest")
    t = result.tensions
    assert (t >= problem.low).all()
    assert (t <= problem.high).all()
    if result.feasible:
        assert result.status == TensionStatus.EXACT
        assert result.residual <= 1e-6 * max(np.linalg.norm(problem.w), 1.0)
        assert stationarity_defect(make_exact(problem, t), t, t) <= 1e-5 * problem.high.max()
    else:
        check_least_error(problem, result)


def make_exact(problem: Problem, t: np.ndarray) -> Problem:
    return Problem(problem.A, problem.A @ t, problem.low, problem.high)


def check_least_error(problem: Problem, result: TensionResult) -> None:
    """The tensions are of least error, and its direction proves that none do better: it separates all within reach."""
    t = result.tensions
    assert result.status == TensionStatus.INFEASIBLE
    error = problem.w - problem.A @ t
    assert result.residual == pytest.approx(np.linalg.norm(error))
    gradient = -problem.A.T @ error
    tolerance = 1e-8 * problem.scale
    assert (gradient[t < problem.high] >= -tolerance).all()
    assert (gradient[t > problem.low] <= tolerance).all()
    # The exact error is orthogonal to the columns of the cables that are free to move.
    columns = problem.A[:, (t > problem.low) & (t < problem.high)]
    direction = error - columns @ np.linalg.lstsq(columns, error, rcond=None)[0]
    direction /= np.linalg.norm(direction)
    slopes = direction @ problem.A
    reach = np.maximum(slopes * problem.low, slopes * problem.high).sum()
    separation = direction @ problem.w - reach
    assert separation == pytest.approx(float(result.residual), rel=1e-4, abs=1e-9 * problem.scale)


@given(problems)
def test_feasibility_agrees_with_linear_programming(problem: Problem) -> None:
    result = problem.solve("closest")
    if result.feasible:
        t = result.tensions
        assert (problem.low <= t).all()
        assert (t <= problem.high).all()
        assert np.linalg.norm(problem.A @ t - problem.w) <= 1e-6 * max(np.linalg.norm(problem.w), 1.0)
    elif result.residual > 1e-5 * problem.scale:
        assert not problem.feasible_by_linprog()


@given(problems)
def test_analytic_center_satisfies_the_conditions_of_optimality(problem: Problem) -> None:
    result, closest = problem.solve("analytic_center"), problem.solve("closest")
    assert result.feasible == closest.feasible
    if not result.feasible:
        np.testing.assert_array_equal(result.tensions, closest.tensions)
    elif result.margin > 1e-6 * problem.high.max():
        t = result.tensions
        pull = 1.0 / (t - problem.low) - 1.0 / (problem.high - t)
        assert np.abs(null_space(problem.A).T @ pull).max(initial=0.0) <= 1e-4 * np.abs(pull).max()


@given(eight_cables)
def test_centroid_is_that_of_the_polygon(problem: Problem) -> None:
    result = problem.solve("centroid")
    if not result.feasible:
        np.testing.assert_array_equal(result.tensions, problem.solve("closest").tensions)
        return
    inner = problem.solve("analytic_center").tensions
    inner = inner + np.linalg.pinv(problem.A) @ (problem.w - problem.A @ inner)  # which it gives only nearly
    room = min((inner - problem.low).min(), (problem.high - inner).min())
    if room < 1e-3:
        return  # the yardstick is no better than that
    # x such that inner + N x is within the limits, by qhull
    N = null_space(problem.A)
    halfspaces = np.concatenate(
        (np.column_stack((N, inner - problem.high)), np.column_stack((-N, problem.low - inner)))
    )
    vertices = HalfspaceIntersection(halfspaces, np.zeros(2)).intersections
    corners = vertices[ConvexHull(vertices).vertices]
    triangles = corners[Delaunay(corners).simplices]
    edges = triangles[:, 1:] - triangles[:, :1]
    areas = np.abs(np.linalg.det(edges))
    centroid = areas @ triangles.mean(axis=1) / areas.sum()
    extent = np.ptp(corners, axis=0).max()
    np.testing.assert_allclose(result.tensions, inner + N @ centroid, atol=1e-6 * extent)


def test_centroid_of_seven_cables_is_the_middle_of_a_line() -> None:
    problem = make_problem(7, "inside", 5)
    direction = null_space(problem.A)[:, 0]
    t = problem.solve("centroid").tensions
    forward, backward = (
        np.min(np.where(s * direction > 0, problem.high - t, t - problem.low) / np.abs(direction))
        for s in (1.0, -1.0)
    )
    assert forward == pytest.approx(backward, rel=1e-9)


@given(eight_cables)
def test_polygon_and_active_set_agree(problem: Problem) -> None:
    """The two solvers share nothing but the problem."""
    result = problem.solve("closest")
    N = null_space(problem.A)
    particular = np.linalg.pinv(problem.A) @ problem.w
    x = np.zeros(2)
    limits = kernel_input(problem.low, 8), kernel_input(problem.high, 8)
    outcome, steps = nearest_feasible_kernel(particular, N.copy(), *limits, x)
    assert steps <= DUAL_STEPS_PER_CABLE * 8
    if outcome == FOUND:
        assert result.feasible
        np.testing.assert_allclose(result.tensions, particular + N @ x, atol=1e-5 * problem.high.max())
    else:
        assert outcome == EMPTY
        assert not result.feasible or result.margin < 1e-6 * problem.high.max()


@given(st.builds(make_problem, st.integers(7, 16), st.just("twins"), st.integers(0, 2**32 - 1)))
def test_degenerate_cables(problem: Problem) -> None:
    """Parallel limits, and a choice left where the wrench is out of reach."""
    if np.linalg.matrix_rank(problem.A) < 6:
        return
    result = problem.solve("closest")
    assert result.status != TensionStatus.ITERATION_LIMIT
    if not result.feasible:
        check_least_error(problem, result)


def test_steps_stay_below_the_stated_cap() -> None:
    most = 0.0
    for kind in ("inside", "border", "anywhere", "twins"):
        for m in (6, 7, 8, 9, 12, 16):
            batch = [make_problem(m, kind, seed) for seed in range(60)]
            batch = [p for p in batch if np.linalg.matrix_rank(p.A) == 6]
            if not batch:
                continue
            A, w, low, high = (np.stack([getattr(p, n) for p in batch]) for n in ("A", "w", "low", "high"))
            for method in BOUNDED:
                if method == "centroid" and m > 8:
                    continue
                result = distribute_tensions(A, w, low, high, method)
                assert not (result.status == TensionStatus.ITERATION_LIMIT).any()
                cap = (DUAL_STEPS_PER_CABLE + LEAST_SQUARES_STEPS_PER_CABLE) * m
                assert result.steps.max() <= cap + (CENTER_STEPS if method == "analytic_center" else 1)
                if method == "closest":
                    most = max(most, result.steps.max() / m)
    assert most <= 5.0  # a quarter of the cap


def test_a_solver_at_its_cap_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    from cspr_kinematics.tensions import _active_set as tension_active_set
    from cspr_kinematics.tensions import _bounded as tension_kernels
    from cspr_kinematics.tensions import _least_squares as tension_least_squares

    problem = make_problem(10, "anywhere", 1)
    inputs = problem.A, problem.w, problem.low, problem.high
    # As plain Python, in which the caps are read when the functions run.
    monkeypatch.setattr(tension_active_set, "DUAL_STEPS_PER_CABLE", 0)
    monkeypatch.setattr(tension_least_squares, "LEAST_SQUARES_STEPS_PER_CABLE", 0)
    dual = nearest_feasible_kernel.py_func
    least_squares = tension_least_squares.bounded_least_squares_kernel.py_func
    monkeypatch.setattr(tension_kernels, "nearest_feasible_kernel", dual)
    monkeypatch.setattr(tension_kernels, "bounded_least_squares_kernel", least_squares)
    N = null_space(problem.A)
    x = np.zeros(4)
    outcome, _ = dual(np.linalg.pinv(problem.A) @ problem.w, N, problem.low, problem.high, x)
    assert outcome == CAPPED
    t = np.empty(10)
    status, _ = tension_kernels.bounded_tensions_kernel.py_func(*inputs, t)
    assert status == TensionStatus.ITERATION_LIMIT
    assert np.linalg.norm(problem.A @ t - problem.w) > 0.0
    assert (t >= problem.low).all()
    assert (t <= problem.high).all()
