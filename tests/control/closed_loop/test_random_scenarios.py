"""Any device fault at any moment of any trajectory with any load: the robot ends held. `make soak` draws many."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from cspr_control.closed_loop.run import closed_loop
from cspr_control.closed_loop.scenario import FAULTS, Scenario
from cspr_control.reference.catalogue import make_trajectory
from cspr_msgs_py.vocabulary import Controller, RobotState, TrajectoryName

CONFIG = Path(__file__).parents[3] / "config"
DRAWN = sorted(set(FAULTS) - {"brake_weak"})  # a brake that slips does not hold, whatever the supervisor does
MOVING = [name for name in TrajectoryName if name is not TrajectoryName.HOLD]
REACTION = 4.0  # s in which a fault has been noticed, if it does any harm


@pytest.fixture
def drawn(seed: int) -> tuple[Scenario, str, float]:
    """Draw a scenario, a fault, and its time, s after the start of the trajectory."""
    random = np.random.default_rng(seed)
    name = str(random.choice(DRAWN))
    place = re.sub("K$", lambda _: str(random.integers(1, 9)), FAULTS[name][0]).replace(
        "a bus of can.yaml", "main"
    )
    scenario = Scenario(
        controller=Controller(random.choice([c.value for c in Controller])),
        trajectory=TrajectoryName(random.choice([name.value for name in MOVING])),
        payload=float(random.uniform(0.0, 200.0)),
        config=CONFIG,
        seed=int(random.integers(2**31)),
    )
    return scenario, f"{name} {place}", float(random.uniform(0.0, 8.0))


def test_it_ends_held(drawn: tuple[Scenario, str, float]) -> None:
    scenario, fault, moment = drawn
    loop = closed_loop(scenario)
    machine, settings = loop.machine, loop.settings.trajectory
    try:
        loop.begin()
        loop.enable()
        loop.time.wait(1.0)
        loop.play(lambda here: make_trajectory(scenario.trajectory, loop.robot, here, settings))
        loop.time.wait(moment)
        assert loop.state is RobotState.ENABLED, (drawn, loop.cause)
        machine.faults.inject(machine.faults.read(fault))
        loop.time.wait_until(lambda: loop.state is RobotState.FAULT, REACTION)
        if loop.state is RobotState.ENABLED:  # a fault that harms nobody
            assert loop.order("/supervisor/stop").accepted, drawn
        over = (RobotState.DISABLED, RobotState.FAULT)
        loop.time.wait_until(lambda: loop.state in over, 10.0)
        loop.time.wait(1.0)
        assert loop.state in over, (drawn, loop.state, loop.cause)
        assert loop.cause or loop.state is RobotState.DISABLED
        assert not any(device.automaton.brake_open for device in machine.devices), (drawn, loop.cause)
        assert np.abs(machine.plant.motor_speeds()).max() < 0.1, (drawn, loop.cause)
        assert np.isfinite(machine.plant.platform_position()).all()
    finally:
        machine.close()
