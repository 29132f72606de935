"""Settling and tables of a run, on traces whose answers are known beforehand."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cspr_control.analysis.numbers.run_summary import (
    CycleStatistics,
    MassTrace,
    RunSummary,
    format_comparison,
    format_summary,
    settling_time,
    verdict,
)

CYCLE = CycleStatistics(250.0, 2500, 1, 400.0, 900.0, 2100.0)


def summary(**changes: object) -> RunSummary:
    values: dict[str, object] = {
        "controller": "pdff-mass",
        "exact_mass": False,
        "trajectory": "paper-19",
        "rms_position_error_deg": tuple(float(k) for k in range(1, 9)),
        "max_position_error_deg": tuple(10.0 * k for k in range(1, 9)),
        "mass_true_final_kg": 200.0,
        "mass_estimate_final_kg": 199.5,
        "mass_settling_time_s": 1.2,
        "cycle": CYCLE,
        "bag": "bag",
    }
    return RunSummary(**(values | changes))  # type: ignore[arg-type]


def mass(seconds: np.ndarray, kilograms: np.ndarray) -> MassTrace:
    return MassTrace((seconds * 1e9).round().astype(np.int64), kilograms)


def test_settling_time_counts_from_the_last_change_and_for_good() -> None:
    time = np.arange(0.0, 10.0, 0.02)
    truth = np.where(time < 3.0, 100.0, 200.0)
    lag = 200.0 - 100.0 * np.exp(-np.maximum(time - 3.0, 0.0) / 0.4)
    estimate = np.where(time < 3.0, 100.0, lag)
    # 100 exp(-t / 0.4) = 4 kg: t = 0.4 ln 25
    assert settling_time(mass(time, estimate), mass(time, truth)) == pytest.approx(
        0.4 * np.log(25.0), abs=0.021
    )
    disturbed = np.where((time > 5.0) & (time < 5.1), 190.0, estimate)
    assert settling_time(mass(time, disturbed), mass(time, truth)) == pytest.approx(2.1, abs=0.021)
    never = np.where(time > 9.9, 190.0, estimate)
    assert settling_time(mass(time, never), mass(time, truth)) is None


def test_settling_without_a_change_counts_from_the_beginning() -> None:
    time = np.arange(0.0, 5.0, 0.02)
    assert settling_time(mass(time, np.full_like(time, 100.5)), mass(time, np.full_like(time, 100.0))) == 0.0


def test_verdict_names_what_is_wrong() -> None:
    assert verdict(summary()) == "good"
    assert "cycles were missed" in verdict(summary(cycle=CycleStatistics(250.0, 1000, 10, 1.0, 2.0, 3.0)))
    assert "5.0 kg off" in verdict(summary(mass_estimate_final_kg=195.0))
    assert "did not settle" in verdict(summary(mass_settling_time_s=None))


def test_summary_as_mapping_is_json_with_the_promised_keys() -> None:
    stored = json.loads(json.dumps(summary().as_mapping()))
    assert {
        "controller", "exact_mass", "trajectory", "rms_position_error_deg", "max_position_error_deg",
        "mass_true_final_kg", "mass_estimate_final_kg", "mass_settling_time_s", "rate_hz", "cycles", "missed_cycles",
        "command_latency_us", "bag",
    } <= stored.keys()  # fmt: skip
    assert stored["command_latency_us"] == {"p50": 400.0, "p99": 900.0, "max": 2100.0}
    assert len(stored["rms_position_error_deg"]) == 8


def test_tables_hold_every_motor_and_fit_a_terminal() -> None:
    one = format_summary(summary())
    assert "motor 8" in one
    assert "80.00" in one
    assert "good" in one
    both = format_comparison(
        [summary(), summary(exact_mass=True, controller="pdff", mass_settling_time_s=None)]
    )
    assert "pdff (exact mass)" in both
    assert "never" in both
    assert max(map(len, (one + "\n" + both).splitlines())) <= 140
