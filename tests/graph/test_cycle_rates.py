"""The shipped configurations at their rates, with frames that take as long as on copper: no cycle lacks an answer.

In simulated time, so that it says what the buses can do and nothing about this computer.
"""

import pytest

pytest.importorskip("mujoco")

from benchmarks.stepped_graph import SteppedGraph

SECONDS = 1.0


@pytest.mark.parametrize(
    ("file", "rate", "conversion_time"),
    [("can.yaml", 250.0, 0.0025), ("can_two_buses.yaml", 500.0, 0.0006)],
)
def test_every_cycle_has_all_answers_and_all_torques(file, rate, conversion_time):
    graph = SteppedGraph(200.0, file, conversion_time)
    try:
        assert graph.robot.config.rate == rate
        graph.enable()
        before = graph.robot.drives.snapshot().statistics
        cells = graph.robot.load_cells.snapshot(graph.robot.now).statistics
        graph.robot.wait(SECONDS)
        after = graph.robot.drives.snapshot().statistics
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
        measured = graph.robot.load_cells.snapshot(graph.robot.now).statistics
        assert measured.cycles - cells.cycles == pytest.approx(rate * SECONDS, abs=1)
        assert measured.incomplete_cycles == cells.incomplete_cycles
    finally:
        graph.close()
