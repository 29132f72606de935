"""Bounded tensions: our solvers against others on the same problems, and the growth with cables and poses."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from time import perf_counter
from typing import Any

import numpy as np
from scipy.optimize import lsq_linear

from cspr_kinematics import available_wrenches, distribute_tensions
from cspr_kinematics.compiled import kernel_input
from cspr_kinematics.kernels.tension_kernels import bounded_tensions_kernel

LOW, HIGH = 100.0, 900.0
PROBLEMS = 40
Solver = Callable[[np.ndarray, np.ndarray], np.ndarray]


def robot_matrix(m: int, position: np.ndarray) -> np.ndarray:
    """Wrench matrix (6, m) of m cables from a ring of exit points, crossed to a ring of anchors."""
    around = 2.0 * np.pi * np.arange(m) / m
    exits = np.column_stack((3.0 * np.cos(around), 2.0 * np.sin(around), np.full(m, 3.0)))
    odd = np.arange(m) % 2 == 1
    crossed = around + np.where(odd, 1.9, -1.9)
    arms = np.column_stack((0.3 * np.cos(crossed), 0.3 * np.sin(crossed), np.where(odd, 0.25, -0.25)))
    vectors = exits - position - arms
    directions = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    return np.ascontiguousarray(np.concatenate((directions, np.cross(arms, directions)), axis=1).T)


def make_problems(m: int, *, feasible: bool) -> list[tuple[np.ndarray, np.ndarray]]:
    """Wrenches whose nearest tensions have active limits, with some room left; or wrenches out of reach."""
    random = np.random.default_rng(m)
    problems: list[tuple[np.ndarray, np.ndarray]] = []
    while len(problems) < PROBLEMS:
        A = robot_matrix(m, random.uniform([-0.8, -0.5, 0.5], [0.8, 0.5, 1.5]))
        if not feasible:
            w = 2000.0 * random.normal(size=6)
            chosen = not distribute_tensions(A, w, LOW, HIGH, "closest").feasible
        else:
            w = A @ random.uniform(LOW, HIGH, m)
            room = distribute_tensions(A, w, LOW, HIGH, "analytic_center").margin > 1.0
            active = distribute_tensions(A, w, LOW, HIGH, "closest").active.any()
            chosen = bool(room and (active or m == 6))  # 6 cables leave no choice
        if chosen:
            problems.append((A, w))
    return problems


def quadprog_solver(m: int) -> Solver:
    quadprog = import_module("quadprog")
    unit = np.eye(m)
    bounds = np.concatenate((np.full(m, LOW), np.full(m, -HIGH)))
    zero = np.zeros(m)
    return lambda A, w: quadprog.solve_qp(
        unit, zero, np.concatenate((A.T, unit, -unit), axis=1), np.concatenate((w, bounds)), 6
    )[0]


def daqp_solver(m: int) -> Solver:
    daqp = import_module("daqp")
    unit, zero = np.eye(m), np.zeros(m)
    low, high = np.full(m, LOW), np.full(m, HIGH)
    sense = np.concatenate((np.zeros(m), np.full(6, 5))).astype(np.int32)

    def solve(A: np.ndarray, w: np.ndarray) -> np.ndarray:
        return np.asarray(
            daqp.solve(unit, zero, A.copy(), np.concatenate((high, w)), np.concatenate((low, w)), sense)[0]
        )

    return solve


def proxsuite_solver(m: int) -> Solver:
    proxqp = import_module("proxsuite").proxqp
    unit, zero = np.eye(m), np.zeros(m)
    low, high = np.full(m, LOW), np.full(m, HIGH)
    qp: Any = proxqp.dense.QP(m, 6, 0, True)
    qp.settings.eps_abs = 1e-8
    first = make_problems(m, feasible=True)[0]
    qp.init(unit, zero, first[0], first[1], None, None, None, low, high)

    def solve(A: np.ndarray, w: np.ndarray) -> np.ndarray:
        qp.update(A=A, b=w)
        qp.solve()
        return np.asarray(qp.results.x)

    return solve


def clarabel_solver(m: int) -> Solver:
    clarabel, sparse = import_module("clarabel"), import_module("scipy.sparse")
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    unit, zero = sparse.eye(m, format="csc"), np.zeros(m)
    cones = [clarabel.ZeroConeT(6), clarabel.NonnegativeConeT(2 * m)]
    bounds = np.concatenate((np.full(m, HIGH), np.full(m, -LOW)))

    def solve(A: np.ndarray, w: np.ndarray) -> np.ndarray:
        rows = sparse.csc_matrix(np.concatenate((A, np.eye(m), -np.eye(m))))
        solver = clarabel.DefaultSolver(unit, zero, rows, np.concatenate((w, bounds)), cones, settings)
        return np.asarray(solver.solve().x)

    return solve


def scipy_solver(m: int) -> Solver:
    small = 1e-5 * np.eye(m)

    def solve(A: np.ndarray, w: np.ndarray) -> np.ndarray:
        goal = np.concatenate((w, np.zeros(m)))
        return np.asarray(lsq_linear(np.concatenate((A, small)), goal, (LOW, HIGH), method="bvls").x)

    return solve


def numpy_solver(_m: int) -> Solver:
    return lambda A, w: np.asarray(np.linalg.pinv(A) @ w)


def own_kernel(m: int) -> Solver:
    low, high, reference = (kernel_input(np.full(m, value), m) for value in (LOW, HIGH, 0.0))
    weights, tensions = kernel_input(np.ones(6), 6), np.empty(m)

    def solve(A: np.ndarray, w: np.ndarray) -> np.ndarray:
        bounded_tensions_kernel(A, w, low, high, reference, weights, tensions)
        return tensions

    return solve


def own(method: Any) -> Solver:
    return lambda A, w: distribute_tensions(A, w, LOW, HIGH, method).tensions


SOLVERS: list[tuple[str, Callable[[int], Solver]]] = [
    ("our kernel, closest", own_kernel),
    ("ours, closest", lambda _m: own("closest")),
    ("ours, centroid (another optimum)", lambda _m: own("centroid")),
    ("ours, analytic centre (another optimum)", lambda _m: own("analytic_center")),
    ("plain numpy, pseudo-inverse (no limits)", numpy_solver),
    ("quadprog", quadprog_solver),
    ("daqp", daqp_solver),
    ("proxsuite, dense, warm", proxsuite_solver),
    ("clarabel", clarabel_solver),
    ("scipy, lsq_linear (regularised)", scipy_solver),
]


def microseconds(solver: Solver, problems: list[tuple[np.ndarray, np.ndarray]]) -> float:
    """Best mean time for a problem of five series, us."""
    inputs = [(kernel_input(A, *A.shape), kernel_input(w, 6)) for A, w in problems]
    for A, w in inputs[:3]:
        solver(A, w)
    times = []
    for _ in range(5):
        start = perf_counter()
        for A, w in inputs:
            solver(A, w)
        times.append((perf_counter() - start) / len(inputs))
    return min(times) * 1e6


def against_others() -> None:
    """Print times and deviations on the same feasible problems of 8 cables with active limits."""
    problems = make_problems(8, feasible=True)
    reference = [own("closest")(A, w) for A, w in problems]
    base = 0.0
    print(f"\n{'8 cables, limits active':44}{'us':>10}{'ratio':>10}{'deviation, N':>16}")
    for name, make in SOLVERS:
        try:
            solver = make(8)
            time = microseconds(solver, problems)
            found = [np.array(solver(A, w)) for A, w in problems]
        except ImportError as error:
            print(f"{name:44}{'left out: ' + str(error.name) + ' is not installed':>36}")
            continue
        base = base or time
        worst = max(float(np.abs(a - b).max()) for a, b in zip(found, reference, strict=True))
        print(f"{name:44}{time:>10.2f}{time / base:>10.1f}{worst:>16.1e}")


def growth_with_cables() -> None:
    """Print how time and steps grow from 6 to 16 cables."""
    header = ("cables", "closest", "steps", "infeasible", "steps", "centre", "faces", "")
    print(f"\n{'time in us, through the public functions':44}")
    print("".join(f"{title:>12}" for title in header))
    for m in range(6, 17):
        feasible, beyond = (make_problems(m, feasible=f) for f in (True, False))
        cells = [f"{m:>12}"]
        for problems in (feasible, beyond):
            steps = max(int(distribute_tensions(A, w, LOW, HIGH, "closest").steps) for A, w in problems)
            cells += [f"{microseconds(own('closest'), problems):>12.1f}", f"{steps:>12}"]
        cells.append(f"{microseconds(own('analytic_center'), feasible):>12.1f}")
        few = feasible[:5]
        cells.append(f"{microseconds(lambda A, w: available_wrenches(A, LOW, HIGH).margin(w), few):>12.1f}")
        print("".join(cells))


def growth_with_poses() -> None:
    """Print the time for each pose in batches."""
    print(f"\n{'8 cables, us for each pose of a batch':44}{'1 thread':>12}{'2 threads':>12}")
    problems = make_problems(8, feasible=True)
    for poses in (1, 10, 100, 1_000, 10_000, 100_000):
        A = np.resize(np.stack([A for A, _ in problems]), (poses, 6, 8))
        w = np.resize(np.stack([w for _, w in problems]), (poses, 6))
        cells = []
        for threads in (1, 2):
            times = []
            for _ in range(5):
                start = perf_counter()
                distribute_tensions(A, w, LOW, HIGH, "closest", threads=threads)
                times.append(perf_counter() - start)
            cells.append(f"{min(times) / poses * 1e6:>12.2f}")
        print(f"{poses:>44}{''.join(cells)}")


def main() -> None:
    """Print the tables."""
    against_others()
    growth_with_cables()
    growth_with_poses()
