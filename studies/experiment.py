"""The paper's experiment on the simulated plant: every controller with every load (figures 11 and 12)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from multiprocessing import Pool
from pathlib import Path

import numpy as np

from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.closed_loop.record import LoopRecord
from cspr_control.closed_loop.run import run
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.parameters.experiment import AddedPayload
from cspr_msgs_py.vocabulary import Controller, TrajectoryName

LOADS = (0.0, 100.0, 200.0)  # kg
TRAJECTORIES = (TrajectoryName.PAPER_19, TrajectoryName.SMOOTH_19)
CONFIG = Path(__file__).parents[1] / "config"
# The plant alone; the trajectory begins in the middle of a control cycle, as it does on the average.
BARE = Scenario(config=CONFIG, devices=False, phase=0.002)
CONTROLLERS = {  # by their names in the demo
    **{controller.value: replace(BARE, controller=controller) for controller in Controller},
    "pdff (exact mass)": replace(BARE, controller=Controller.PDFF, exact_mass=True),
    "static (exact mass)": replace(BARE, controller=Controller.STATIC, exact_mass=True),
}
COMPARED = tuple(CONTROLLERS)[:5]  # those of the paper; the last one tells the model's share from the mass's
CHANGING = tuple(CONTROLLERS)[1:5]


@dataclass(frozen=True)
class Case:
    """One run: a controller, a trajectory, the load aboard and what is added at 3 s, kg."""

    controller: str
    trajectory: TrajectoryName
    load: float
    added: float = 0.0

    @property
    def scenario(self) -> Scenario:
        """The run as the closed loop takes it."""
        added = (AddedPayload(self.added, 3.0),) if self.added else ()
        chosen = CONTROLLERS[self.controller]
        return replace(chosen, trajectory=self.trajectory, payload=self.load, added=added)

    def __str__(self) -> str:
        """Name the case."""
        added = f" + {self.added:g} kg at 3 s" if self.added else ""
        return f"{self.controller} on {self.trajectory.value} with {self.load:g} kg{added}"


def all_cases() -> list[Case]:
    """Return the cases of figures 11 and 12, and a load that changes on the way."""
    cases = [
        Case(name, trajectory, load) for trajectory in TRAJECTORIES for load in LOADS for name in COMPARED
    ]
    cases += [Case("static (exact mass)", trajectory, LOADS[-1]) for trajectory in TRAJECTORIES]
    return cases + [Case(name, TrajectoryName.PAPER_19, 100.0, 100.0) for name in CHANGING]


def run_cases(cases: list[Case]) -> Iterator[tuple[Case, LoopRecord]]:
    """Yield each case with its record, in the order of the cases, as they are done."""
    with Pool() as pool:
        yield from zip(cases, pool.imap(run, [case.scenario for case in cases]), strict=True)


def tension_rms(record: LoopRecord) -> np.ndarray:
    """Return the RMS of the true tensions less those that the feed-forward counted on (m,), N."""
    return ErrorStatistics.of(record.tensions - record.asked_tensions).rms


def saturated(record: LoopRecord, torque_limit: float) -> float:
    """Return the share of the commands at the torque limit, N m."""
    return float((np.abs(np.nan_to_num(record.torque)) >= torque_limit).mean())
