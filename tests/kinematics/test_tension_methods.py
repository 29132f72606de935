"""Tension distribution on robots: along trajectories, under changes of frame and of method, and bad input."""

from __future__ import annotations

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
    TensionBlend,
    bounded_methods,
    distribute_tensions,
    inverse_kinematics,
    static_wrench,
)
from cspr_kinematics.motion.so3 import skew

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
        np.testing.assert_allclose(turned.separating_direction, turn @ plain.separating_direction, atol=1e-4)


@given(cases)
def test_moments_about_another_point_leave_feasible_tensions(case: tuple[int, int]) -> None:
    A, _ = at_pose(*case)
    rng = np.random.default_rng(case[1])
    w = A @ rng.uniform(100.0, 800.0, case[0])
    move = np.eye(6)
    move[3:, :3] = skew(rng.uniform(-0.5, 0.5, 3))
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


def test_result_names_the_active_limits() -> None:
    A, _ = at_pose(8, 4)
    extreme = distribute_tensions(
        A, A @ np.full(8, 400.0), 100.0, 700.0, "closest", reference=1e5 * np.eye(8)[2]
    )
    assert extreme.feasible
    assert (extreme.active != 0).sum() == 2  # a corner of the polygon
    assert extreme.margin == 0.0
    np.testing.assert_array_equal(extreme.active == 1, extreme.tensions == 700.0)
    np.testing.assert_array_equal(extreme.active == -1, extreme.tensions == 100.0)
    below = distribute_tensions(A, A @ np.full(8, 400.0), 500.0, 700.0)
    assert below.margin == pytest.approx(below.tensions.min() - 500.0)
    assert below.margin < 0.0
    np.testing.assert_array_equal(below.active, np.where(below.tensions <= 500.0, -1, 0))
    assert not below.tensions.flags.writeable


def test_batches_on_threads_equal_one_thread() -> None:
    A, w = (np.stack([at_pose(8, seed)[k] for seed in range(40)] * 30) for k in (0, 1))
    one, two = (distribute_tensions(A, w, 50.0, 900.0, "closest", threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.tensions, two.tensions)
    np.testing.assert_array_equal(one.separating_direction, two.separating_direction)
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
        ({"reference": np.nan}, "reference"),
        ({"reference": np.zeros(7)}, "batch axes"),
        ({"weights": np.zeros(6)}, "weights"),
        ({"weights": np.ones(5)}, "weights"),
        ({"t_min": 900.0, "t_max": 50.0}, "t_min"),
        ({"wrench_matrix": np.zeros((6, 5))}, "wrench_matrix"),
        ({"wrench_matrix": np.ones((6, 9)), "method": "centroid"}, "method"),
        ({"method": None}, "method"),
        ({"method": ["closest"]}, "method"),
        ({"threads": 0}, "threads"),
        ({"threads": 1.5}, "threads"),
    ],
)
def test_input_is_checked(change: dict[str, object], name: str) -> None:
    A, w = at_pose(8, 0)
    given = {"wrench_matrix": A, "wrench": w, "t_min": 50.0, "t_max": 900.0, "method": "closest"} | change
    with pytest.raises(InvalidInputError) as caught:
        distribute_tensions(**given)
    assert caught.value.name == name


SLEW, STEP = 400.0, 0.004


def held(m: int = 8) -> tuple[np.ndarray, np.ndarray]:
    A = wrench_matrix(m, np.array([0.3, 0.2, 0.9]), np.eye(3))
    return A, A @ np.full(m, 300.0)


def test_a_change_of_method_keeps_the_slew() -> None:
    A, w = held()
    blend = TensionBlend("closest", slew=SLEW)
    first = blend.distribute(A, w, 50.0, 900.0, 0.0)
    np.testing.assert_array_equal(first.tensions, distribute_tensions(A, w, 50.0, 900.0, "closest").tensions)
    blend.select("closest", reference=np.linspace(100.0, 800.0, 8))
    previous, steps = first.tensions, 0
    while not blend.settled:
        if steps == 20:  # in the middle of it
            blend.select("centroid")
        result = blend.distribute(A, w, 50.0, 900.0, STEP)
        assert result.feasible
        assert result.margin >= -1e-9
        assert result.residual < 1e-6
        np.testing.assert_allclose(A @ result.tensions, w, atol=1e-8)
        assert np.abs(result.tensions - previous).max() <= SLEW * STEP * (1.0 + 1e-9)
        previous, steps = result.tensions, steps + 1
        assert steps < 1000
    assert steps > 20
    assert blend.method == "centroid"
    goal = distribute_tensions(A, w, 50.0, 900.0, "centroid").tensions
    np.testing.assert_array_equal(blend.distribute(A, w, 50.0, 900.0, STEP).tensions, goal)


def test_a_change_of_method_adds_no_more_than_the_slew_to_a_moving_platform() -> None:
    blend = TensionBlend("closest", slew=SLEW, reference=600.0)
    previous = None
    before: list[np.ndarray] = []
    for k in range(300):
        A = wrench_matrix(8, np.array([0.3 * np.cos(0.01 * k), 0.3 * np.sin(0.01 * k), 0.9]), np.eye(3))
        w = np.array([0.0, 0.0, 1800.0, 0.0, 0.0, 0.0])
        own = [
            distribute_tensions(A, w, 50.0, 900.0, "closest", reference=600.0).tensions,
            distribute_tensions(A, w, 50.0, 900.0, "analytic_center").tensions,
        ]
        if k == 50:
            blend.select("analytic_center")
        tensions = blend.distribute(A, w, 50.0, 900.0, STEP).tensions
        if previous is not None:
            allowed = max(np.abs(a - b).max() for a, b in zip(own, before, strict=True))
            assert np.abs(tensions - previous).max() <= allowed + SLEW * STEP * (1.0 + 1e-9)
        previous, before = tensions, own
    np.testing.assert_allclose(previous, before[1])


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: TensionBlend("closest", slew=0.0), "slew"),
        (lambda: TensionBlend("softest", slew=1.0), "method"),
        (lambda: TensionBlend("closest", slew=1.0, reference=np.nan), "reference"),
        (lambda: TensionBlend("closest", slew=1.0).distribute(*held(), 50.0, 900.0, -0.1), "time_step"),
        (
            lambda: TensionBlend("closest", slew=1.0).distribute(
                held()[0], np.zeros((2, 6)), 50.0, 900.0, 0.1
            ),
            "wrench",
        ),
    ],
)
def test_blend_checks_its_input(call: object, name: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        call()
    assert caught.value.name == name
