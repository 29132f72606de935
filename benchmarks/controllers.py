"""The controllers compared in closed loop without ROS: the nodes' own functions on the simulated plant.

As the demo compares them, but free of what the machine's load does to a live run, and the same every time.
"""

from __future__ import annotations

from dataclasses import replace
from multiprocessing import get_context

from studies.experiment import AS_PRINTED, BARE, CONTROLLERS

from cspr_control.closed_loop.run import run
from cspr_control.closed_loop.scenario import Scenario
from cspr_kinematics import Pulleys
from cspr_msgs_py.vocabulary import Controller, TrajectoryName

SMOOTH = replace(BARE, trajectory=TrajectoryName.SMOOTH_19)
EXACT = replace(SMOOTH, controller=Controller.PDFF, exact_mass=True)
CASES = {
    **{name: scenario for name, scenario in CONTROLLERS.items() if name != "static (exact mass)"},
    **{
        f"static, {load:g} kg, none added": replace(CONTROLLERS["static"], payload=load, added=())
        for load in (0.0, 100.0, 200.0)
    },
    "pdff-mass on smooth-19": replace(SMOOTH, parameters=AS_PRINTED),
    "pdff (exact mass) on smooth-19": replace(EXACT, parameters=AS_PRINTED),
    "pdff-mass, winch inertia": BARE,
    "pdff-mass on smooth-19, winch inertia": SMOOTH,
    "pdff (exact mass) on smooth-19, winch inertia": EXACT,
    **{
        f"pdff-mass on smooth-19, winch inertia, pulleys {told}": replace(
            SMOOTH,
            parameters={"/**": {"robot_config": robot}, "supervisor": {"length_misfit": 1e-3}},
            true_pulleys=Pulleys(0.05),
        )
        for told, robot in (("known", "robot_pulleys.yaml"), ("unknown", "robot.yaml"))
    },
}


def _row(name: str, scenario: Scenario) -> str:
    record = run(scenario)
    settled = f"{record.settling_time:.2f} s" if scenario.added else "-"
    errors = record.errors
    row = f"{name:54}{errors.rms.mean():>10.2f}{errors.maximum.max():>10.1f}{record.mass_error:>+12.2f} kg"
    return f"{row}{settled:>10}"


def main() -> None:
    """Print the table."""
    print("paper-19, 100 kg aboard and 100 kg added at 3 s except as stated; degrees at the motor shafts")
    print(f"{'controller':54}{'mean RMS':>10}{'max':>10}{'mass error':>15}{'settled':>10}")
    with get_context("spawn").Pool() as pool:
        for row in pool.starmap(_row, CASES.items(), chunksize=1):
            print(row, flush=True)
