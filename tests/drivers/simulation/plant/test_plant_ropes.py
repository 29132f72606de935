"""Heavy ropes of the simulated machine against the elastic catenary; friction in pulleys and motors at their limits."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import root
from tests.platforms import platform_pose

from cspr_drivers.simulation.plant.cable_force import cable_and_motor_forces
from cspr_drivers.simulation.plant.plant import Plant
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_kinematics import Payload, Pose

CONFIG = Path(__file__).parents[4] / "config" / "simulation.yaml"
GRAVITY = 9.81
ROPE = 0.16  # kg/m


@pytest.fixture(scope="module")
def config() -> SimulationConfig:
    return SimulationConfig.from_yaml(CONFIG)


def with_ropes(config: SimulationConfig, **properties: float) -> SimulationConfig:
    cables = dataclasses.replace(config.cables, **{"mass_per_metre": ROPE, **properties})
    return dataclasses.replace(config, cables=cables)


def catenary(chord: np.ndarray, free: float, stiffness: float) -> tuple[np.ndarray, float]:
    """Force on the lower end of an elastic catenary and tension at its upper end (Irvine, equations 1.10 to 1.12).

    `chord` from the lower to the upper end, `free` the unstretched length.
    """
    span, rise, weight = float(np.hypot(*chord[:2])), float(chord[2]), ROPE * GRAVITY

    def misfit(y: np.ndarray) -> list[float]:
        across, low = np.exp(y[0]), y[1]
        high = low + weight * free
        x = across * free / stiffness + across / weight * (
            np.arcsinh(high / across) - np.arcsinh(low / across)
        )
        z = (low * free + weight * free**2 / 2.0) / stiffness
        z += (np.hypot(across, high) - np.hypot(across, low)) / weight
        return [x - span, z - rise]

    length = float(np.hypot(span, rise))
    guess = max(stiffness * (length - free) / free, 5.0)
    found = root(misfit, [np.log(guess * span / length), guess * rise / length], tol=1e-14)
    assert np.abs(found.fun).max() < 1e-9
    across, low = float(np.exp(found.x[0])), float(found.x[1])
    force = np.array([across * chord[0] / span, across * chord[1] / span, low])
    return force, float(np.hypot(across, low + weight * free))


@pytest.mark.parametrize("payload", [0.0, 200.0])
@pytest.mark.parametrize("place", [(0.0, 0.0, 1.0), (1.2, 0.6, 1.8), (1.2, 0.6, 0.4)])
def test_the_platform_hangs_in_catenaries(config: SimulationConfig, place: tuple, payload: float) -> None:
    """Cells and balance within hundredths of a newton; straight weightless cables would take 2 to 4 kg for payload."""
    robot = config.robot.with_geometry(home=Pose(np.array(place), np.eye(3)))
    config = with_ropes(dataclasses.replace(config, robot=robot), dead_length=0.0)
    plant = Plant(config.with_payload(Payload(payload, np.zeros(3))))
    pose = platform_pose(plant)
    arms = robot.anchor_points @ pose.rotation.T
    chords = robot.exit_points - pose.position - arms
    ends = [
        catenary(chord, free, config.cables.axial_stiffness)
        for chord, free in zip(chords, plant._free_lengths_at_home, strict=True)
    ]
    np.testing.assert_allclose(plant.tensions(), [tension for _, tension in ends], atol=0.03)
    forces = np.array([force for force, _ in ends])
    weights = [(robot.platform.mass, robot.platform.center_of_mass), (payload, np.zeros(3))]
    moment = np.cross(arms, forces).sum(axis=0)
    force = forces.sum(axis=0)
    for mass, center in weights:
        weight = np.array([0.0, 0.0, -mass * GRAVITY])
        force, moment = force + weight, moment + np.cross(pose.rotation @ center, weight)
    np.testing.assert_allclose(force, 0.0, atol=0.05)
    np.testing.assert_allclose(moment, 0.0, atol=0.02)
    directions = chords / np.linalg.norm(chords, axis=1)[:, None]
    seen = (directions[:, 2] @ plant.tensions()) / GRAVITY - robot.platform.mass - payload
    assert 2.3 < seen < 3.8


def test_empty_it_is_at_home(config: SimulationConfig) -> None:
    plant = Plant(with_ropes(config))
    np.testing.assert_allclose(plant.platform_position(), config.robot.home.position, atol=1e-9)


def test_a_slack_rope_hangs_through_and_pulls_by_its_weight(config: SimulationConfig) -> None:
    config = with_ropes(config, dead_length=0.0)
    plant = Plant(config)
    plant.slip_cable(0, 0.05)
    plant.advance(3.0)
    pose = platform_pose(plant)
    chord = config.robot.exit_points[0] - pose.position - pose.rotation @ config.robot.anchor_points[0]
    _, tension = catenary(chord, plant._free_lengths_at_home[0], config.cables.axial_stiffness)
    assert 5.0 < tension < 20.0
    assert plant.tensions()[0] == pytest.approx(tension, rel=0.03)


def kernel_at(speed: float, torque: float, friction: float = 0.0) -> tuple[float, float, float]:
    """Tension at the cell, torque of the drive, and pull at the platform of one taut vertical cable of 2 m."""
    one, tension, applied, control = np.ones(1), np.zeros(1), np.zeros(1), np.zeros(2)
    cable_and_motor_forces(
        2.0 * one,
        speed / 600.0 * one,  # the platform goes along with the drum
        0.0 * one,
        0.0 * one,
        speed * one,
        np.array([[0.0, 0.0, 2.0]]),
        np.zeros((1, 3)),
        np.zeros(3),
        1.999 * one,
        np.array([1.0 / 600.0, 1e6, 0.002, 0.001, 0.0, friction]),
        torque * one,
        0.0 * one,
        np.array([10.0, 450.0, 495.0]),
        tension,
        applied,
        control,
        np.zeros(6),
    )
    return float(tension[0]), float(applied[0]), -float(control[0])


def test_friction_of_a_pulley_takes_its_share_in_either_direction() -> None:
    assert kernel_at(0.0, 0.0, 0.02)[0] == pytest.approx(500.0)
    cell, _, platform = kernel_at(-100.0, 0.0, 0.02)
    assert platform == pytest.approx(500.0)
    assert platform == pytest.approx(0.98 * cell)  # wound in
    cell, _, platform = kernel_at(100.0, 0.0, 0.02)
    assert cell == pytest.approx(0.98 * platform)  # paid out
    creeping = [kernel_at(speed, 0.0, 0.02)[0] for speed in np.linspace(-2.0, 2.0, 41)]
    assert np.abs(np.diff(creeping)).max() < 2.0  # N: it does not jump where the direction changes
    assert kernel_at(100.0, 0.0)[0] == kernel_at(100.0, 0.0)[2]  # without friction


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_what_drives_a_motor_fades_beyond_its_speed_limit_and_what_brakes_it_does_not(sign: float) -> None:
    driving = {
        speed: sign * kernel_at(sign * speed, sign * 10.0)[1] for speed in (0.0, 450.0, 472.5, 495.0, 600.0)
    }
    assert driving == pytest.approx({0.0: 10.0, 450.0: 10.0, 472.5: 5.0, 495.0: 0.0, 600.0: 0.0})
    assert sign * kernel_at(sign * 472.5, sign * 2.0)[1] == pytest.approx(2.0)
    assert sign * kernel_at(sign * 600.0, -sign * 30.0)[1] == pytest.approx(-10.0)


def test_a_motor_that_runs_away_stays_below_its_no_load_speed(config: SimulationConfig) -> None:
    plant = Plant(config)
    plant.slip_cable(0, 0.5)  # slack: only the motor drives it
    plant.set_brake(0, closed=False)
    plant.set_torque(0, 10.0)
    plant.advance(0.6)
    limit = config.robot.motor.speed_limit
    assert limit < plant.motor_speeds()[0] < 1.1 * limit
    plant.set_torque(0, -10.0)
    plant.advance(0.65)
    assert plant.motor_torques()[0] == -10.0
    assert plant.motor_speeds()[0] < limit - 250.0


@pytest.mark.parametrize("rope", [0.0, ROPE])
def test_a_platform_that_falls_comes_to_rest_on_the_floor(config: SimulationConfig, rope: float) -> None:
    plant = Plant(with_ropes(config, mass_per_metre=rope).with_payload(Payload(100.0, np.zeros(3))))
    for index in range(config.robot.number_of_cables):
        plant.set_brake(index, closed=False)
        plant.set_torque(index, 5.0)
    lowest = np.inf
    while plant.time < 3.0:
        plant.advance(plant.time + 0.01)
        pose = platform_pose(plant)
        corners = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, -1).T * config.robot.platform_size
        lowest = min(lowest, float((pose.position + corners @ pose.rotation.T)[:, 2].min()))
    assert lowest > -0.03
    place = plant.platform_position()
    assert place[2] == pytest.approx(config.robot.platform_size[2] / 2.0, abs=1e-3)
    plant.advance(3.5)
    np.testing.assert_allclose(plant.platform_position(), place, atol=1e-4)
    assert plant.tensions().max() < 20.0
