"""A real robot's published geometry, with lengths and tensions that were computed independently."""

from __future__ import annotations

import numpy as np

from cspr_kinematics import Pose, Robot, distribute_tensions, inverse_kinematics, static_wrench

LEVEL = Pose([0.0, 0.0, 2.0], np.eye(3))
LENGTHS = [9.7431, 9.1833, 9.4256, 9.4738, 9.7684, 9.1974, 9.5009, 9.5619]
TENSIONS = [361.20, 361.61, 387.27, 355.16, 337.66, 386.70, 367.82, 367.50]


def test_cable_lengths(cogiro: Robot) -> None:
    np.testing.assert_allclose(inverse_kinematics(cogiro, LEVEL).lengths, LENGTHS, atol=5.1e-5)


def test_minimum_norm_static_tensions(cogiro: Robot) -> None:
    A = inverse_kinematics(cogiro, LEVEL).wrench_matrix
    result = distribute_tensions(A, static_wrench(cogiro, LEVEL), cogiro.tension_min, cogiro.tension_max)
    assert result.feasible
    np.testing.assert_allclose(result.tensions, TENSIONS, atol=5.1e-3)
