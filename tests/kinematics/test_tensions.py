from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cspr_kinematics import (
    InvalidInputError,
    Payload,
    Pose,
    Robot,
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
def test_input_is_checked(A: np.ndarray, change: dict[str, object], name: str) -> None:
    given = {"A": A, "w": np.zeros(6), "low": 50.0, "high": 3000.0, "method": "minimum_norm"} | change
    with pytest.raises(InvalidInputError) as caught:
        distribute_tensions(*given.values())
    assert caught.value.name == name
