"""Poses all over a workspace."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from cspr_kinematics import Pose, Robot

TILT = 0.35  # rad


@pytest.fixture
def workspace_grid(rng: np.random.Generator) -> Callable[[Robot], Pose]:
    """All of a robot's workspace, its corners included, with a random orientation at each point."""

    def draw(robot: Robot) -> Pose:
        axes = [np.linspace(a, b, 5) for a, b in zip(robot.workspace_min, robot.workspace_max, strict=True)]
        position = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
        return Pose.from_euler(position, *rng.uniform(-TILT, TILT, (3, len(position))))

    return draw
