"""Loads on slings in closed loop, on the independent plant: they stop swinging, and others are left alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco")

from cspr_control.closed_loop.loop import ClosedLoop
from cspr_control.closed_loop.run import closed_loop, run
from cspr_control.closed_loop.scenario import Scenario
from cspr_drivers.simulation.simulation_config import Sling
from cspr_kinematics import Payload
from cspr_msgs_py.topics import MOTOR_STATES, SETPOINT
from cspr_msgs_py.vocabulary import RobotState, TrajectoryName

CONFIG = Path(__file__).parents[3] / "config"
DAMPED = {"feedforward": {"swing_damping": 0.35}}
EMPTY = Scenario(config=CONFIG, devices=False, payload=0.0, added=(), parameters=DAMPED)
DEGREE = np.radians(1.0)


class Swinging:
    """A robot under torque to which a load on a sling comes, out of plumb, and what becomes of both.

    Attributes
    ----------
    begin
        Stamp at which it came aboard, ns.
    """

    def __init__(self, mass: float, length: float, degrees: tuple[float, float], **changes: Any) -> None:
        x, y = np.radians(degrees)
        sling = Sling(length, 60e3, deflection=(x, y))
        scenario = dataclasses.replace(EMPTY, sling=sling, **changes)
        self.loop: ClosedLoop[Any] = closed_loop(scenario)
        self._swing = self.loop.graph.components["feedforward"].swing
        self._rows: list[tuple[float, ...]] = []
        self.loop.begin()
        self.loop.enable()
        self.loop.time.wait(0.5)
        self.begin = self.loop.time.system_ns()
        self.loop.machine.change_payload(Payload(mass, np.zeros(3)), self.begin, sling=sling)
        self.loop.listeners.append(self._listen)

    def _listen(self, topic: Any, sample: Any) -> None:
        if topic is MOTOR_STATES:
            plant = self.loop.machine.plant
            hangs = plant.load_position() - plant.platform_position()
            angle = float(np.arctan2(np.hypot(hangs[0], hangs[1]), -hangs[2]))
            self._rows.append((sample.stamp_ns, angle, abs(self._swing.offset.position)))

    def wait(self, duration: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return times since the load came, s, its angles, rad, and offsets, m, of a while, s."""
        self._rows.clear()
        self.loop.time.wait(duration)
        assert not self.loop.cause
        stamps, angles, offsets = np.array(self._rows).T
        return (stamps - self.begin) * 1e-9, angles, offsets


@pytest.mark.parametrize("mass", [100.0, 200.0])
@pytest.mark.parametrize("degrees", [(5.0, 0.0), (0.0, -5.0)])
def test_five_degrees_are_a_fifth_within_three_seconds(mass: float, degrees: tuple[float, float]) -> None:
    time, angles, offsets = Swinging(mass, 0.5, degrees).wait(4.5)
    assert angles[time < 0.5].max() > 4.9 * DEGREE
    assert angles[time > 3.0].max() < 1.0 * DEGREE
    assert 0.01 < offsets.max() < 0.04


def test_devices_and_buses_make_no_difference() -> None:
    time, angles, _ = Swinging(200.0, 0.5, (3.0, 4.0), devices=True).wait(3.5)
    assert angles[time > 3.0].max() < 1.0 * DEGREE


@pytest.mark.parametrize(("length", "within"), [(0.2, 3.0), (0.3, 3.0), (0.8, 5.0), (1.5, 8.0)])
def test_short_and_long_slings(length: float, within: float) -> None:
    """A long one moves its load by more than the platform may move."""
    swinging = Swinging(200.0, length, (5.0, 0.0), table_height=-2.0)
    time, angles, offsets = swinging.wait(within + 0.5)
    assert angles[time > within].max() < 1.0 * DEGREE
    assert offsets.max() < 0.04


def test_without_damping_it_swings_on() -> None:
    _, angles, offsets = Swinging(200.0, 0.5, (5.0, 0.0), parameters={}).wait(4.0)
    assert angles[-200:].max() > 4.9 * DEGREE
    assert not offsets.any()


@pytest.mark.parametrize("trajectory", [TrajectoryName.SMOOTH_19, TrajectoryName.PAPER_19])
def test_a_rigid_load_is_moved_as_without_damping(trajectory: TrajectoryName) -> None:
    rigid = dataclasses.replace(EMPTY, payload=200.0, trajectory=trajectory, duration=4.0)
    damped, plain = (
        run(dataclasses.replace(rigid, parameters=parameters), keep=True).published
        for parameters in (DAMPED, {})
    )
    for name in ("position", "velocity", "effort"):
        one, other = (getattr(each.joint_states(SETPOINT.name), name) for each in (damped, plain))
        np.testing.assert_array_equal(one, other)


def test_while_the_estimate_is_held_the_offset_goes() -> None:
    swinging = Swinging(200.0, 0.5, (8.0, 0.0))
    assert swinging.wait(1.6)[2][-1] > 0.01
    estimator = swinging.loop.graph.components["mass_estimator"].estimator
    settings = estimator.settings
    nothing_is_calm = dataclasses.replace(settings.motion, max_acceleration=0.0)
    estimator.configure(dataclasses.replace(settings, motion=nothing_is_calm))
    swinging.loop.time.wait(0.1)
    offsets = np.abs(np.diff(swinging.wait(0.3)[2]))
    assert estimator.newest.held is not None
    assert offsets.max() < 4e-4  # 0.1 m/s


def test_the_brakes_close_when_the_offset_has_come_to_rest() -> None:
    swinging = Swinging(200.0, 0.5, (8.0, 0.0))
    swinging.wait(1.5)
    loop, speeds = swinging.loop, []
    assert abs(loop.graph.components["feedforward"].swing.offset.velocity) > 0.03
    loop.listeners.append(lambda topic, sample: speeds.append(sample) if topic is MOTOR_STATES else None)
    assert loop.order("/supervisor/stop").accepted
    began = loop.time.monotonic()
    loop.wait_for(RobotState.DISABLED, 2.0)
    assert loop.time.monotonic() - began > 0.1
    assert loop.graph.components["feedforward"].swing.offset.position == 0.0
    stands = loop.machine.plant.platform_position()
    loop.time.wait(0.5)
    np.testing.assert_allclose(loop.machine.plant.platform_position(), stands, atol=2e-3)
