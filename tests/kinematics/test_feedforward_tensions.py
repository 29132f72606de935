"""The fused chain equals its parts; and how kernels are compiled, cached and announced."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cspr_kinematics import (
    Acceleration,
    CableReachError,
    InvalidInputError,
    Payload,
    Pose,
    Robot,
    SingularWrenchMatrixError,
    Twist,
    distribute_tensions,
    feedforward_tensions,
    inverse_kinematics,
    required_wrench,
)

PACKAGE = Path(__file__).parents[2] / "src" / "cspr_kinematics"
PAYLOAD = Payload(80.0, [0.02, 0.01, -0.05])


@pytest.fixture
def motion(any_robot: Robot, rng: np.random.Generator) -> Callable[..., tuple[Pose, Twist, Acceleration]]:
    def draw(*batch: int) -> tuple[Pose, Twist, Acceleration]:
        low, high = any_robot.workspace_min, any_robot.workspace_max
        pose = Pose.from_euler(rng.uniform(low, high, (*batch, 3)), *rng.uniform(-0.15, 0.15, (3, *batch)))
        return (
            pose,
            Twist(*rng.normal(scale=0.5, size=(2, *batch, 3))),
            Acceleration(*rng.normal(scale=0.8, size=(2, *batch, 3))),
        )

    return draw


def test_the_chain_equals_its_parts(
    any_robot: Robot, motion: Callable[..., tuple[Pose, Twist, Acceleration]]
) -> None:
    states = motion(4, 10)
    external = np.linspace(-20.0, 20.0, 6)
    result = feedforward_tensions(any_robot, *states, PAYLOAD, external)
    cables = inverse_kinematics(any_robot, states[0])
    wrench = required_wrench(any_robot, *states, PAYLOAD, external)
    limits = any_robot.tension_min, any_robot.tension_max
    closest = distribute_tensions(cables.wrench_matrix, wrench, *limits, method="closest")
    np.testing.assert_array_equal(result.lengths, cables.lengths)
    np.testing.assert_array_equal(result.wrench_matrix, cables.wrench_matrix)
    np.testing.assert_allclose(result.wrench, wrench, atol=1e-10)
    np.testing.assert_allclose(result.tensions, closest.tensions, atol=1e-6)
    np.testing.assert_array_equal(result.feasible, closest.feasible)
    np.testing.assert_allclose(result.residual, closest.residual, atol=1e-6)
    twist = np.concatenate((states[1].linear, states[1].angular), axis=-1)
    np.testing.assert_allclose(result.length_rates, (cables.jacobian @ twist[..., None])[..., 0], atol=1e-12)


def test_single_states_and_threads_equal_the_batch(
    any_robot: Robot, motion: Callable[..., tuple[Pose, Twist, Acceleration]]
) -> None:
    pose, twist, acceleration = motion(1100)
    reference = np.full(any_robot.number_of_cables, 200.0)
    batch = feedforward_tensions(any_robot, pose, twist, acceleration, PAYLOAD, reference=reference)
    threaded = feedforward_tensions(
        any_robot, pose, twist, acceleration, PAYLOAD, reference=reference, threads=2
    )
    np.testing.assert_array_equal(threaded.tensions, batch.tensions)
    for k in range(0, 1100, 200):
        single = feedforward_tensions(
            any_robot,
            Pose(pose.position[k], pose.rotation[k]),
            Twist(twist.linear[k], twist.angular[k]),
            Acceleration(acceleration.linear[k], acceleration.angular[k]),
            PAYLOAD,
            reference=200.0,
        )
        assert single.tensions.shape == (any_robot.number_of_cables,)
        assert single.feasible.shape == ()
        np.testing.assert_array_equal(single.tensions, batch.tensions[k])


def test_batch_axes_broadcast(robot: Robot) -> None:
    rest = Twist.zero(), Acceleration.zero()
    loads = np.zeros((3, 6))
    loads[:, 2] = [0.0, -100.0, -200.0]
    poses = Pose(np.stack((robot.home.position,) * 3), np.eye(3))
    result = feedforward_tensions(robot, poses, *rest, external_wrench=loads)
    np.testing.assert_allclose(np.diff(result.wrench[:, 2]), 100.0)
    assert result.tensions.shape == (3, 8)
    for shape in ((3,), (3, 1), (2, 3)):  # and the other way round: many wrenches at one pose
        many = np.broadcast_to(loads if shape[-1] == 3 else loads[:, None], (*shape, 6))
        at_one = feedforward_tensions(robot, robot.home, *rest, external_wrench=many)
        assert at_one.tensions.shape == (*shape, 8)
        np.testing.assert_array_equal(at_one.wrench, required_wrench(robot, robot.home, *rest, None, many))
    nowhere = Pose(robot.exit_points[2] - robot.anchor_points[2], np.eye(3))
    with pytest.raises(CableReachError, match="cable 3"):
        feedforward_tensions(robot, nowhere, *rest, external_wrench=loads)
    with pytest.raises(ValueError, match="read-only"):
        result.tensions[0] = 0.0


def test_bad_input(robot: Robot) -> None:
    rest = robot.home, Twist.zero(), Acceleration.zero()
    two = Pose(np.stack((robot.home.position,) * 2), np.eye(3))
    with pytest.raises(InvalidInputError, match="external_wrench"):
        feedforward_tensions(robot, two, *rest[1:], external_wrench=np.zeros((3, 6)))
    with pytest.raises(InvalidInputError, match="external_wrench"):
        feedforward_tensions(robot, *rest, external_wrench=np.full(6, np.nan))
    with pytest.raises(InvalidInputError, match="reference"):
        feedforward_tensions(robot, *rest, reference=np.ones(7))
    with pytest.raises(InvalidInputError, match="weights"):
        feedforward_tensions(robot, *rest, weights=np.zeros(6))
    touching = Pose(robot.exit_points[2] - robot.anchor_points[2], np.eye(3))
    with pytest.raises(CableReachError, match=r"cable 3.*coincides") as caught:
        feedforward_tensions(robot, touching, *rest[1:])
    assert caught.value.cable == 3
    point = robot.with_geometry(anchor_points=np.zeros((8, 3)))
    with pytest.raises(SingularWrenchMatrixError) as singular:
        feedforward_tensions(point, *rest)
    assert singular.value.singular_values[-1] < 1e-9


def run_python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    path = {"PYTHONPATH": str(PACKAGE), **environment}
    return subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **path}, capture_output=True, text=True, check=True
    )


def test_the_first_call_says_that_it_compiles_and_later_ones_do_not(tmp_path: Path) -> None:
    code = (
        "import numpy as np; from cspr_kinematics import Pose;"
        "Pose(np.zeros(3), np.eye(3)); Pose(np.zeros((2, 3)), np.eye(3))"
    )
    runs = [run_python(code, NUMBA_CACHE_DIR=str(tmp_path)) for _ in range(2)]
    assert runs[0].stderr.count("compiling its kernels") == 1
    assert runs[1].stderr == ""


def test_without_a_place_for_the_cache_the_kernels_run_and_say_so_once() -> None:
    """numba finds no directory, as in an installation that cannot be written by a user without a home."""
    code = (
        "from numba.core import caching; caching.CacheImpl._locator_classes.clear();"
        "import numpy as np; from cspr_kinematics import Pose; print(Pose(np.zeros(3), np.eye(3)).batch_shape)"
    )
    run = run_python(code)
    assert run.stdout == "()\n"
    assert run.stderr.count("NUMBA_CACHE_DIR=DIRECTORY") == 1
    assert "compiling its kernels for this machine, in every process" in run.stderr
    assert run.stderr.count("\n") == 2


def test_import_is_quick_and_leaves_scipy_alone() -> None:
    code = (
        "import sys; from time import process_time as t; import numpy; a = t(); import cspr_kinematics;"
        "print(t() - a, 'scipy.optimize' in sys.modules, 'scipy.spatial' in sys.modules)"
    )
    seconds, *loaded = run_python(code).stdout.split()
    # of the processor's time: what else the machine does is not counted
    assert float(seconds) < 1.0
    assert loaded == ["False", "False"]
