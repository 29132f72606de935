"""Other solvers, for bounded tensions of least norm that give a wrench.

Each maker takes the number of cables and returns a function of wrench matrix (6, m) and wrench (6,) with the tensions
(m,). The solvers with a package of their own are in requirements-bench.txt.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from benchmarks import plain_numpy
from benchmarks.problems import HIGH, LOW

Solver = Callable[[np.ndarray, np.ndarray], np.ndarray]


def in_plain_numpy(_m: int) -> Solver:
    """Newton's iteration on the dual problem in numpy."""
    return lambda A, w: plain_numpy.bounded(A, w, LOW, HIGH)


def quadprog(m: int) -> Solver:
    """Goldfarb and Idnani's dual active-set method in C."""
    package = import_module("quadprog")
    unit, zero = np.eye(m), np.zeros(m)
    bounds = np.concatenate((np.full(m, LOW), np.full(m, -HIGH)))
    return lambda A, w: package.solve_qp(
        unit, zero, np.concatenate((A.T, unit, -unit), axis=1), np.concatenate((w, bounds)), 6
    )[0]


def daqp(m: int) -> Solver:
    """Dual active-set method in C, made for embedded control."""
    package = import_module("daqp")
    unit, zero = np.eye(m), np.zeros(m)
    low, high = np.full(m, LOW), np.full(m, HIGH)
    sense = np.concatenate((np.zeros(m), np.full(6, 5))).astype(np.int32)

    def solve(A: np.ndarray, w: np.ndarray) -> np.ndarray:
        bounds = np.concatenate((high, w)), np.concatenate((low, w))
        return np.asarray(package.solve(unit, zero, A.copy(), *bounds, sense)[0])

    return solve


def proxsuite(m: int) -> Solver:
    """Proximal augmented Lagrangian method in C++; keeps its memory from one problem to the next."""
    proxqp = import_module("proxsuite").proxqp
    unit, zero = np.eye(m), np.zeros(m)
    low, high = np.full(m, LOW), np.full(m, HIGH)
    qp: Any = proxqp.dense.QP(m, 6, 0, True)
    qp.settings.eps_abs = 1e-8
    qp.init(unit, zero, np.eye(6, m), np.full(6, LOW), None, None, None, low, high)

    def solve(A: np.ndarray, w: np.ndarray) -> np.ndarray:
        qp.update(A=A, b=w)
        qp.solve()
        return np.asarray(qp.results.x)

    return solve


def clarabel(m: int) -> Solver:
    """Interior-point method in Rust."""
    package, sparse = import_module("clarabel"), import_module("scipy.sparse")
    settings = package.DefaultSettings()
    settings.verbose = False
    unit, zero = sparse.eye(m, format="csc"), np.zeros(m)
    cones = [package.ZeroConeT(6), package.NonnegativeConeT(2 * m)]
    bounds = np.concatenate((np.full(m, HIGH), np.full(m, -LOW)))

    def solve(A: np.ndarray, w: np.ndarray) -> np.ndarray:
        rows = sparse.csc_matrix(np.concatenate((A, np.eye(m), -np.eye(m))))
        solver = package.DefaultSolver(unit, zero, rows, np.concatenate((w, bounds)), cones, settings)
        return np.asarray(solver.solve().x)

    return solve


def scipy(m: int) -> Solver:
    """Bounded least squares, with a small weight on the norm: scipy has no solver for equalities and bounds."""
    optimize = import_module("scipy.optimize")
    small = 1e-5 * np.eye(m)

    def solve(A: np.ndarray, w: np.ndarray) -> np.ndarray:
        goal = np.concatenate((w, np.zeros(m)))
        rows = np.concatenate((A, small))
        return np.asarray(optimize.lsq_linear(rows, goal, (LOW, HIGH), method="bvls").x)

    return solve
