from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from cspr_control.reference.catalogue import TrajectorySettings
from cspr_control.reference.point_to_point import MotionLimits
from cspr_kinematics import Pose, Robot
from cspr_msgs_py.parameters.table import defaults
from cspr_msgs_py.vocabulary import TrajectoryName

ROBOT_FILE = Path(__file__).parents[2] / "config" / "robot.yaml"


@pytest.fixture(scope="session")
def robot_file():
    return ROBOT_FILE


@pytest.fixture(scope="session")
def robot():
    return Robot.from_yaml(ROBOT_FILE)


@pytest.fixture(scope="session")
def limits():
    values = defaults("trajectory_publisher")
    return MotionLimits(**{field.name: values[field.name] for field in fields(MotionLimits)})


@pytest.fixture(scope="session")
def settings(limits):
    goal = Pose.from_euler([0.3, -0.2, 1.2], 0.1, -0.05, 0.08)
    return TrajectorySettings(TrajectoryName.HOLD, limits, goal, blend_time=1.0, hold_duration=2.0)


@pytest.fixture
def rng(seed):
    return np.random.default_rng(20240517 + seed)
