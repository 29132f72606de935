"""Bounded tensions by this package and by general solvers of quadratic programs, on the same problems.

The problem: least |t|^2 with A t = w and t_min <= t <= t_max, at poses of the shipped robot that need the
limits.
Solvers that are not installed are skipped.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from types import ModuleType

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from benchmarks.kinematics import CONFIG
from benchmarks.timing import microseconds
from cspr_kinematics import Payload, Pose, Robot, distribute_tensions, inverse_kinematics, static_wrench
from cspr_kinematics.kernels.tension_kernels import bounded_tensions_kernel

FloatArray = NDArray[np.float64]
Solver = Callable[[FloatArray, FloatArray, float, float], FloatArray]
PROBLEMS = 50


def problems(robot: Robot, low: float, high: float) -> list[tuple[FloatArray, FloatArray]]:
    """Poses at rest whose wrench has bounded tensions, but not those of least norm."""
    random = np.random.default_rng(2)
    payload = Payload(100.0, [0.03, -0.02, 0.1])
    found: list[tuple[FloatArray, FloatArray]] = []
    while len(found) < PROBLEMS:
        position = random.uniform(robot.workspace_min, robot.workspace_max)
        pose = Pose.from_euler(position, *random.uniform(-0.1, 0.1, 3))
        A, w = inverse_kinematics(robot, pose).wrench_matrix, static_wrench(robot, pose, payload)
        free = distribute_tensions(A, w, low, high)
        if not free.feasible and distribute_tensions(A, w, low, high, method="closest").feasible:
            found.append((A, w))
    return found


def by_kernel(low: float, high: float) -> Solver:
    limits = np.full(8, low), np.full(8, high)
    reference, weights = np.zeros(8), np.ones(6)

    def solve(A: FloatArray, w: FloatArray, low: float, high: float) -> FloatArray:
        t = np.empty(8)
        bounded_tensions_kernel(A, w, *limits, reference, weights, t)
        return t

    return solve


def by_this_package(A: FloatArray, w: FloatArray, low: float, high: float) -> FloatArray:
    return distribute_tensions(A, w, low, high, method="closest").tensions


def by_scipy(A: FloatArray, w: FloatArray, low: float, high: float) -> FloatArray:
    m = A.shape[1]
    stacked = np.concatenate((A, 1e-5 * np.eye(m)))
    return lsq_linear(stacked, np.concatenate((w, np.zeros(m))), (low, high), method="bvls").x


def by_quadprog(quadprog: ModuleType) -> Solver:
    def solve(A: FloatArray, w: FloatArray, low: float, high: float) -> FloatArray:
        m = A.shape[1]
        one = np.eye(m)
        constraints = np.concatenate((A, one, -one)).T
        bounds = np.concatenate((w, np.full(m, low), np.full(m, -high)))
        return quadprog.solve_qp(one, np.zeros(m), constraints, bounds, 6)[0]

    return solve


def by_daqp(daqp: ModuleType) -> Solver:
    def solve(A: FloatArray, w: FloatArray, low: float, high: float) -> FloatArray:
        m = A.shape[1]
        upper = np.concatenate((np.full(m, high), w))
        lower = np.concatenate((np.full(m, low), w))
        sense = np.concatenate((np.zeros(m), np.full(6, 5))).astype(np.int32)
        return daqp.solve(np.eye(m), np.zeros(m), np.array(A, order="C"), upper, lower, sense)[0]

    return solve


def by_proxsuite(proxsuite: ModuleType) -> Solver:
    def solve(A: FloatArray, w: FloatArray, low: float, high: float) -> FloatArray:
        m = A.shape[1]
        result = proxsuite.proxqp.dense.solve(
            H=np.eye(m),
            g=np.zeros(m),
            A=A,
            b=w,
            l_box=np.full(m, low),
            u_box=np.full(m, high),
            eps_abs=1e-9,
        )
        return np.asarray(result.x)

    return solve


def by_clarabel(clarabel: ModuleType) -> Solver:
    from scipy.sparse import csc_matrix, identity

    settings = clarabel.DefaultSettings()
    settings.verbose = False

    def solve(A: FloatArray, w: FloatArray, low: float, high: float) -> FloatArray:
        m = A.shape[1]
        one = np.eye(m)
        constraints = csc_matrix(np.concatenate((A, one, -one)))
        bounds = np.concatenate((w, np.full(m, high), np.full(m, -low)))
        cones = [clarabel.ZeroConeT(6), clarabel.NonnegativeConeT(2 * m)]
        P = csc_matrix(identity(m))
        return np.array(
            clarabel.DefaultSolver(P, np.zeros(m), constraints, bounds, cones, settings).solve().x
        )

    return solve


OTHERS: dict[str, Callable[[ModuleType], Solver]] = {
    "quadprog": by_quadprog,
    "daqp": by_daqp,
    "proxsuite": by_proxsuite,
    "clarabel": by_clarabel,
}


def main() -> None:
    """Print the table."""
    robot = Robot.from_yaml(CONFIG / "robot.yaml")
    low, high = 300.0, 900.0
    cases = problems(robot, low, high)
    solvers: dict[str, Solver] = {
        "kernel": by_kernel(low, high),
        "distribute_tensions, closest": by_this_package,
        "scipy lsq_linear (bvls)": by_scipy,
    }
    skipped = []
    for name, make in OTHERS.items():
        try:
            solvers[name] = make(import_module(name))
        except ImportError:
            skipped.append(name)
    reference = [by_this_package(A, w, low, high) for A, w in cases]
    title = f"bounded tensions of 8 cables, {PROBLEMS} poses"
    print(f"\n{title:40}{'us each':>10}{'ratio':>9}{'largest difference, N':>24}")
    base = None
    for name, solve in solvers.items():
        answers = [solve(A, w, low, high) for A, w in cases]
        worst = max(float(np.abs(a - b).max()) for a, b in zip(answers, reference, strict=True))

        def run(solve: Solver = solve) -> None:
            for A, w in cases:
                solve(A, w, low, high)

        time = microseconds(run, 40) / PROBLEMS
        base = base or time
        print(f"{name:40}{time:>10.2f}{time / base:>9.1f}{worst:>24.2g}")
    for name in skipped:
        print(f"{name:40}not installed; pip install {name}")
