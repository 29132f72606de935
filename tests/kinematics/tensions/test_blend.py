"""A change of the distribution method while the robot moves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cspr_kinematics import (
    InvalidInputError,
    Pose,
    Robot,
    TensionBlend,
    distribute_tensions,
    inverse_kinematics,
)

SLEW, STEP = 400.0, 0.004


@pytest.fixture
def A(robot: Robot) -> np.ndarray:
    return inverse_kinematics(robot, Pose([0.3, 0.2, 0.9], np.eye(3))).wrench_matrix


def test_a_change_of_method_keeps_the_slew(A: np.ndarray) -> None:
    w = A @ np.full(8, 300.0)
    slew = 0.1 * SLEW  # the methods differ by a few newtons here
    blend = TensionBlend("closest", slew=slew)
    first = blend.distribute(A, w, 50.0, 900.0, 0.0)
    np.testing.assert_array_equal(first.tensions, distribute_tensions(A, w, 50.0, 900.0, "closest").tensions)
    blend.select("analytic_center")
    previous, steps = first.tensions, 0
    while not blend.settled:
        if steps == 20:  # in the middle of it
            blend.select("centroid")
        result = blend.distribute(A, w, 50.0, 900.0, STEP)
        assert result.feasible
        assert result.margin >= -1e-9
        assert result.residual < 1e-6
        np.testing.assert_allclose(A @ result.tensions, w, atol=1e-8)
        assert np.abs(result.tensions - previous).max() <= slew * STEP * (1.0 + 1e-9)
        previous, steps = result.tensions, steps + 1
        assert steps < 1000
    assert steps > 20
    assert blend.method == "centroid"
    goal = distribute_tensions(A, w, 50.0, 900.0, "centroid").tensions
    np.testing.assert_array_equal(blend.distribute(A, w, 50.0, 900.0, STEP).tensions, goal)


def test_a_change_of_method_adds_no_more_than_the_slew_to_a_moving_platform(robot: Robot) -> None:
    blend = TensionBlend("closest", slew=SLEW)
    previous = None
    before: list[np.ndarray] = []
    for k in range(300):
        pose = Pose([0.3 * np.cos(0.01 * k), 0.3 * np.sin(0.01 * k), 0.9], np.eye(3))
        A = inverse_kinematics(robot, pose).wrench_matrix
        w = np.array([0.0, 0.0, 1800.0, 0.0, 0.0, 0.0])
        own = [
            distribute_tensions(A, w, 50.0, 900.0, "closest").tensions,
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
        (lambda A: TensionBlend("closest", slew=0.0), "slew"),
        (lambda A: TensionBlend("softest", slew=1.0), "method"),
        (
            lambda A: TensionBlend("closest", slew=1.0).distribute(
                A, A @ np.full(8, 300.0), 50.0, 900.0, -0.1
            ),
            "time_step",
        ),
        (
            lambda A: TensionBlend("closest", slew=1.0).distribute(A, np.zeros((2, 6)), 50.0, 900.0, 0.1),
            "wrench",
        ),
    ],
)
def test_blend_checks_its_input(A: np.ndarray, call: Callable[[np.ndarray], object], name: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        call(A)
    assert caught.value.name == name
