"""Settling and tables of a run, on traces whose answers are known beforehand."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cspr_control.analysis.numbers.cycles import CycleMetrics
from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.analysis.numbers.mass import MassMetrics, MassTrace, settling_time
from cspr_control.analysis.numbers.platform_error import PlatformMetrics, PoseDeviation
from cspr_control.analysis.numbers.run_summary import (
    RunSummary,
    format_comparison,
    format_summary,
    verdict,
)
from cspr_control.analysis.recording import Window
from cspr_control.analysis.run_analysis import RunAnalysis, analyse_bags
from cspr_control.errors import ControlError

from ..conftest import CONFIG

DEVIATION = PoseDeviation(3.43, 3.4, 5.1, np.array([0.1, 0.2, -3.4]), 0.05, 0.09)
PLATFORM = PlatformMetrics("true pose", np.zeros(3), DEVIATION, DEVIATION, None)
WINDOW = Window("trajectory", 0.0, 10.0)
CYCLE = CycleMetrics(250.0, 4.0, 4.2, 8.0, 0, WINDOW, 2500, 1, 400.0, 900.0, 2100.0)
MASS = MassMetrics(199.5, 200.0, 0.1, 0.1, 20.0, (), 1.2)


def summary(**changes: Any) -> RunSummary:
    """Return a summary; ``mass`` and ``cycle`` take what differs in them."""
    step = np.arange(1.0, 9.0)
    values: dict[str, Any] = {
        "controller": "pdff-mass",
        "exact_mass": False,
        "trajectory": "paper-19",
        "window": WINDOW,
        "position_error": ErrorStatistics(step, step, 10.0 * step),
        "platform": PLATFORM,
        "bag": "bag",
    }
    parts = {
        name: replace(part, **changes.pop(name, {})) for name, part in (("mass", MASS), ("cycle", CYCLE))
    }
    return RunSummary(**(values | parts | changes))


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
    assert settling_time(mass(time, np.full_like(time, 0.9)), mass(time, np.zeros_like(time))) == 0.0
    assert settling_time(mass(time, np.full_like(time, 1.1)), mass(time, np.zeros_like(time))) is None


def test_verdict_names_what_is_wrong() -> None:
    assert verdict(summary()) == "good"
    assert "cycles were missed" in verdict(summary(cycle={"cycles": 1000, "missed": 10}))
    assert "5.0 kg off" in verdict(summary(mass={"estimate": 195.0}))
    assert verdict(summary(mass={"estimate": 0.9, "true": 0.0})) == "good"
    assert "1.1 kg off (limit 1 %, 1 kg at least)" in verdict(summary(mass={"estimate": 1.1, "true": 0.0}))
    assert verdict(summary(mass={"estimate": 0.0}, cause="emergency stop")) == "stopped: emergency stop"
    assert "did not settle" in verdict(summary(mass={"settling": None}))


def test_summary_as_mapping_is_json_with_the_promised_keys() -> None:
    stored = json.loads(json.dumps(summary().as_mapping()))
    assert {
        "controller", "exact_mass", "trajectory", "rms_position_error_deg", "max_position_error_deg",
        "mass_true_final_kg", "mass_estimate_final_kg", "mass_settling_time_s", "rate_hz", "cycles", "missed_cycles",
        "command_latency_us", "bag", "window", "cycles_window",
    } <= stored.keys()  # fmt: skip
    assert stored["command_latency_us"] == {"p50": 400.0, "p99": 900.0, "max": 2100.0}
    assert len(stored["rms_position_error_deg"]) == 8
    of_the_platform = {name: value for name, value in stored.items() if "platform" in name}
    assert of_the_platform == {
        "platform_judged_by": "true pose", "rms_platform_error_mm": 3.43, "max_platform_error_mm": 5.1,
        "mean_platform_error_z_mm": -3.4, "rms_platform_rotation_error_deg": 0.05,
        "max_platform_rotation_error_deg": 0.09, "rms_platform_estimate_error_mm": 3.43,
        "max_platform_estimate_error_mm": 5.1,
    }  # fmt: skip
    unknown = json.loads(json.dumps(summary(platform=None).as_mapping()))
    assert {unknown[name] for name in of_the_platform} == {None}


def test_tables_hold_every_motor_and_fit_a_terminal() -> None:
    one = format_summary(summary())
    assert one.index("RMS 3.43 mm, maximum 5.10 mm, mean in z -3.40 mm") < one.index("motor 8")
    assert "80.00" in one
    assert "good" in one
    both = format_comparison(
        [summary(), summary(exact_mass=True, controller="pdff", mass={"settling": None})]
    )
    assert "pdff (exact mass)" in both
    assert "never" in both
    assert "3.43" in both
    assert "not known" in format_summary(summary(platform=None))
    assert max(map(len, (one + "\n" + both).splitlines())) <= 140


def test_a_summary_is_a_view_of_the_metrics(run: RunAnalysis) -> None:
    stored = RunSummary.of(run.metrics, controller="pdff-mass", exact_mass=False).as_mapping()
    metrics = run.metrics.as_mapping()
    assert stored["window"] == metrics["window"] == {"name": "trajectory", "start": 0.0, "end": 4.0}
    assert stored["cycles_window"] == metrics["cycle"]["counted"]
    assert (stored["cycles"], stored["missed_cycles"]) == (
        metrics["cycle"]["cycles"],
        metrics["cycle"]["missed"],
    )
    assert stored["cycles"] == 1000
    assert stored["rms_position_error_deg"] == metrics["position_error_deg"]["rms"]
    assert stored["max_position_error_deg"] == metrics["position_error_deg"]["maximum"]
    assert stored["mass_settling_time_s"] == metrics["mass"]["settling"]
    assert stored["mass_estimate_final_kg"] == metrics["mass"]["estimate"]


def test_a_summary_says_what_a_bag_lacks(record: Callable[..., Path]) -> None:
    omitted = ("/simulation/payload", "/diagnostics")
    (bare,) = analyse_bags([record(omitted=omitted)], configuration_directory=CONFIG)
    assert bare.metrics.cycle.cycles is None
    with pytest.raises(ControlError, match=r"lacks the estimated and the true payload on it: there is"):
        RunSummary.of(bare.metrics, controller="pd", exact_mass=False)
