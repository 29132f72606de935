"""The simulated machine against statics, energy and the properties of a cable, none of them taken from its code."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import mujoco
import numpy as np
import pytest
from tests.platforms import platform_pose

from cspr_drivers.errors import ConfigurationError
from cspr_drivers.simulation.plant.plant import Plant, PlantError
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_kinematics import Payload, Pulleys, inverse_kinematics

CONFIG = Path(__file__).parents[4] / "config" / "simulation.yaml"
GRAVITY = 9.81


@pytest.fixture(scope="module", params=[0.0, 0.05], ids=["fixed", "pulleys"])
def config(request: pytest.FixtureRequest) -> SimulationConfig:
    config = SimulationConfig.from_yaml(CONFIG)
    weightless = dataclasses.replace(config.cables, mass_per_metre=0.0)
    robot = config.robot.with_geometry(pulleys=Pulleys(request.param))
    return dataclasses.replace(config, robot=robot, cables=weightless)


def carrying(config: SimulationConfig, mass: float) -> SimulationConfig:
    return config.with_payload(Payload(mass, np.zeros(3)))


def cable_force(plant: Plant, config: SimulationConfig) -> np.ndarray:
    """Force of the cables on the platform, from where MuJoCo has put it."""
    return (inverse_kinematics(config.robot, platform_pose(plant)).wrench_matrix @ plant.tensions())[:3]


def open_brakes(plant: Plant, config: SimulationConfig) -> None:
    for index in range(config.robot.number_of_cables):
        plant.set_brake(index, closed=False)


def test_hangs_still_on_closed_brakes(config: SimulationConfig) -> None:
    plant = Plant(carrying(config, 100.0))
    position = plant.platform_position()
    plant.advance(2.0)
    np.testing.assert_allclose(plant.platform_position(), position, atol=2e-6)
    np.testing.assert_allclose(plant.motor_angles(), 0.0, atol=5e-4)
    weight = (config.robot.platform.mass + 100.0) * GRAVITY
    np.testing.assert_allclose(cable_force(plant, config), [0.0, 0.0, weight], atol=0.5)


def test_cables_carry_a_payload_that_is_added(config: SimulationConfig) -> None:
    plant = Plant(carrying(config, 0.0))
    plant.advance(0.1)
    plant.set_payload(Payload(200.0, np.array([0.02, 0.0, -0.1])))
    plant.advance(6.0)
    weight = (config.robot.platform.mass + 200.0) * GRAVITY
    np.testing.assert_allclose(cable_force(plant, config), [0.0, 0.0, weight], atol=3.0)
    assert plant.platform_position()[2] < config.robot.home.position[2] - 1e-4  # cables are elastic


def test_motor_torque_of_the_static_tensions_holds_the_platform(config: SimulationConfig) -> None:
    plant = Plant(carrying(config, 50.0))
    position, tensions = plant.platform_position(), plant.tensions()
    for index, tension in enumerate(tensions):
        plant.set_torque(index, -0.05 / 30.0 * tension)
    open_brakes(plant, config)
    plant.advance(1.0)
    np.testing.assert_allclose(plant.platform_position(), position, atol=1e-5)


def test_tensions_belong_to_the_moment_of_the_angles(config: SimulationConfig) -> None:
    """In motion, a millisecond is tens of newtons."""
    plant = Plant(dataclasses.replace(config, cables=dataclasses.replace(config.cables, damping_time=0.0)))
    lengths = inverse_kinematics(config.robot, config.robot.home).lengths
    dead, stiffness = config.cables.dead_length, config.cables.axial_stiffness
    free_at_home = (lengths + dead) / (1.0 + plant.tensions() / stiffness) - dead
    open_brakes(plant, config)
    for index in range(config.robot.number_of_cables):
        plant.set_torque(index, 0.5 * (-1) ** index)
    for time in (0.0203, 0.0271, 0.031):
        plant.advance(time)
        stretched = inverse_kinematics(config.robot, platform_pose(plant)).lengths
        free = free_at_home + config.robot.winch.transmission_ratio * plant.motor_angles()
        expected = np.maximum(stiffness * (stretched - free) / (free + dead), 0.0)
        np.testing.assert_allclose(plant.tensions(), expected, atol=1e-3)


def test_positive_torque_pays_out(config: SimulationConfig) -> None:
    plant = Plant(config)
    open_brakes(plant, config)
    for index in range(config.robot.number_of_cables):
        plant.set_torque(index, 0.5)
    plant.advance(0.1)
    assert (plant.motor_angles() > 1.0).all()
    assert plant.platform_position()[2] < config.robot.home.position[2]


def test_slack_cables_do_not_push(config: SimulationConfig) -> None:
    plant = Plant(config)
    open_brakes(plant, config)
    for index in range(config.robot.number_of_cables):
        plant.set_torque(index, 10.0)  # pays out faster than the platform falls
    start = plant.platform_position()[2]
    plant.advance(0.05)
    z_slack, t_slack = plant.platform_position()[2], plant.time
    assert (plant.tensions() == 0.0).all()
    plant.advance(0.1)
    # once slack the platform is in free fall: z'' = -g between three samples
    plant_mid = plant.platform_position()[2]
    dt = plant.time - t_slack
    plant.advance(plant.time + dt)
    acceleration = (plant.platform_position()[2] - 2 * plant_mid + z_slack) / dt**2
    assert acceleration == pytest.approx(-GRAVITY, rel=1e-3)
    assert plant.platform_position()[2] < start


def test_energy_is_conserved_without_losses(config: SimulationConfig) -> None:
    """Kinetic, gravitational and elastic energy of the platform bouncing on locked winches add up to a constant."""
    lossless = dataclasses.replace(
        carrying(config, 0.0), cables=dataclasses.replace(config.cables, damping_time=0.0), time_step=1e-4
    )
    plant = Plant(lossless)
    plant.set_payload(Payload(60.0, np.zeros(3)))  # sets it bouncing
    mass = config.robot.platform.mass + 60.0
    free_lengths = inverse_kinematics(lossless.robot, lossless.robot.home).lengths
    stiffness = lossless.cables.axial_stiffness / (free_lengths + lossless.cables.dead_length)
    interval = lossless.time_step
    positions, elastic = [], []
    for step in range(1, 2000):
        plant.advance(step * interval)
        positions.append(plant.platform_position())
        # a cable of stiffness k under tension T stores T^2 / 2k
        elastic.append((plant.tensions() ** 2 / (2.0 * stiffness)).sum())
    position = np.array(positions)
    velocity = (position[2:] - position[:-2]) / (2.0 * interval)
    kinetic = 0.5 * mass * (velocity**2).sum(axis=1)
    total = kinetic + mass * GRAVITY * position[1:-1, 2] + np.array(elastic)[1:-1]
    assert np.ptp(kinetic) > 0.1  # J: it does bounce
    assert np.ptp(total) < 0.02 * np.ptp(kinetic)


def test_brakes_stop_a_fall(config: SimulationConfig) -> None:
    plant = Plant(carrying(config, 200.0))
    open_brakes(plant, config)
    plant.advance(0.05)
    for index in range(config.robot.number_of_cables):
        plant.set_brake(index, closed=True)
    plant.advance(0.5)
    held = plant.motor_angles()
    plant.advance(1.5)
    assert np.abs(plant.motor_angles() - held).max() < 1e-3


@pytest.mark.parametrize(("share", "slips"), [(1.0, False), (0.05, True)])
def test_a_brake_slips_when_the_load_is_beyond_its_torque(config, share, slips) -> None:
    """A cable's tension times drum radius over gear ratio against the holding torque of 12 N m or 0.6 N m."""
    plant = Plant(carrying(config, 200.0))
    load = config.robot.winch.transmission_ratio * plant.tensions()[0]
    assert 0.6 + config.robot.motor.coulomb_friction < load < 12.0
    plant.weaken_brake(0, share)
    plant.set_brake(0, closed=True)
    plant.advance(0.2)
    assert bool(plant.motor_angles()[0] > 0.5) is slips
    assert np.abs(plant.motor_angles()[1:]).max() < 1e-3


def test_a_brake_slips_at_its_holding_torque(config) -> None:
    """The motor pulls against its own brake with the 10 N m that it has."""
    turned = {}
    for holding in (8.0, 12.0):
        brake = dataclasses.replace(config.brake, holding_torque=holding)
        plant = Plant(dataclasses.replace(carrying(config, 0.0), brake=brake))
        plant.set_torque(0, 10.0)
        plant.advance(0.1)
        turned[holding] = plant.motor_angles()[0]
    assert turned[8.0] > 0.5
    assert abs(turned[12.0]) < 1e-3


def test_a_cable_that_slips_on_its_drum_goes_slack(config) -> None:
    plant = Plant(carrying(config, 0.0))
    plant.slip_cable(0, 0.05)
    plant.advance(0.2)
    assert plant.tensions()[0] == 0.0
    plant.slip_cable(0, -0.05)
    plant.advance(0.5)
    assert plant.tensions()[0] > 100.0


def test_a_platform_that_is_caught_stays_whatever_pulls_at_it(config) -> None:
    plant = Plant(carrying(config, 0.0))
    plant.advance(0.2)
    before = plant.platform_position()
    plant.catch_platform(True)
    plant.slip_cable(0, -0.01)
    plant.advance(0.7)
    caught = plant.platform_position()
    assert np.linalg.norm(caught - before) < 1e-3
    assert plant.tensions().max() > 1500.0  # 10 mm of 1.2 MN over some 5 m, and some of it turns the platform
    plant.catch_platform(False)
    plant.advance(1.2)
    assert np.linalg.norm(plant.platform_position() - before) > 2e-3


def test_the_pose_is_that_of_the_moment_and_not_of_the_step_before(config) -> None:
    """In free fall, turned by one cable that still pulls: MuJoCo's own frames, brought up to date, say the same."""
    plant = Plant(carrying(config, 100.0))
    open_brakes(plant, config)
    plant.set_torque(0, -8.0)
    plant.advance(0.3)
    before = platform_pose(plant)
    plant.advance(0.302)
    pose = platform_pose(plant)
    assert np.linalg.norm(pose.position - before.position) > 5e-4
    mujoco.mj_kinematics(plant._model, plant._data)
    body = plant._data.body("platform")
    np.testing.assert_allclose(pose.position, body.xpos, atol=1e-12)
    np.testing.assert_allclose(pose.rotation, body.xmat.reshape(3, 3), atol=1e-9)


def test_torque_is_limited_to_the_motor(config: SimulationConfig) -> None:
    plant = Plant(config)
    plant.set_torque(0, -1e3)
    plant.advance(0.01)
    assert plant.motor_torques()[0] == -config.robot.motor.torque_limit


def test_damping_slows_a_motor(config: SimulationConfig) -> None:
    speeds = []
    for gain in (0.0, 0.2):
        plant = Plant(config)
        open_brakes(plant, config)
        for index in range(config.robot.number_of_cables):
            plant.set_damping(index, gain)
        plant.advance(0.1)
        speeds.append(plant.motor_speeds().mean())
    assert speeds[1] < 0.5 * speeds[0]


def test_a_payload_beyond_the_cables_is_refused(config: SimulationConfig) -> None:
    with pytest.raises(PlantError, match="3000 kg"):
        Plant(carrying(config, 3000.0))


@pytest.mark.parametrize(
    ("key", "old", "new", "message"),
    [
        ("load_cells.noise_std", "noise_std: 2.0", "noise_std: -1.0", "noise_std"),
        ("cables.axial_stiffness", "axial_stiffness: 1200000.0", "axial_stiffness: .nan", "axial_stiffness"),
        ("time_step", "time_step: 0.002", "time_step: 0.02", "time_step"),
        ("payload.mass", "mass: 0.0  # kg", "mass: -5.0", "payload.mass"),
        (
            "payload_changes.duration",
            "payload_changes: []",
            "payload_changes: [{time: 1, mass: 1, center_of_mass: [0, 0, 0], duration: -1}]",
            r"payload_changes\[0\].duration = -1",
        ),
        (
            "cables.mass_per_metre",
            "mass_per_metre: 0.16",
            "mass_per_metre: -0.1",
            "cables.mass_per_metre = -0.1",
        ),
        (
            "cables.pulley_friction",
            "pulley_friction: 0.0",
            "pulley_friction: 0.6",
            "cables.pulley_friction = 0.6",
        ),
        (
            "drive.no_load_speed_ratio",
            "no_load_speed_ratio: 1.1",
            "no_load_speed_ratio: 1.0",
            "drive.no_load_speed_ratio = 1.0",
        ),
        ("table_height", "table_height: 0.0", "table_height: high", "table_height"),
        ("sling.length", "# sling: {length: 0.5", "sling: {length: 0.0", "payload.sling.length = 0.0"),
        (
            "sling.stiffness",
            "# sling: {length: 0.5, ",
            "sling: {length: 0.5, stifness: 1} #",
            "sling.stifness",
        ),
        (
            "sling.deflection",
            "# sling: {length: 0.5, ",
            "sling: {length: 0.5, stiffness: 1e4, deflection: [2, 0]} #",
            "deflection",
        ),
        (
            "payload_changes.sling",
            "payload_changes: []",
            "payload_changes: [{time: 1, mass: 1, center_of_mass: [0, 0, 0], sling: {length: 1}}]",
            r"payload_changes\[0\].sling.stiffness",
        ),
        (
            "payload_changes.duration",
            "payload_changes: []",
            "payload_changes: [{time: 1, mass: 1, center_of_mass: [0, 0, 0], duration: 1, "
            "sling: {length: 1, stiffness: 1e4}}]",
            r"payload_changes\[0\].duration = 1.*on a sling",
        ),
        (
            "offset",
            "offset: [0.8, ",
            "offset: [",
            "load_cells.offset = .* has 7 elements where 8 are needed, one for each cable",
        ),
        ("unknown", "seed: 1", "seed: 1\nspeed: 3", "speed"),
        ("robot", "robot: robot.yaml", "robot: absent.yaml", "absent.yaml"),
        ("pulleys.radius", "# pulleys: {radius: 0.05}", "pulleys: {radius: -0.05}", "pulleys.radius = -0.05"),
        (
            "pulleys.radius",
            "# pulleys: {radius: 0.05}",
            "pulleys: {radius: [0.1, 0.1]}",
            "true_values.pulleys.radius = .* has 2 elements where 8 are needed, one for each cable",
        ),
        ("pulleys.radius", "# pulleys: {radius: 0.05}", "pulleys: {}", "pulleys.radius"),
        ("pulleys", "# pulleys: {radius: 0.05}", "pulleys: {radius: 0.1, mass: 1.0}", "pulleys.mass"),
        (
            "pulleys.swivel_axis",
            "# pulleys: {radius: 0.05}",
            "pulleys: {radius: 0.1, swivel_axis: [0, 0, 0]}",
            "pulleys.swivel_axis",
        ),
    ],
)
def test_a_wrong_value_is_named(tmp_path: Path, key: str, old: str, new: str, message: str) -> None:
    text = CONFIG.read_text(encoding="utf-8")
    assert old in text
    file = tmp_path / "simulation.yaml"
    file.write_text(text.replace(old, new), encoding="utf-8")
    (tmp_path / "robot.yaml").write_bytes((CONFIG.parent / "robot.yaml").read_bytes())
    with pytest.raises(ConfigurationError, match=message) as error:
        SimulationConfig.from_yaml(file)
    assert str(tmp_path) in str(error.value)
