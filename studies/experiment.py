"""The paper's experiment on the simulated plant: every controller with every load (figures 11 and 12)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import Any

import numpy as np

from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.closed_loop.record import LoopRecord
from cspr_control.closed_loop.run import run
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.parameters.experiment import AddedPayload
from cspr_msgs_py.vocabulary import Controller, TrajectoryName
from studies.geometries import CONFIG, SHIPPED, Geometry

LOADS = (0.0, 100.0, 200.0)  # kg
TRAJECTORIES = (TrajectoryName.PAPER_19, TrajectoryName.SMOOTH_19)
# The plant alone; the trajectory begins in the middle of a control cycle, as it does on the average.
BARE = Scenario(config=CONFIG, devices=False, phase=0.002)
# (15) as printed: winches and ropes weigh nothing, and motor angles follow from the pose alone
EQUATION_15 = {"winch_inertia": False, "stretch_compensation": False, "rope_weight": False}
AS_PRINTED: dict[str, dict[str, Any]] = {
    "feedforward": EQUATION_15,
    "motor_control_gains": {"speed_delay": 0.0},
    "mass_estimator": {"method": "static"},  # (16) and (17)
}
PAPER = replace(BARE, parameters=AS_PRINTED)
CONTROLLERS = {  # by their names in the demo
    **{controller.value: replace(PAPER, controller=controller) for controller in Controller},
    "pdff (exact mass)": replace(PAPER, controller=Controller.PDFF, exact_mass=True),
    "static (exact mass)": replace(PAPER, controller=Controller.STATIC, exact_mass=True),
}
COMPARED = tuple(CONTROLLERS)[:5]  # those of the paper; the last one tells the model's share from the mass's
CHANGING = tuple(CONTROLLERS)[1:5]
BEYOND = {  # what the paper's do not have: the inertia of the winches, then all that config/control.yaml has
    "pdff-mass (winch inertia)": replace(
        BARE,
        controller=Controller.PDFF_MASS,
        parameters=AS_PRINTED | {"feedforward": EQUATION_15 | {"winch_inertia": True}},
    ),
    "pdff-mass (as shipped)": replace(BARE, controller=Controller.PDFF_MASS),
}


@dataclass(frozen=True)
class Case:
    """One run: a controller, a trajectory, the load aboard and what is added at 3 s, kg, and the geometry."""

    controller: str
    trajectory: TrajectoryName
    load: float
    added: float = 0.0
    geometry: Geometry = SHIPPED

    @property
    def scenario(self) -> Scenario:
        """The run as the closed loop takes it."""
        added = (AddedPayload(self.added, 3.0),) if self.added else ()
        chosen = (CONTROLLERS | BEYOND)[self.controller]
        return replace(
            chosen, config=self.geometry.config, trajectory=self.trajectory, payload=self.load, added=added
        )

    def __str__(self) -> str:
        """Name the case."""
        added = f" + {self.added:g} kg at 3 s" if self.added else ""
        geometry = "" if self.geometry == SHIPPED else f", {self.geometry.name} geometry"
        return f"{self.controller} on {self.trajectory.value} with {self.load:g} kg{added}{geometry}"


def controllers_of(geometry: Geometry) -> tuple[str, ...]:
    """Return which controllers carry every load: with the second geometry those of which the paper states something."""
    return COMPARED if geometry == SHIPPED else ("static", "pdff-mass", "pdff (exact mass)")


def all_cases(geometry: Geometry) -> list[Case]:
    """Return the cases of figures 11 and 12, a load that changes on the way, and with the heaviest load some more."""
    more = ("pdff", "static (exact mass)", *(BEYOND if geometry == SHIPPED else ()))
    changing = (*CHANGING, *BEYOND) if geometry == SHIPPED else ("pdff-mass",)
    cases = [
        Case(name, trajectory, load, geometry=geometry)
        for trajectory in TRAJECTORIES
        for load in LOADS
        for name in controllers_of(geometry)
    ]
    cases += [
        Case(name, trajectory, LOADS[-1], geometry=geometry) for trajectory in TRAJECTORIES for name in more
    ]
    cases += [Case(name, TrajectoryName.PAPER_19, 100.0, 100.0, geometry) for name in changing]
    return list(dict.fromkeys(cases))


def run_cases(cases: list[Case]) -> Iterator[tuple[Case, LoopRecord]]:
    """Yield each case with its record, in the order of the cases, as they are done."""
    with get_context("spawn").Pool() as pool:
        yield from zip(cases, pool.imap(run, [case.scenario for case in cases]), strict=True)


def tension_rms(record: LoopRecord) -> np.ndarray:
    """Return the RMS of the true tensions less those that the feed-forward counted on (m,), N."""
    return ErrorStatistics.of(record.tensions - record.asked_tensions).rms


def saturated(record: LoopRecord, torque_limit: float) -> float:
    """Return the share of the commands at the torque limit, N m."""
    return float((np.abs(np.nan_to_num(record.torque)) >= torque_limit).mean())
