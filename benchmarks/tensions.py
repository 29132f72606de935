"""Bounded tensions of one pose: our solvers and others on the same problems, from 6 to 16 cables."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks import solvers
from benchmarks.problems import HIGH, LOW, Problem, wrenches
from benchmarks.solvers import Solver
from benchmarks.timing import microseconds
from cspr_kinematics import distribute_tensions
from cspr_kinematics.compiled import kernel_input
from cspr_kinematics.tensions._bounded import bounded_tensions_kernel

CABLES = (6, 8, 10, 12, 14, 16)
PROBLEMS = 40


def own_kernel(m: int) -> Solver:
    """Our solver without anything around it."""
    low, high = (kernel_input(np.full(m, value), m) for value in (LOW, HIGH))
    tensions = np.empty(m)

    def solve(A: np.ndarray, w: np.ndarray) -> np.ndarray:
        bounded_tensions_kernel(A, w, low, high, tensions)
        return tensions

    return solve


def own(method: Any) -> Callable[[int], Solver]:
    """Return a maker of our public function, with the checks and the report that belong to it."""
    return lambda _m: lambda A, w: distribute_tensions(A, w, LOW, HIGH, method).tensions


SAME_OPTIMUM: dict[str, Callable[[int], Solver]] = {
    "our kernel": own_kernel,
    "ours, closest": own("closest"),
    "plain numpy": solvers.in_plain_numpy,
    "quadprog": solvers.quadprog,
    "daqp": solvers.daqp,
    "proxsuite, dense": solvers.proxsuite,
    "clarabel": solvers.clarabel,
    "scipy, lsq_linear (regularised)": solvers.scipy,
}
OTHER_OPTIMUM: dict[str, Callable[[int], Solver]] = {
    "ours, minimum_norm (no limits)": own("minimum_norm"),
    "ours, centroid": own("centroid"),
    "ours, analytic_center": own("analytic_center"),
}


def time_of(solver: Solver, problems: list[Problem]) -> float:
    """Time per problem, us."""

    def all_of_them() -> None:
        for A, w in problems:
            solver(A, w)

    return microseconds(all_of_them, 20) / len(problems)


def main() -> None:
    """Print the table."""
    problems = {m: wrenches(m, PROBLEMS, feasible=True) for m in CABLES}
    exact = {m: [own("closest")(m)(A, w) for A, w in problems[m]] for m in CABLES}
    titles = "".join(f"{m:>9}" for m in CABLES)
    print(
        f"\n{'us for one wrench with limits active; cables:':46}{titles}{'ratio at 8':>12}{'largest error, N':>18}"
    )
    base = 0.0
    for name, make in (SAME_OPTIMUM | OTHER_OPTIMUM).items():
        times, worst = {}, 0.0
        for m in CABLES:
            if name.endswith("centroid") and m > 8:
                continue
            try:
                solver = make(m)
            except ImportError as error:
                print(f"{name:46}  left out: {error.name} is not installed (requirements-bench.txt)")
                break
            times[m] = time_of(solver, problems[m])
            found = [np.array(solver(A, w)) for A, w in problems[m]]
            worst = max(worst, *(float(np.abs(a - b).max()) for a, b in zip(found, exact[m], strict=True)))
        else:
            base = base or times[8]
            cells = "".join(f"{times[m]:>9.1f}" if m in times else f"{'-':>9}" for m in CABLES)
            error_cell = f"{worst:>18.1e}" if name in SAME_OPTIMUM else f"{'another optimum':>18}"
            print(f"{name:46}{cells}{times[8] / base:>12.1f}{error_cell}")
