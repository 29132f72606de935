"""The shipped robots, CoGiRo, a small one, two made for the tests, and random motions."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cspr_kinematics import Acceleration, Pose, Robot, Twist

ROBOT_FILE = Path(__file__).parents[2] / "config" / "robot.yaml"
ROBOTS = Path(__file__).with_name("robot")  # beside the tests of its folder


@pytest.fixture(scope="session")
def robot_file() -> Path:
    return ROBOT_FILE


@pytest.fixture(scope="session")
def robot() -> Robot:
    return Robot.from_yaml(ROBOT_FILE)


@pytest.fixture(scope="session")
def cogiro() -> Robot:
    return Robot.from_yaml(ROBOTS / "cogiro.yaml")


@pytest.fixture(scope="session")
def robot_with_pulleys() -> Robot:
    return Robot.from_yaml(ROBOT_FILE.with_name("robot_pulleys.yaml"))


@pytest.fixture(scope="session")
def six_cables() -> Robot:
    return Robot.from_yaml(ROBOTS / "six_cables.yaml")


@pytest.fixture(scope="session")
def twelve_cables() -> Robot:
    return Robot.from_yaml(ROBOTS / "twelve_cables.yaml")


@pytest.fixture(scope="session")
def ten_cables() -> Robot:
    return Robot.from_yaml(ROBOTS / "ten_cables.yaml")


@pytest.fixture(params=["robot", "robot_with_pulleys", "cogiro", "six_cables", "ten_cables", "twelve_cables"])
def any_robot(request: pytest.FixtureRequest) -> Robot:
    robot: Robot = request.getfixturevalue(request.param)
    return robot


@pytest.fixture(scope="session")
def robots(request: pytest.FixtureRequest) -> Callable[[str], Robot]:
    """The robots by the names of their fixtures, for property tests, which cannot have a fixture an example."""
    return request.getfixturevalue


@pytest.fixture
def rng(seed: int) -> np.random.Generator:
    return np.random.default_rng(20240229 + seed)


@pytest.fixture
def random_pose(robot: Robot, rng: np.random.Generator) -> Callable[..., Pose]:
    """Poses inside the workspace, tilted by up to `tilt` about each axis; `batch` gives the leading axes."""

    def draw(*batch: int, tilt: float = 0.3) -> Pose:
        position = rng.uniform(robot.workspace_min, robot.workspace_max, (*batch, 3))
        return Pose.from_euler(position, *rng.uniform(-tilt, tilt, (3, *batch)))

    return draw


@pytest.fixture
def random_motion(rng: np.random.Generator) -> Callable[..., tuple[Pose, Twist, Acceleration]]:
    """Any pose, orientation included, with a lively twist and acceleration."""

    def draw(*batch: int) -> tuple[Pose, Twist, Acceleration]:
        count = int(np.prod(batch))
        rotation = Rotation.random(count, random_state=np.random.RandomState(rng.integers(2**31)))
        pose = Pose(rng.normal(size=(*batch, 3)), rotation.as_matrix().reshape(*batch, 3, 3))
        twist = Twist(*rng.normal(scale=2.0, size=(2, *batch, 3)))
        return pose, twist, Acceleration(*rng.normal(scale=5.0, size=(2, *batch, 3)))

    return draw
