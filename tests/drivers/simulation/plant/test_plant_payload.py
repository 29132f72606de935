"""What the simulated machine carries: against statics written down once more, and against the momentum of a mass."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import root
from scipy.spatial.transform import Rotation
from tests.platforms import platform_pose

from cspr_drivers.simulation.plant.plant import Plant
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_kinematics import Payload

CONFIG = Path(__file__).parents[4] / "config" / "simulation.yaml"
GRAVITY = 9.81
CENTER = np.array([0.05, -0.03, -0.2])


@pytest.fixture(scope="module")
def config() -> SimulationConfig:
    """Return the machine as it ships, but with weightless cables: their weight is tested where it is computed."""
    shipped = SimulationConfig.from_yaml(CONFIG)
    return replace(shipped, cables=replace(shipped.cables, mass_per_metre=0.0))


class Statics:
    """The machine with straight elastic cables on shafts that do not turn."""

    def __init__(self, config: SimulationConfig) -> None:
        self.config = config
        self.exits, self.anchors = config.robot.exit_points, config.robot.anchor_points
        chords, arms = self.chords(config.robot.home.position, np.zeros(3))
        lengths = np.linalg.norm(chords, axis=1)
        # Homed empty, and of all tensions that hold the platform those of least effort: none is near its limits.
        structure = self.structure(chords, arms)
        platform = config.robot.platform
        tension = np.linalg.lstsq(
            structure, -self.weight(platform.mass, platform.center_of_mass), rcond=None
        )[0]
        assert (tension > config.robot.tension_min).all()
        assert (tension < config.robot.tension_max).all()
        dead = config.cables.dead_length
        self.free = (lengths + dead) / (1.0 + tension / config.cables.axial_stiffness)  # from drum to anchor

    def chords(self, position: np.ndarray, turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        arms = self.anchors @ Rotation.from_rotvec(turn).as_matrix().T
        return self.exits - position - arms, arms

    @staticmethod
    def structure(chords: np.ndarray, arms: np.ndarray) -> np.ndarray:
        directions = chords / np.linalg.norm(chords, axis=1)[:, None]
        return np.vstack((directions.T, np.cross(arms, directions).T))

    @staticmethod
    def weight(mass: float, center: np.ndarray) -> np.ndarray:
        force = np.array([0.0, 0.0, -mass * GRAVITY])
        return np.concatenate((force, np.cross(center, force)))

    def balance(self, place: np.ndarray, payload: Payload) -> np.ndarray:
        chords, arms = self.chords(place[:3], place[3:])
        stretch = np.linalg.norm(chords, axis=1) + self.config.cables.dead_length - self.free
        tension = np.maximum(0.0, self.config.cables.axial_stiffness * stretch / self.free)
        turned = Rotation.from_rotvec(place[3:]).as_matrix()
        wrench = self.structure(chords, arms) @ tension
        for body in (self.config.robot.platform, payload):
            wrench += self.weight(body.mass, turned @ body.center_of_mass)
        return wrench

    def rest(self, payload: Payload) -> np.ndarray:
        guess = np.concatenate((self.config.robot.home.position, np.zeros(3)))
        found = root(self.balance, guess, args=(payload,), tol=1e-13)
        assert np.abs(self.balance(found.x, payload)).max() < 1e-5
        return np.asarray(found.x)


def turn_of(plant: Plant) -> np.ndarray:
    return Rotation.from_quat(platform_pose(plant).quaternion).as_rotvec()


@pytest.mark.parametrize("mass", [0.0, 100.0, 200.0])
def test_homed_empty_it_hangs_lower_by_the_stretch_of_its_cables(
    config: SimulationConfig, mass: float
) -> None:
    payload = Payload(mass, CENTER)
    plant = Plant(config.with_payload(payload))
    rest = Statics(config).rest(payload)
    np.testing.assert_allclose(plant.platform_position(), rest[:3], atol=1e-8)
    np.testing.assert_allclose(turn_of(plant), rest[3:], atol=1e-8)
    np.testing.assert_array_equal(plant.motor_angles(), 0.0)
    sunk = config.robot.home.position[2] - plant.platform_position()[2]
    assert sunk == pytest.approx(1.54e-3 * mass / 100.0, rel=0.01, abs=1e-9)


def test_a_payload_that_was_there_from_the_start_hangs_where_one_hangs_that_came_later(
    config: SimulationConfig,
) -> None:
    payload = Payload(150.0, CENTER)
    plant = Plant(config)
    plant.set_payload(payload)
    plant.advance(5.0)
    aboard = Plant(config.with_payload(payload))
    np.testing.assert_allclose(plant.platform_position(), aboard.platform_position(), atol=5e-6)


def test_a_payload_grows_evenly_and_ends_as_it_is(config: SimulationConfig) -> None:
    """Grown slowly the platform sinks with it, and hardly bounces; its moment of mass grows as evenly as its mass."""
    before, after = Payload(50.0, np.array([0.1, 0.0, 0.0])), Payload(150.0, np.array([0.0, 0.1, -0.1]))
    plant = Plant(config.with_payload(before))
    plant.advance(0.1)
    plant.set_payload(after, duration=2.0)
    for share in (0.25, 0.5, 0.75):
        plant.advance(0.1 + 2.0 * share)
        aboard = plant.payload
        assert aboard.mass == pytest.approx(50.0 + 100.0 * share)
        expected = (1.0 - share) * 50.0 * before.center_of_mass + share * 150.0 * after.center_of_mass
        np.testing.assert_allclose(aboard.mass * aboard.center_of_mass, expected, atol=1e-9)
        np.testing.assert_allclose(plant.platform_position(), Statics(config).rest(aboard)[:3], atol=2e-5)
    plant.advance(2.1)
    assert plant.payload is after
    plant.advance(2.5)
    assert plant.payload is after


def test_the_next_change_ends_a_growth(config: SimulationConfig) -> None:
    plant = Plant(config)
    plant.set_payload(Payload(100.0, np.zeros(3)), duration=1.0)
    plant.advance(0.5)
    plant.set_payload(Payload(20.0, np.zeros(3)))
    plant.advance(2.0)
    assert plant.payload.mass == 20.0
