"""Each fault in simulated time: it ends held, brakes closed, latched and named, and the operator brings the robot back.

Driver, emulated devices on the model of a bus, plant, controllers and supervisor are the product's own; only the
processes and ROS between them are left out.
"""

from pathlib import Path

import pytest

pytest.importorskip("mujoco")

from cspr_control.closed_loop.fault_outcome import LARGEST_DROP, outcome_of
from cspr_control.closed_loop.fault_scenarios import SCENARIOS
from cspr_control.supervision.checks import FaultKind
from cspr_kinematics import Robot

ROOT = Path(__file__).parents[2]
ROBOT = Robot.from_yaml(ROOT / "config" / "robot.yaml")

# m. A cable of 4.5 m with a stiffness of 1.2 MN gives way by 4 mm for each kN that it takes over again.
LARGEST_JUMP = 0.005


def check(scenario, moving):
    outcome = outcome_of(scenario, moving, ROOT / "config")
    assert outcome.drop <= LARGEST_DROP
    assert outcome.jump < LARGEST_JUMP
    if outcome.controlled and not scenario.harms_tension:
        assert outcome.lowest_tension > ROBOT.tension_min.max()


@pytest.mark.parametrize("scenario", [s for s in SCENARIOS if s.held], ids=lambda scenario: scenario.name)
def test_fault_ends_held_and_the_operator_brings_the_robot_back(scenario):
    check(scenario, moving=False)


@pytest.mark.parametrize("scenario", [s for s in SCENARIOS if s.moving], ids=lambda scenario: scenario.name)
def test_fault_in_motion_ends_in_the_same_way(scenario):
    check(scenario, moving=True)


def documented():
    """Return the rows of docs/operation.md by their names; they are what `cspr faults` prints."""
    document = (ROOT / "docs" / "operation.md").read_text(encoding="utf-8")
    section = document.split("## What each fault does\n")[1].split("\n### ")[0]
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in section.splitlines() if "|" in line
    ]
    return {row[0]: row for row in rows[2:]}


def test_every_kind_of_fault_has_a_scenario():
    causes = [cause for row in documented().values() for cause in row[1].split("; then ")]
    shown = {cause.partition(":")[0] for cause in causes}
    untested = {kind for kind in FaultKind if kind.value not in shown}
    # Drivers that answer late are drivers that have a fault, a cable that hangs slack shows before its tension has been
    # too low for long, as its length fits no pose, and no node ends alone in simulated time: test_supervision plays
    # these. A wrong configuration is none of a robot that worked: test_wrong_configuration.
    elsewhere = {FaultKind.TIMEOUT, FaultKind.TENSION_LOW, FaultKind.NODE}
    assert untested == elsewhere | {FaultKind.TORQUE, FaultKind.CONFIGURATION}, (
        "add a scenario to closed_loop/fault_scenarios.py"
    )


def test_every_fault_is_in_the_document_with_what_it_costs():
    table = documented()
    assert set(table) == {scenario.name for scenario in SCENARIOS}
    for scenario in SCENARIOS:
        _, cause, _, held, held_drop, moving, moving_drop, lowest = table[scenario.name]
        assert scenario.cause in cause
        drops = [float(drop) for drop in (held_drop, moving_drop) if drop != "-"]
        assert max(drops) <= 1e3 * LARGEST_DROP
        assert (held == "-", moving == "-") == (not scenario.held, not scenario.moving)
        assert float(lowest) >= 0.0
