"""The numbers of a run against what was put into it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cspr_control.analysis.numbers.tables import format_runs, row_texts
from cspr_control.analysis.run_analysis import RunAnalysis, analyse_bags

from ..conftest import CONFIG, PLATFORM_ERROR, PLATFORM_TURN, POSITION_ERROR, TENSION_ERROR, Motion


def test_motor_errors_are_those_that_were_recorded(run: RunAnalysis) -> None:
    position, velocity = run.metrics.position_error, run.metrics.velocity_error
    assert position is not None
    assert velocity is not None
    for statistic in (position.rms, position.median, position.maximum):
        np.testing.assert_allclose(statistic, np.degrees(POSITION_ERROR), rtol=1e-9)
    for statistic in (velocity.rms, velocity.median, velocity.maximum):
        np.testing.assert_allclose(statistic, 10.0, rtol=1e-9)


def test_the_platform_s_error_is_that_which_was_recorded(run: RunAnalysis) -> None:
    """True less wanted; the estimate is the reference itself, and so is off by the opposite of it."""
    platform = run.metrics.platform
    assert platform is not None
    assert platform.judged_by == "true pose"
    size = 1e3 * float(np.sqrt((PLATFORM_ERROR**2).sum()))
    for deviation, sign in ((platform.error, 1.0), (platform.estimate, -1.0)):
        assert deviation is not None
        assert (deviation.rms_mm, deviation.median_mm, deviation.max_mm) == pytest.approx(3 * (size,))
        assert deviation.mean_mm == pytest.approx(sign * 1e3 * PLATFORM_ERROR, abs=1e-6)
        assert deviation.rotation_rms_deg == pytest.approx(np.degrees(PLATFORM_TURN))
        assert deviation.rotation_max_deg == pytest.approx(np.degrees(PLATFORM_TURN))


def test_tensions_against_the_model(run: RunAnalysis) -> None:
    error, bias = run.metrics.tension_error, run.metrics.tension_bias
    assert error is not None
    # where the load changes, and where the motion begins and ends, a sample may stand beside the step of the model
    np.testing.assert_allclose(error.median, np.abs(TENSION_ERROR), atol=1e-6)
    np.testing.assert_allclose(bias, TENSION_ERROR, atol=0.6)


def test_mass_estimate(run: RunAnalysis) -> None:
    mass = run.metrics.mass
    assert mass is not None
    assert mass.true == 100.0
    assert mass.estimate == pytest.approx(100.5, abs=0.05)
    (change,) = mass.changes
    assert (change.mass_before, change.mass) == (50.0, 100.0)
    assert change.time == pytest.approx(2.0, abs=0.021)
    # 100 + 0.5 - 50 exp(-t / 0.25) within 2 kg of 100: t = 0.25 ln(50 / 2.5)
    assert mass.settling == change.settling == pytest.approx(0.25 * np.log(20.0), abs=0.041)
    assert -1.0 < mass.bias < 0.5
    assert 0.0 < mass.noise < 1.0


def test_saturation_and_unanswered_states(run: RunAnalysis) -> None:
    saturation = run.metrics.saturation
    assert saturation is not None
    np.testing.assert_allclose(saturation.share, [0, 0, 0.1, 0, 0, 0, 0, 0], atol=0.001)
    assert saturation.count[2] == pytest.approx(100, abs=1)
    assert run.metrics.cycle.unanswered == 1
    assert run.metrics.margins["torque_nm"].margin == pytest.approx(0.0)
    assert run.metrics.margins["torque_nm"].index == 3


def test_margins_name_cable_and_time(run: RunAnalysis) -> None:
    robot, tensions = run.recording.robot, run.recording.tensions
    assert tensions is not None
    judged = run.recording.in_window(tensions.time_ns)
    lowest = run.metrics.margins["tension_min_n"]
    assert lowest.margin == pytest.approx((tensions.effort[judged] - robot.tension_min).min())
    row = np.argmin(np.abs(run.recording.seconds(tensions.time_ns) - lowest.time))
    assert tensions.effort[row, lowest.index - 1] == pytest.approx(lowest.margin + lowest.limit)
    # y's border is 0.7 m from the centre, and the platform moves 0.05 m towards it
    assert run.metrics.margins["workspace_m"].margin == pytest.approx(0.65, abs=1e-6)


def test_cycle_and_what_the_driver_counted(run: RunAnalysis) -> None:
    cycle = run.metrics.cycle
    assert cycle.rate == pytest.approx(250.0)
    assert cycle.median_ms == cycle.longest_ms == pytest.approx(4.0)
    assert (cycle.cycles, cycle.missed) == (1000, 8)
    assert cycle.latency_p99_us == 900.0


def test_motors_and_cables_do_the_work_that_the_platform_takes(record: Callable[..., Path]) -> None:
    """Energy at the shafts equals the change of kinetic and potential energy: no friction is in this recording."""
    (run,) = analyse_bags([record(duration=1.0, masses={-10.0: 80.0})], configuration_directory=CONFIG)
    recording, robot = run.recording, run.recording.robot
    energy = run.metrics.energy
    drift = run.recording.states.effort * np.radians(10.0)  # of the speed error that is in the recording
    judged = recording.in_window(recording.states.time_ns)
    wrong = -drift[judged].sum() * 0.004
    net = float(energy.supplied.sum() - energy.returned.sum()) - wrong
    pose, twist, _ = Motion(robot, 1.0).at(
        np.array([0.0, 0.5])
    )  # at half time it is back at rest, 0.15 m higher
    assert np.abs((twist.linear[1], twist.angular[1])).max() < 1e-12
    assert np.ptp(pose.position[:, 2]) == pytest.approx(0.15, rel=1e-9)
    rise = (153.0 + 80.0) * 9.81 * 0.15  # J, of the weight of platform and payload
    assert net == pytest.approx(0.0, abs=0.01 * rise)  # there and back
    half = recording.states.time_ns <= recording.origin_ns + 500_000_000
    power = recording.states.effort * (recording.states.velocity + np.radians(10.0))
    assert power[judged & half].sum() * 0.004 == pytest.approx(rise, rel=0.02)


def test_metrics_are_json_without_nan(run: RunAnalysis, record: Callable[..., Path]) -> None:
    content = json.loads(json.dumps(run.metrics.as_mapping(), allow_nan=False))
    assert {
        "platform", "position_error_deg", "velocity_error_deg_per_s", "tension_error_n", "mass", "saturation",
        "margins", "cycle", "energy_j",
    } <= content.keys()  # fmt: skip
    assert len(content["position_error_deg"]["rms"]) == 8
    (bare,) = analyse_bags(
        [record(omitted=("/true_pose", "/simulation/payload", "/cable_tensions", "/diagnostics"))],
        configuration_directory=CONFIG,
    )
    content = json.loads(json.dumps(bare.metrics.as_mapping(), allow_nan=False))
    assert content["platform"] is None
    assert content["mass"]["bias"] is None
    assert content["tension_error_n"] is None
    assert content["energy_j"]["cables"] is None
    assert content["cycle"]["missed"] is None


def test_tables_hold_every_number_of_every_run(run: RunAnalysis) -> None:
    text = format_runs([run, run])
    for words in ("PDFF + mass", "swing", "50, then 100 kg", "8 of 1000 (0.80%)", "250.0", "saturated"):
        assert words in text
    assert " nan" not in text
    assert max(map(len, format_runs([run]).splitlines())) <= 120


@pytest.mark.parametrize(
    ("values", "texts"),
    [
        ([22.9, 17.0, 1.96], ["22.9", "17.0", "2.0"]),
        ([0.741, 0.7, 0.0], ["0.741", "0.700", "0.000"]),
        ([13573.2, -56.0, np.nan], ["13573", "-56", "-"]),
        ([1e-14, -1e-15], ["0", "0"]),
        ([250.0, -0.2], ["250", "0"]),
    ],
)
def test_the_numbers_of_a_row_have_the_same_decimals(values: list[float], texts: list[str]) -> None:
    assert row_texts(np.array(values)) == texts


def test_errors_by_load(run: RunAnalysis) -> None:
    by_load = run.errors_by_load()
    assert list(by_load) == [50.0, 100.0]
    for errors in by_load.values():
        np.testing.assert_allclose(errors, np.arange(1.0, 9.0))
