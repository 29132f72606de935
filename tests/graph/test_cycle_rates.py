"""The shipped configurations at their rates, with frames that take as long as on a real bus: no cycle lacks an answer.

In simulated time, so that it says what the buses can do and nothing about this computer.
"""

from pathlib import Path

import pytest

pytest.importorskip("mujoco")

from cspr_control.closed_loop.run import closed_loop
from cspr_control.closed_loop.scenario import Scenario

CONFIG = Path(__file__).parents[2] / "config"
SECONDS = 1.0


@pytest.mark.parametrize(
    ("file", "rate", "conversion_time"),
    [("can.yaml", 250.0, 0.0025), ("can_two_buses.yaml", 500.0, 0.0006)],
)
def test_every_cycle_has_all_answers_and_all_torques(file, rate, conversion_time):
    scenario = Scenario(
        payload=200.0,
        config=CONFIG,
        buses=file,
        conversion_time=conversion_time,
        parameters={"/**": {"control_rate": rate}},
    )
    loop = closed_loop(scenario)
    robot, now = loop.machine, loop.time.monotonic
    try:
        assert robot.config.rate == rate
        loop.begin()
        loop.enable()
        before = robot.drives.snapshot().statistics
        cells = robot.load_cells.snapshot(now()).statistics
        loop.time.wait(SECONDS)
        after = robot.drives.snapshot().statistics
        assert after.cycles - before.cycles == pytest.approx(rate * SECONDS, abs=1)
        for count in (
            "missed_cycles",
            "incomplete_cycles",
            "late_commands",
            "late_feedback",
            "repeated_feedback",
        ):
            assert getattr(after, count) == getattr(before, count), count
        assert all(drive.missing == drive.late == 0 for drive in after.answers)
        measured = robot.load_cells.snapshot(now()).statistics
        assert measured.cycles - cells.cycles == pytest.approx(rate * SECONDS, abs=1)
        assert measured.incomplete_cycles == cells.incomplete_cycles
    finally:
        robot.close()
