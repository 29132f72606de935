"""What the paper says of its experiment, with the second geometry in closed loop."""

import pytest
from studies.experiment import TRAJECTORIES, Case, run_cases
from studies.experiment_statements import experiment_statements
from studies.loop_results import LoopResults, size_mm

LOADS = (0.0, 200.0)
WITHOUT_A_MEASURE = {
    "the measured tensions are compared with the simulated ones",
    "the experiment is sampled every 0.5 s",
    "the errors of position and velocity of the motors tell those of the platform",
}


@pytest.fixture(scope="module")
def results(second):
    """Run what the statements are about, with the lightest and the heaviest load."""
    printed, smooth = TRAJECTORIES
    cases = [
        Case(name, trajectory, load, geometry=second)
        for trajectory in TRAJECTORIES
        for load in LOADS
        for name in ("static", "pdff-mass", "pdff (exact mass)")
    ]
    cases += [Case(name, smooth, LOADS[-1], geometry=second) for name in ("pdff", "static (exact mass)")]
    cases.append(Case("pdff-mass", printed, 100.0, 100.0, second))
    return LoopResults(second, dict(run_cases(cases)), LOADS)


def test_every_statement_about_the_experiment_holds(results):
    statements = experiment_statements(results)
    assert [one.claim for one in statements if one.agrees is False] == []
    assert {one.claim for one in statements if one.agrees is None} == WITHOUT_A_MEASURE
    assert not any(one.cause for one in results.records.values())  # the supervisor stopped none of them


def test_the_motors_do_not_tell_how_far_the_cables_stretch(results):
    """What the load adds to the stretch along the way, and the survey's errors, are not in the motors' angles."""
    one = results.record("pdff-mass", TRAJECTORIES[1], LOADS[-1])
    assert size_mm(one.platform_error) > 3.0 * size_mm(results.platform_by_motors(one))
