"""Tension distribution on robots: along trajectories, under changes of frame, and bad input."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspr_kinematics import (
    InvalidInputError,
    KinematicsError,
    Payload,
    Pose,
    Robot,
    SingularWrenchMatrixError,
    bounded_methods,
    distribute_tensions,
    inverse_kinematics,
    static_wrench,
)

# Bounded problems of every kind: feasible with cables at a limit, overloaded, and pushed down.
LIMITS_AND_WRENCHES = [
    (500.0, 800.0, [100.0, 50.0, 2500.0, 5.0, -10.0, 2.0]),
    (50.0, 600.0, [0.0, 0.0, 5000.0, 0.0, 0.0, 0.0]),
    (50.0, 3000.0, [0.0, 0.0, -1000.0, 0.0, 0.0, 0.0]),
    (50.0, 3000.0, [3000.0, 0.0, 1500.0, 0.0, 0.0, 300.0]),
    (0.0, 3000.0, [0.0, 0.0, 0.0, 80.0, -90.0, 70.0]),
]


@pytest.fixture
def A(robot: Robot) -> np.ndarray:
    return inverse_kinematics(robot, Pose.from_euler([0.3, 0.1, 1.1], 0.02, 0.05, -0.04)).wrench_matrix


def test_minimum_norm_is_the_pseudoinverse(A: np.ndarray, rng: np.random.Generator) -> None:
    w = 1000.0 * rng.normal(size=(20, 6))
    result = distribute_tensions(A, w, 50.0, 3000.0)
    np.testing.assert_allclose(result.tensions, w @ np.linalg.pinv(A).T, atol=1e-9)
    np.testing.assert_allclose(result.residual, 0.0, atol=1e-9)


def test_feasible_says_whether_the_limits_hold(A: np.ndarray, robot: Robot) -> None:
    w = static_wrench(robot, robot.home)
    tensions = distribute_tensions(A, w, 0.0, 3000.0).tensions
    low, high = tensions.min(), tensions.max()
    assert distribute_tensions(A, w, low, high).feasible
    assert not distribute_tensions(A, w, low + 1e-6, high).feasible
    assert not distribute_tensions(A, w, low, high - 1e-6).feasible
    assert not distribute_tensions(A, -w, 0.0, 3000.0).feasible


def test_prototype_carries_353_kg_along_the_trajectory(robot: Robot) -> None:
    """Trajectory (18) is the same path at half the speed; 540 to 1055 N are the known extremes."""
    t = np.linspace(0.0, 10.0, 201)
    first = t <= 5.0
    path = [
        np.where(first, 0.08 * (2.5 - t) ** 2, 0.5 - 0.02 * (t - 5.0)),
        np.where(first, 0.12 * (2.5 - t), -0.3 + 0.04 * (t - 5.0)),
        np.where(first, 0.04 * t, 0.2 - 0.02 * (t - 5.0)),
    ]
    pose = Pose(robot.trajectory_center + np.stack(path, -1), np.eye(3))
    A = inverse_kinematics(robot, pose).wrench_matrix
    for mass in (0.0, 100.0, 200.0):
        w = static_wrench(robot, pose, Payload(mass, np.zeros(3)))
        result = distribute_tensions(A, w, robot.tension_min, robot.tension_max)
        assert result.feasible.all()
    assert 540.0 < result.tensions.min() < result.tensions.max() < 1055.0
    assert np.linalg.cond(A).max() < 10.5


@pytest.mark.parametrize("mass", [0.0, 200.0])
def test_level_platform_hangs_everywhere_in_the_workspace(robot: Robot, mass: float) -> None:
    axes = [
        np.linspace(low, high, 9) for low, high in zip(robot.workspace_min, robot.workspace_max, strict=True)
    ]
    pose = Pose(np.stack(np.meshgrid(*axes, indexing="ij"), -1), np.eye(3))
    A = inverse_kinematics(robot, pose).wrench_matrix
    w = static_wrench(robot, pose, Payload(mass, np.zeros(3)))
    assert distribute_tensions(A, w, robot.tension_min, robot.tension_max).feasible.all()


def test_closest_is_the_minimum_norm_where_that_is_inside(A: np.ndarray, robot: Robot) -> None:
    w = static_wrench(robot, robot.home)
    plain, closest = (distribute_tensions(A, w, 0.0, 3000.0, method=m) for m in ("minimum_norm", "closest"))
    np.testing.assert_array_equal(closest.tensions, plain.tensions)
    assert closest.feasible


@pytest.mark.parametrize(("low", "high", "w"), LIMITS_AND_WRENCHES)
def test_closest_is_inside_the_limits_and_optimal(
    A: np.ndarray, low: float, high: float, w: list[float]
) -> None:
    result = distribute_tensions(A, w, low, high, method="closest")
    t = result.tensions
    assert (t >= low).all()
    assert (t <= high).all()
    error = A @ t - w
    assert result.residual == pytest.approx(np.linalg.norm(error))
    # Optimality: no tension that is free to move would lessen the error, up to the regularisation.
    descent = -A.T @ error
    tolerance = 1e-5 * max(1.0, float(np.abs(w).max()))
    at_low, at_high = t <= low + 1e-6, t >= high - 1e-6
    assert (descent[~at_high] <= tolerance).all()
    assert (descent[~at_low] >= -tolerance).all()


def test_closest_finds_the_wrench_inside_narrower_limits(A: np.ndarray) -> None:
    low, high, w = LIMITS_AND_WRENCHES[0]
    assert not distribute_tensions(A, w, low, high).feasible
    result = distribute_tensions(A, w, low, high, method="closest")
    assert result.feasible
    assert result.residual < 1e-6 * np.linalg.norm(w)


def test_closest_does_not_jump_where_a_limit_becomes_active(A: np.ndarray, robot: Robot) -> None:
    w = static_wrench(robot, robot.home)
    lowest = distribute_tensions(A, w, 0.0, 3000.0).tensions.min()
    before, after = (
        distribute_tensions(A, w, lowest + change, 3000.0, method="closest").tensions
        for change in (-1e-4, 1e-4)
    )
    np.testing.assert_allclose(after, before, atol=1e-3)


@pytest.mark.parametrize("method", ["minimum_norm", "closest"])
def test_batches_equal_loops(
    robot: Robot, random_pose: Callable[..., Pose], rng: np.random.Generator, method: str
) -> None:
    pose = random_pose(3, 4)
    A = inverse_kinematics(robot, pose).wrench_matrix
    w = static_wrench(robot, pose) + 300.0 * rng.normal(size=(3, 4, 6))
    batch = distribute_tensions(A, w, 50.0, 900.0, method=method)
    assert batch.feasible.shape == batch.residual.shape == (3, 4)
    for k in np.ndindex(3, 4):
        single = distribute_tensions(A[k], w[k], 50.0, 900.0, method=method)
        np.testing.assert_allclose(batch.tensions[k], single.tensions, rtol=1e-6)
        assert batch.feasible[k] == single.feasible
    one_matrix = distribute_tensions(A[0, 0], w, 50.0, 900.0, method=method)
    np.testing.assert_allclose(one_matrix.tensions[0, 0], batch.tensions[0, 0], rtol=1e-6)


def test_limits_may_differ_from_cable_to_cable(A: np.ndarray, robot: Robot) -> None:
    high = np.full(8, 3000.0)
    high[3] = 100.0
    result = distribute_tensions(A, static_wrench(robot, robot.home), 50.0, high, method="closest")
    assert result.tensions[3] <= 100.0


def test_without_limits_in_reach_the_minimum_norm_says_so(A: np.ndarray) -> None:
    lifted = distribute_tensions(A, [0.0, 0.0, -1500.0, 0.0, 0.0, 0.0], 50.0, 3000.0)
    assert lifted.residual == pytest.approx(0.0, abs=1e-9)
    assert not lifted.feasible
    assert lifted.margin < 0.0


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"w": np.full(6, np.nan)}, "wrench"),
        ({"w": np.zeros(5)}, "wrench"),
        ({"A": np.zeros((5, 8))}, "wrench_matrix"),
        ({"A": np.full((6, 8), np.inf)}, "wrench_matrix"),
        ({"w": np.zeros((2, 6)), "A": np.zeros((3, 6, 8))}, "batch axes"),
        ({"low": 3000.0}, "t_min"),
        ({"low": np.nan}, "t_min"),
        ({"high": np.full(7, 3000.0)}, "batch axes"),
        ({"high": np.full((2, 8), 3000.0)}, "t_max"),
        ({"method": "softest"}, "method"),
    ],
)
def test_problems_are_checked(A: np.ndarray, change: dict[str, object], name: str) -> None:
    given = {"A": A, "w": np.zeros(6), "low": 50.0, "high": 3000.0, "method": "minimum_norm"} | change
    with pytest.raises(InvalidInputError) as caught:
        distribute_tensions(*given.values())
    assert caught.value.name == name


BOUNDED = ("closest", "centroid", "analytic_center")


def wrench_matrix(m: int, position: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """A (..., 6, m) of a robot made for this: m cables from a ring to anchors on two levels, crossed."""
    around = 2.0 * np.pi * np.arange(m) / m
    exits = np.column_stack((3.0 * np.cos(around), 2.0 * np.sin(around), np.full(m, 3.0)))
    crossed = around + np.where(np.arange(m) % 2, 1.9, -1.9)
    height = np.where(np.arange(m) % 2, 0.25, -0.25)
    anchors = np.column_stack((0.3 * np.cos(crossed), 0.3 * np.sin(crossed), height))
    arms = anchors @ rotation.T
    vectors = exits - position[..., None, :] - arms
    directions = vectors / np.linalg.norm(vectors, axis=-1)[..., None]
    return np.concatenate((directions, np.cross(arms, directions)), axis=-1).swapaxes(-1, -2)


def at_pose(m: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """A of the robot of m cables at a random pose, and a wrench that is often feasible for it."""
    rng = np.random.default_rng(seed)
    position = rng.uniform([-0.8, -0.5, 0.3], [0.8, 0.5, 1.5])
    rotation = Pose.from_euler(np.zeros(3), *rng.uniform(-0.2, 0.2, 3)).rotation
    A = wrench_matrix(m, position, rotation)
    return A, A @ rng.uniform(50.0, 900.0, m) + rng.normal(scale=300.0, size=6) * rng.integers(2)


cases = st.tuples(st.sampled_from([6, 8, 12]), st.integers(0, 2**32 - 1))


def methods_for(m: int) -> tuple[str, ...]:
    return BOUNDED if m <= 8 else ("closest", "analytic_center")


@given(cases)
def test_relabelling_the_cables_relabels_the_tensions(case: tuple[int, int]) -> None:
    A, w = at_pose(*case)
    order = np.random.default_rng(case[1]).permutation(case[0])
    for method in ("minimum_norm", *methods_for(case[0])):
        plain, relabelled = (distribute_tensions(a, w, 50.0, 900.0, method) for a in (A, A[:, order]))
        assert plain.feasible == relabelled.feasible
        np.testing.assert_allclose(relabelled.tensions, plain.tensions[order], atol=1e-4)


@given(cases)
def test_turning_the_base_frame_changes_nothing(case: tuple[int, int]) -> None:
    A, w = at_pose(*case)
    Q = Pose.from_euler(np.zeros(3), *np.random.default_rng(case[1]).uniform(-3.0, 3.0, 3)).rotation
    turn = np.kron(np.eye(2), Q)
    for method in ("minimum_norm", *methods_for(case[0])):
        plain = distribute_tensions(A, w, 50.0, 900.0, method)
        turned = distribute_tensions(turn @ A, turn @ w, 50.0, 900.0, method)
        assert plain.feasible == turned.feasible
        np.testing.assert_allclose(turned.tensions, plain.tensions, atol=1e-4)


@given(cases)
def test_moments_about_another_point_leave_feasible_tensions(case: tuple[int, int]) -> None:
    A, _ = at_pose(*case)
    rng = np.random.default_rng(case[1])
    w = A @ rng.uniform(100.0, 800.0, case[0])
    move = np.eye(6)
    move[3:, :3] = np.cross(rng.uniform(-0.5, 0.5, 3), np.eye(3)).T
    for method in ("minimum_norm", *methods_for(case[0])):
        plain, moved = (distribute_tensions(X @ A, X @ w, 50.0, 900.0, method) for X in (np.eye(6), move))
        np.testing.assert_allclose(moved.tensions, plain.tensions, atol=1e-5)


@pytest.mark.parametrize("m", [6, 8, 12])
def test_tensions_are_continuous_into_infeasibility_and_back(m: int) -> None:
    """With three times the points the largest step is a third, where a jump would stay."""
    largest = {}
    for points in (4000, 12000):
        phase = np.linspace(0.0, 2.0 * np.pi, points)
        path = np.column_stack((np.cos(phase), 0.6 * np.sin(phase), np.ones(points)))
        A = wrench_matrix(m, path, np.eye(3))
        w = np.zeros((points, 6))
        w[:, 2] = 2000.0 + 1500.0 * np.sin(2.0 * phase)
        w[:, 0] = 400.0 * np.cos(3.0 * phase)
        for method in methods_for(m):
            result = distribute_tensions(A, w, 100.0, 900.0, method)
            assert 0.02 < result.feasible.mean() < 0.98
            largest[method, points] = np.abs(np.diff(result.tensions, axis=0)).max()
    for method in methods_for(m):
        assert largest[method, 12000] < 0.5 * largest[method, 4000]


def test_all_methods_on_whole_robots(any_robot: Robot) -> None:
    robot = any_robot
    rng = np.random.default_rng(3)
    middle = 0.5 * (robot.workspace_min + robot.workspace_max)
    pose = Pose.from_euler(
        middle + rng.uniform(-0.3, 0.3, (50, 3)) * (robot.workspace_max - robot.workspace_min),
        *rng.uniform(-0.1, 0.1, (3, 50)),
    )
    A = inverse_kinematics(robot, pose).wrench_matrix
    w = static_wrench(robot, pose, Payload(50.0, [0.05, 0.0, 0.1]))
    margins = {}
    for method in bounded_methods(robot.number_of_cables):
        result = distribute_tensions(A, w, robot.tension_min, robot.tension_max, method)
        reached = result.feasible
        assert reached.mean() > 0.5
        np.testing.assert_allclose((A @ result.tensions[..., None])[reached, :, 0], w[reached], atol=1e-5)
        margins[method] = result.margin[reached]
    # What the two centres are for.
    centers = margins.keys() - {"closest"}
    assert centers
    for method in centers:
        if robot.number_of_cables > 6:  # six leave no choice
            assert margins[method].mean() > margins["closest"].mean()


@pytest.mark.parametrize("limit", [500.0, 5000.0, 1e6])
def test_a_light_platform_between_wide_limits(ten_cables: Robot, limit: float) -> None:
    """1.2 N of weight, tensions of thousands: what is feasible is so by every method."""
    way = np.linspace(ten_cables.workspace_min, ten_cables.workspace_max, 201)
    pose = Pose(way, np.eye(3))
    A, w = inverse_kinematics(ten_cables, pose).wrench_matrix, static_wrench(ten_cables, pose)
    closest, center = (distribute_tensions(A, w, 0.0, limit, m) for m in ("closest", "analytic_center"))
    assert closest.feasible.sum() > 100
    np.testing.assert_array_equal(center.feasible, closest.feasible)
    assert (center.margin > closest.margin)[closest.feasible].all()


def test_margin_is_the_distance_from_the_nearest_limit() -> None:
    A, _ = at_pose(8, 4)
    at_limit = distribute_tensions(A, A @ np.full(8, 400.0), 390.0, 700.0, "closest")
    assert at_limit.feasible
    assert at_limit.margin == 0.0
    assert at_limit.tensions.min() == 390.0
    below = distribute_tensions(A, A @ np.full(8, 400.0), 500.0, 700.0)
    assert below.margin == pytest.approx(below.tensions.min() - 500.0)
    assert below.margin < 0.0
    assert not below.tensions.flags.writeable


def test_batches_on_threads_equal_one_thread() -> None:
    A, w = (np.stack([at_pose(8, seed)[k] for seed in range(40)] * 30) for k in (0, 1))
    one, two = (distribute_tensions(A, w, 50.0, 900.0, "closest", threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.tensions, two.tensions)
    empty = distribute_tensions(A[:0], w[:0], 50.0, 900.0, "closest")
    assert empty.tensions.shape == (0, 8)


@pytest.mark.parametrize("method", ["minimum_norm", *BOUNDED])
def test_singular_wrench_matrix(method: str) -> None:
    A = np.stack([at_pose(8, seed)[0] for seed in range(3)])
    A[1, 5] = A[1, 4]  # no moment about z that is not one about y
    w = np.array([0.0, 0.0, 1500.0, 0.0, 0.0, 0.0])
    with pytest.raises(SingularWrenchMatrixError) as caught:
        distribute_tensions(A, w, 50.0, 3000.0, method)
    assert isinstance(caught.value, KinematicsError)
    assert caught.value.index == (1,)
    np.testing.assert_array_equal(caught.value.wrench_matrix, A[1])
    assert caught.value.singular_values[-1] < 1e-12


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"t_max": np.nan}, "t_max"),
        ({"t_min": np.zeros(7)}, "batch axes"),
        ({"t_min": 900.0, "t_max": 50.0}, "t_min"),
        ({"wrench_matrix": np.zeros((6, 5))}, "wrench_matrix"),
        ({"wrench_matrix": np.ones((6, 9)), "method": "centroid"}, "method"),
        ({"method": None}, "method"),
        ({"method": ["closest"]}, "method"),
        ({"threads": 0}, "threads"),
        ({"threads": 1.5}, "threads"),
    ],
)
def test_options_are_checked(change: dict[str, object], name: str) -> None:
    A, w = at_pose(8, 0)
    given = {"wrench_matrix": A, "wrench": w, "t_min": 50.0, "t_max": 900.0, "method": "closest"} | change
    with pytest.raises(InvalidInputError) as caught:
        distribute_tensions(**given)
    assert caught.value.name == name
