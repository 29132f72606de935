"""Pulleys of the simulated machine against MuJoCo's own wrapping, and against the kinematics of the controllers."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.platforms import platform_pose

from cspr_drivers.errors import ConfigurationError
from cspr_drivers.simulation.plant.cable_force import lead_over_pulleys
from cspr_drivers.simulation.plant.plant import Plant, PlantError
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_kinematics import Pose, Pulleys, Robot, inverse_kinematics

CONFIG = Path(__file__).parents[4] / "config"
RADIUS = 0.05
TILTED_AXES = np.array([[0.1 * (-1) ** i, 0.05 * i, 1.0] for i in range(8)])
# The last one is above the frame, where the cables are wrapped by less than a right angle.
PLACES = [(0.0, 0.0, 1.0), (1.1, 0.5, 0.4), (-0.9, 0.6, 1.8), (0.3, -0.4, 3.6)]


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.from_yaml(CONFIG / "robot.yaml")


def departures(robot: Robot, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Where the simulated cables leave their pulleys, and how much lies on these."""
    m = robot.number_of_cables
    x, y, z, w = pose.quaternion
    points, wrapped = robot.exit_points.copy(), np.zeros(m)
    fault = lead_over_pulleys(
        robot.exit_points,
        robot.anchor_points,
        robot.pulleys.radii(m),
        robot.pulleys.axes(m),
        np.concatenate((pose.position, 1.3 * np.array([w, x, y, z]))),  # integration changes its norm
        points,
        wrapped,
    )
    assert fault == -1
    return points, wrapped


def wrapped_tendon(exit_point: np.ndarray, axis: np.ndarray, anchor: np.ndarray, radius: float) -> float:
    """Length from exit point to anchor point of a MuJoCo tendon around a cylinder that stands in their plane."""
    across = anchor - exit_point - (anchor - exit_point) @ axis * axis
    across /= np.linalg.norm(across)
    center = exit_point + radius * across
    hub = np.cross(axis, across)
    below = exit_point - axis
    side = center + 3.0 * radius * axis

    def row(*values: float) -> str:
        return " ".join(repr(float(value)) for value in values)

    model = mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <worldbody>
    <geom name="pulley" type="cylinder" size="{row(radius, 0.01)}" pos="{row(*center)}" zaxis="{row(*hub)}"/>
    <site name="below" pos="{row(*below)}"/><site name="side" pos="{row(*side)}"/>
    <body pos="{row(*anchor)}"><freejoint/><geom size="0.001" mass="1"/><site name="anchor"/></body>
  </worldbody>
  <tendon><spatial><site site="below"/><geom geom="pulley" sidesite="side"/><site site="anchor"/></spatial></tendon>
</mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return float(data.ten_length[0]) - 1.0  # the metre below the exit point


@pytest.mark.parametrize("axes", [np.array([0.0, 0.0, 1.0]), TILTED_AXES], ids=["upright", "tilted"])
@pytest.mark.parametrize("place", PLACES)
def test_lengths_are_those_of_a_tendon_around_a_cylinder(
    robot: Robot, place: tuple, axes: np.ndarray
) -> None:
    robot = robot.with_geometry(pulleys=Pulleys(RADIUS, axes))
    pose = Pose.from_euler(place, 0.2, -0.1, 0.15)
    points, wrapped = departures(robot, pose)
    anchors = pose.position + robot.anchor_points @ pose.rotation.T
    lengths = wrapped + np.linalg.norm(anchors - points, axis=1)
    expected = [
        wrapped_tendon(a, k, b, RADIUS)
        for a, k, b in zip(robot.exit_points, robot.pulleys.axes(8), anchors, strict=True)
    ]
    np.testing.assert_allclose(lengths, expected, atol=1e-9)


@pytest.mark.parametrize("axes", [np.array([0.0, 0.0, 1.0]), TILTED_AXES], ids=["upright", "tilted"])
@pytest.mark.parametrize("place", PLACES)
def test_cables_run_as_the_controllers_say(robot: Robot, place: tuple, axes: np.ndarray) -> None:
    radii = np.array([0.0, 0.03, 0.05, 0.08, 0.05, 0.0, 0.1, 0.05])
    robot = robot.with_geometry(pulleys=Pulleys(radii, axes))
    pose = Pose.from_euler(place, 0.2, -0.1, 0.15)
    points, wrapped = departures(robot, pose)
    cables = inverse_kinematics(robot, pose)
    tangents = points - pose.position - cables.arms
    np.testing.assert_allclose(wrapped, cables.lengths - cables.free_lengths, atol=1e-12)
    np.testing.assert_allclose(tangents, cables.free_lengths[:, None] * cables.directions, atol=1e-12)


def test_the_platform_hangs_where_the_pulleys_lead_the_cables(robot: Robot) -> None:
    """Rates of length and directions of pull belong to each other: the cables' power is the platform's."""
    config = SimulationConfig.from_yaml(CONFIG / "simulation.yaml")
    home = Pose.from_euler([0.9, -0.4, 1.6], 0.1, 0.05, -0.1)
    robot = config.robot.with_geometry(pulleys=Pulleys(RADIUS, TILTED_AXES), home=home)
    plant = Plant(dataclasses.replace(config, robot=robot))
    plant.advance(2.0)
    np.testing.assert_allclose(plant.platform_position(), home.position, atol=5e-6)
    np.testing.assert_allclose(platform_pose(plant).rotation, home.rotation, atol=5e-5)


def test_an_anchor_point_inside_a_pulley_ends_the_simulation(robot: Robot) -> None:
    config = SimulationConfig.from_yaml(CONFIG / "simulation.yaml")
    radii = np.full(8, RADIUS)
    radii[2] = 1.6  # clear of the anchor point at home, not for long
    plant = Plant(dataclasses.replace(config, robot=config.robot.with_geometry(pulleys=Pulleys(radii))))
    plant.set_torque(2, -10.0)
    for index in range(8):
        plant.set_brake(index, closed=False)
    with pytest.raises(PlantError, match="cable 3"):
        plant.advance(5.0)


def write_simulation(directory: Path, pulleys: str) -> Path:
    """A simulation file with these pulleys, beside the two robots that are shipped."""
    for name in ("robot.yaml", "robot_pulleys.yaml"):
        (directory / name).write_bytes((CONFIG / name).read_bytes())
    text = (CONFIG / "simulation.yaml").read_text(encoding="utf-8")
    assert "# pulleys: {radius: 0.05}" in text
    file = directory / "simulation.yaml"
    file.write_text(text.replace("# pulleys: {radius: 0.05}", pulleys), encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("pulleys", "radii", "axis"),
    [
        ("", np.zeros(8), [0.0, 0.0, 1.0]),
        ("pulleys: {radius: 0.05}", np.full(8, 0.05), [0.0, 0.0, 1.0]),
        (
            "pulleys: {radius: [0.05, 0, 0, 0, 0, 0, 0, 0.06], swivel_axis: [0, 0, -2]}",
            [0.05, 0, 0, 0, 0, 0, 0, 0.06],
            [0, 0, -1],
        ),
    ],
)
def test_true_pulleys_may_differ_from_what_the_controllers_believe(
    tmp_path: Path, pulleys: str, radii: np.ndarray, axis: list[float]
) -> None:
    config = SimulationConfig.from_yaml(write_simulation(tmp_path, pulleys))
    np.testing.assert_array_equal(config.robot.pulleys.radii(8), radii)
    np.testing.assert_array_equal(config.robot.pulleys.axes(8), np.tile(axis, (8, 1)))
    at_home = inverse_kinematics(config.robot, config.robot.home).lengths
    np.testing.assert_allclose(config.robot.winch.home_lengths, at_home, atol=1e-12)


def test_pulleys_of_the_robot_file_are_the_true_ones_too(tmp_path: Path) -> None:
    file = write_simulation(tmp_path, "")
    file.write_text(file.read_text().replace("robot: robot.yaml", "robot: robot_pulleys.yaml"))
    assert SimulationConfig.from_yaml(file).robot.pulleys.radius == RADIUS


def test_pulleys_in_which_home_lies_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match=r"simulation\.yaml.*cable \d"):
        SimulationConfig.from_yaml(write_simulation(tmp_path, "pulleys: {radius: 3.0}"))
