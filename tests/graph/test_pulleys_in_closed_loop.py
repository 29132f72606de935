"""The control nodes' functions on a simulated machine with pulleys, with and without being told of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cspr_control.closed_loop.record import LoopRecord
from cspr_control.closed_loop.run import run
from cspr_control.closed_loop.scenario import Scenario
from cspr_kinematics import Pulleys
from cspr_msgs_py.vocabulary import TrajectoryName

CONFIG = Path(__file__).parents[2] / "config"


def record(robot: str, **supervisor: float) -> LoopRecord:
    return run(
        Scenario(
            config=CONFIG,
            devices=False,
            trajectory=TrajectoryName.SMOOTH_19,
            parameters={"/**": {"robot_config": robot}, "supervisor": supervisor},
            true_pulleys=Pulleys(0.05),
        )
    )


def test_pulleys_that_are_known_cost_nothing() -> None:
    known = record("robot_pulleys.yaml")
    assert known.rms_deg.mean() < 5.0  # 3.7 degrees without pulleys
    assert known.tensions.min() > 100.0
    assert known.mass_estimate[-1] == pytest.approx(200.0, rel=0.02)


def test_the_robot_moves_with_pulleys_that_the_controllers_do_not_know() -> None:
    unknown = record("robot.yaml", length_misfit=1e-3)
    assert np.abs(unknown.position_error).max() < np.radians(60.0)
    assert unknown.tensions.min() > 100.0
    assert not unknown.cause
    # the cables stand steeper than believed, and the load weighs less by as much
    assert 180.0 < unknown.mass_estimate[-1] < 196.0
