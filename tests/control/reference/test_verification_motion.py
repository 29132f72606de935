"""The motion of a verification."""

from __future__ import annotations

import numpy as np
import pytest

from cspr_control.errors import TrajectoryError
from cspr_control.reference.verification_motion import LIMITS, REACH, VerificationMotion
from cspr_kinematics import Pose, Robot


def test_it_goes_each_way_along_each_axis_slowly_and_returns(robot: Robot) -> None:
    here = Pose.from_euler(robot.home.position, 0.05, 0.02, -0.03)
    motion = VerificationMotion(robot, here)
    times = np.linspace(0.0, motion.duration, 4001)
    sampled = motion.sample(times)
    away = sampled.pose.position - here.position
    assert away.max(axis=0) == pytest.approx([REACH] * 3, abs=1e-4)
    assert away.min(axis=0) == pytest.approx([-REACH] * 3, abs=1e-4)
    assert np.abs(away[[0, -1]]).max() < 1e-9
    assert np.linalg.norm(sampled.twist.linear, axis=-1).max() <= LIMITS.speed + 1e-9
    differences = np.gradient(sampled.pose.position, times, axis=0)
    assert np.abs(differences - sampled.twist.linear)[1:-1].max() < 1e-3
    assert motion.sample(5.0).pose.rotation == pytest.approx(here.rotation)


def test_at_a_bound_of_the_workspace_it_stays_inside(robot: Robot) -> None:
    corner = Pose(robot.workspace_min, np.eye(3))
    motion = VerificationMotion(robot, corner)
    position = motion.sample(np.linspace(0.0, motion.duration, 501)).pose.position
    assert (position >= robot.workspace_min - 1e-9).all()
    assert np.ptp(position, axis=0).min() > 1.9 * REACH
    with pytest.raises(TrajectoryError, match="outside of the workspace"):
        VerificationMotion(robot, Pose(robot.workspace_min - 0.01, np.eye(3)))
