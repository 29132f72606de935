"""A payload on a sling: a pendulum on an elastic string, and a load that a table carries until it is lifted."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from cspr_drivers.simulation.plant.plant import Plant, PlantError
from cspr_drivers.simulation.simulation_config import PayloadChange, SimulationConfig, Sling
from cspr_kinematics import Payload

CONFIG = Path(__file__).parents[4] / "config" / "simulation.yaml"
GRAVITY = 9.81
HOOK = np.array([0.0, 0.0, -0.11])
LOAD = Payload(100.0, HOOK)
SLING = Sling(length=0.5, stiffness=60e3)


@pytest.fixture(scope="module")
def config() -> SimulationConfig:
    return SimulationConfig.from_yaml(CONFIG)


def test_at_rest_it_pulls_as_a_payload_without_a_sling_does(config: SimulationConfig) -> None:
    plant, rigid = Plant(config.with_payload(LOAD, sling=SLING)), Plant(config.with_payload(LOAD))
    np.testing.assert_allclose(plant.platform_position(), rigid.platform_position(), atol=1e-8)
    np.testing.assert_allclose(plant.tensions(), rigid.tensions(), atol=1e-3)
    plant.advance(2.0)
    np.testing.assert_allclose(plant.platform_position(), rigid.platform_position(), atol=2e-6)
    hang = plant.platform_position() + HOOK - plant.load_position()
    np.testing.assert_allclose(hang, [0.0, 0.0, 0.5 + LOAD.mass * GRAVITY / SLING.stiffness], atol=1e-5)
    assert plant.payload.mass == pytest.approx(LOAD.mass)


@pytest.mark.parametrize("axis", [0, 1])
def test_it_swings_as_a_pendulum_does(config: SimulationConfig, axis: int) -> None:
    """5 degrees: 2 pi sqrt(l / g) (1 + a^2 / 16), of a mass whose hook hardly moves; nothing damps it."""
    angle = np.radians(5.0)
    deflection = (angle, 0.0) if axis == 0 else (0.0, angle)
    plant = Plant(config.with_payload(LOAD, sling=dataclasses.replace(SLING, deflection=deflection)))
    times, swings = np.arange(0.0, 5.0, 2e-3), []
    for time in times:
        plant.advance(time)
        swings.append(plant.load_position() - plant.platform_position() - HOOK)
    swing = np.array(swings)
    length = 0.5 + LOAD.mass * GRAVITY / SLING.stiffness
    assert swing[0, axis] == pytest.approx(length * np.sin(angle), abs=2e-4)
    assert np.abs(swing[:, 1 - axis]).max() < 1e-3
    along = swing[:, axis]
    crossings = times[:-1][(along[:-1] > 0.0) & (along[1:] <= 0.0)]
    period = float(np.diff(crossings).mean())
    assert period == pytest.approx(
        2.0 * np.pi * np.sqrt(length / GRAVITY) * (1.0 + angle**2 / 16.0), rel=0.005
    )
    assert along[-1000:].max() == pytest.approx(along[0], rel=0.02)


def test_it_bounces_on_its_sling_and_loses_energy_only_by_its_damping(config: SimulationConfig) -> None:
    """Made heavier with a jerk; on a platform that hardly gives, the frequency is that of a mass on a spring."""
    stiff = dataclasses.replace(config.cables, axial_stiffness=1e8)
    soft = Sling(length=0.5, stiffness=10e3)
    ends = {}
    for damping in (0.0, 0.005):
        sling = dataclasses.replace(soft, damping_time=damping)
        plant = Plant(
            dataclasses.replace(config, cables=stiff, time_step=2e-4).with_payload(
                Payload(99.0, HOOK), sling=sling
            )
        )
        plant.set_payload(Payload(110.0, HOOK), sling=sling)
        heights = []
        for time in np.arange(0.0, 3.0, 1e-3):
            plant.advance(time)
            heights.append(plant.load_position()[2])
        height = np.array(heights) - np.mean(heights)
        ends[damping] = np.ptp(height[-700:]) / np.ptp(height[:700])
        if damping == 0.0:
            crossings = np.flatnonzero((height[:-1] < 0.0) & (height[1:] >= 0.0)) * 1e-3
            assert 1.0 / np.diff(crossings).mean() == pytest.approx(
                np.sqrt(10e3 / 110.0) / (2.0 * np.pi), rel=0.01
            )
    assert ends[0.0] == pytest.approx(1.0, abs=0.03)
    # amplitude falls by exp(-w^2 d t / 2), over some 2.3 s between the middles of the two windows
    assert ends[0.005] == pytest.approx(np.exp(-10e3 / 110.0 * 0.005 * 2.3 / 2.0), abs=0.05)


def test_a_table_carries_it_until_it_is_lifted(config: SimulationConfig) -> None:
    table = 1.0 + HOOK[2] - 0.48  # 20 mm less than the sling is long
    plant = Plant(dataclasses.replace(config, table_height=table).with_payload(LOAD, sling=SLING))
    empty = Plant(config)
    plant.advance(1.0)
    np.testing.assert_allclose(plant.tensions(), empty.tensions(), atol=0.05)
    assert plant.payload.mass == pytest.approx(0.0, abs=0.1)
    assert plant.load_position()[2] == pytest.approx(table, abs=1e-3)
    aboard = []
    for _ in range(120):  # all cables are wound in slowly
        for index in range(config.robot.number_of_cables):
            plant.slip_cable(index, -0.0005)
        plant.advance(plant.time + 0.05)
        aboard.append(plant.payload.mass)
    assert plant.load_position()[2] > table + 0.02
    plant.advance(plant.time + 2.0)
    assert plant.payload.mass == pytest.approx(LOAD.mass, abs=0.1)
    # 100 kg over 60 kN/m and the cables: some 20 mm of lift in which the table gives the load away
    assert sum(1.0 < mass < 99.0 for mass in aboard) >= 5
    np.testing.assert_array_equal(plant.payload.center_of_mass, HOOK)


def test_it_comes_aboard_with_the_platform_and_leaves_it(config: SimulationConfig) -> None:
    change = PayloadChange(1.0, LOAD, 0.0, SLING)
    plant = Plant(config.with_payload(Payload.none(), change))
    before = plant.tensions()
    plant.advance(0.5)
    np.testing.assert_allclose(plant.tensions(), before, atol=1e-3)
    plant.set_payload(LOAD, sling=SLING)
    plant.advance(4.0)
    assert plant.payload.mass == pytest.approx(100.0, abs=0.5)
    plant.set_payload(Payload(40.0, np.zeros(3)))
    plant.advance(8.0)
    np.testing.assert_allclose(
        plant.tensions(), Plant(config.with_payload(Payload(40.0, np.zeros(3)))).tensions(), atol=1.0
    )
    assert plant.payload.mass == 40.0


def test_a_machine_without_slings_refuses_one(config: SimulationConfig) -> None:
    with pytest.raises(PlantError, match="without a sling"):
        Plant(config).set_payload(LOAD, sling=SLING)
