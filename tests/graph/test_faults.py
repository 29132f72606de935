"""Each fault in simulated time: it ends held, brakes closed, latched and named, and the operator brings the robot back.

Driver, emulated devices on the model of a bus, plant, controllers and supervisor are the product's own; only the
processes and ROS between them are left out.
"""

import pytest

pytest.importorskip("mujoco")

from benchmarks.faults import LARGEST_DROP, PAYLOAD, SCENARIOS, run
from benchmarks.stepped_graph import SteppedGraph

# m. A cable of 4.5 m with a stiffness of 1.2 MN gives way by 4 mm for each kN that it takes over again.
LARGEST_JUMP = 0.005


class Bench:
    """A robot that is enabled; a new one after a test that failed."""

    def __init__(self):
        self.graph = None

    def enabled(self):
        if self.graph is None:
            self.graph = SteppedGraph(PAYLOAD)
            self.graph.enable()
            self.graph.robot.wait(0.5)
        return self.graph

    def discard(self):
        if self.graph is not None:
            self.graph.close()
            self.graph = None


@pytest.fixture(scope="module")
def bench():
    bench = Bench()
    yield bench
    bench.discard()


@pytest.mark.parametrize(
    "scenario", [s for s in SCENARIOS if s.held], ids=lambda scenario: scenario.name.replace(" ", "-")
)
def test_fault_ends_held_and_the_operator_brings_the_robot_back(bench, scenario):
    graph = bench.enabled()
    try:
        outcome = run(graph, scenario)
        assert outcome.drop <= LARGEST_DROP
        if outcome.controlled and not scenario.harms_tension:
            assert outcome.lowest_tension > graph.model.tension_min
        assert outcome.jump < LARGEST_JUMP
    except BaseException:
        bench.discard()
        raise


def test_a_controlled_stop_in_motion_keeps_every_cable_taut(bench):
    graph = bench.enabled()
    scenario = next(s for s in SCENARIOS if s.name == "recorder's disk full")
    try:
        outcome = run(graph, scenario, moving=True)
        assert outcome.controlled
        assert outcome.lowest_tension > graph.model.tension_min
        assert outcome.drop <= LARGEST_DROP
    except BaseException:
        bench.discard()
        raise
