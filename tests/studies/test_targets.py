"""What the controllers must reach, on the simulated plant: the paper's headlines, deterministic and without ROS."""

from dataclasses import replace

import numpy as np
import pytest
from studies.experiment import CONTROLLERS

from cspr_control.closed_loop.run import run


@pytest.fixture(scope="module")
def runs():
    """Run (19) with 100 kg that nobody announced, and 100 kg more at 3 s, by estimated and by exact mass."""
    return {name: run(CONTROLLERS[name]) for name in ("pdff-mass", "pdff (exact mass)")}


def test_the_estimated_mass_is_as_good_as_the_exact_one(runs):
    estimated, exact = (record.rms_deg.mean() for record in runs.values())
    assert estimated <= 1.05 * exact


def test_the_estimate_finds_the_mass_and_stays_with_it(runs):
    record = runs["pdff-mass"]
    assert record.mass_estimate[-1] == pytest.approx(200.0, rel=0.01)
    assert record.settling_time <= 3.0


def test_the_error_of_the_static_model_grows_with_the_payload():
    static = CONTROLLERS["static"]
    errors = [
        run(replace(static, payload=payload, added=())).rms_deg.mean() for payload in (0.0, 100.0, 200.0)
    ]
    assert np.diff(errors).min() > 2.0  # degrees
