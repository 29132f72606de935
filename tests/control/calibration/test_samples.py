"""Which states of a run count for a calibration."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from cspr_control.calibration.samples import calibration_samples
from cspr_control.errors import ControlError


def recording(angles, tensions, offset=0):
    times = 4_000_000 * np.arange(len(angles))
    cells = None if tensions is None else SimpleNamespace(time_ns=times + offset, effort=tensions)
    states = SimpleNamespace(time_ns=times, position=angles)
    return SimpleNamespace(path=Path("bag"), states=states, tensions=cells)


def test_standing_still_counts_once(robot):
    angles = np.zeros((900, 8))
    angles[300:600, 3] = np.linspace(0.0, 60.0, 300)
    angles[600:] = angles[599]
    tensions = np.full((900, 8), 500.0)
    samples = calibration_samples(recording(angles, tensions), robot)
    steps = np.diff(samples.motor_angles[:, 3])
    assert 4 < len(samples.motor_angles) < 20
    assert steps.min() * robot.winch.transmission_ratio > 0.01
    assert steps.max() < 1.1 * steps.min()


def test_slack_cables_tell_nothing(robot):
    angles, tensions = np.outer(np.arange(20.0), np.full(8, 30.0)), np.full((20, 8), 500.0)
    tensions[5:10, 2] = 3.0
    samples = calibration_samples(recording(angles, tensions, offset=1_000_000), robot)
    np.testing.assert_array_equal(samples.motor_angles[:, 0] / 30.0, [*range(5), *range(10, 20)])
    assert samples.tensions.min() == 500.0
    with pytest.raises(ControlError, match="no state all cables carry tension_min"):
        calibration_samples(recording(angles, np.zeros((20, 8))), robot)


def test_a_run_without_load_cells_counts_too(robot):
    samples = calibration_samples(recording(np.outer(np.arange(20.0), np.full(8, 30.0)), None), robot)
    assert samples.tensions is None
    assert len(samples.motor_angles) == 20
