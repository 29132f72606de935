"""The numbers of a run in simulated time."""

import numpy as np
import pytest

pytest.importorskip("mujoco")

from cspr_control.analysis.numbers.run_summary import verdict
from cspr_control.closed_loop.record import LoopRecord
from cspr_control.closed_loop.scenario import Scenario
from cspr_msgs_py.vocabulary import Controller, TrajectoryName


def test_the_summary_of_a_run():
    time = np.arange(0.0, 8.0, 0.004)
    truth = np.where(time < 3.0, 100.0, 200.0)
    estimate = np.where(time < 3.5, 100.0, 199.0)
    error = np.radians(np.linspace(-10.0, 10.0, time.size)[:, None] * np.ones(8))
    nothing = np.zeros_like(error)
    scenario = Scenario(Controller.PDFF, True, TrajectoryName.SMOOTH_19, latency=0.0015)
    arrays = (time, error, nothing, nothing, nothing, nothing, estimate, truth)
    said = LoopRecord(scenario, *arrays, simulated=10.0, elapsed=1.0, cause="").summary()
    stored = said.as_mapping()
    assert stored["max_position_error_deg"] == pytest.approx([10.0] * 8)
    assert stored["mass_settling_time_s"] == pytest.approx(0.5)
    assert (stored["cycles"], stored["missed_cycles"]) == (2000, 0)
    assert stored["rate_hz"] == pytest.approx(250.0)
    assert stored["command_latency_us"]["p99"] == pytest.approx(1500.0)
    assert said.name == "pdff (exact mass)"
    assert verdict(said) == "good"
