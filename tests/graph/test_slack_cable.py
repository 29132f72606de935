"""A cable that hangs really slack is wound in until the robot can be enabled, in simulated time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from cspr_control.closed_loop.run import closed_loop
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.reference.point_to_point import PointToPoint
from cspr_kinematics import Pose
from cspr_msgs_py.vocabulary import DriverState, RobotState

CONFIG = Path(__file__).parents[2] / "config"
MOTOR = 2


@pytest.fixture
def loop():
    loop = closed_loop(Scenario(payload=100.0, config=CONFIG))
    loop.begin()
    loop.time.wait(1.0)
    yield loop
    loop.machine.close()


def wind(loop, way):
    """Wind motor_3 once; return whether that was accepted, and why not."""
    decision = loop.machine.call(f"/can_drives/motor_3/wind_{way}")
    if decision.accepted:
        loop.wait_until(
            lambda: loop.machine.drives.states()[0] is DriverState.DISABLED,
            2.0,
            lambda: f"not over: {loop.machine.drives.states()}",
        )
        loop.time.wait(0.1)  # it swings
    assert loop.state is RobotState.DISABLED, loop.cause
    return decision


def test_a_cable_wound_out_is_slack_and_wound_in_taut_again(loop):
    plant, height = loop.machine.plant, loop.machine.plant.platform_position()[2]
    for _ in range(20):  # refused while it swings, and another cable is slack for a moment
        if plant.motor_angles()[MOTOR] > 25.0:
            break
        wind(loop, "out")
    assert plant.motor_angles()[MOTOR] > 25.0
    loop.time.wait(0.5)
    refused = loop.order("/supervisor/enable")
    assert not refused.accepted
    assert "cable_3 carries" in refused.message
    assert "mm too long" in refused.message
    assert "call /can_drives/motor_3/wind_in" in refused.message
    tensions = []
    loop.machine.on_tick = lambda: tensions.append(plant.tensions()[MOTOR])
    while wind(loop, "in").accepted and len(tensions) < 10_000:
        pass
    assert "cable_3 is taut" in wind(loop, "in").message
    assert max(tensions) < 600.0  # what the inertia of the winch adds to the limit of 200 N
    loop.enable()
    loop.time.wait(1.0)
    assert loop.state is RobotState.ENABLED
    assert plant.platform_position()[2] == pytest.approx(height, abs=0.005)


def test_a_blocked_winch_stops_the_robot_before_its_cable_has_to_be_wound_in(loop):
    loop.enable()
    loop.time.wait(0.5)
    loop.machine.faults.inject(loop.machine.faults.read("winch_blocked motor_3"))
    up = np.array([0.0, 0.0, 0.2])
    loop.play(lambda here: PointToPoint(here, Pose(here.position + up, here.rotation), loop.player.limits))
    loop.wait_for(RobotState.FAULT, 8.0)
    assert "motor_3 stands still" in loop.cause
    loop.time.wait(0.5)
    loop.machine.faults.clear()
    assert loop.order("/supervisor/reset").accepted
    loop.wait_for(RobotState.DISABLED, 3.0)
    loop.time.wait(0.5)
    decision = loop.order("/supervisor/enable")
    assert decision.accepted, decision.message
    loop.wait_for(RobotState.ENABLED, 3.0)
    loop.time.wait(1.0)
    assert loop.state is RobotState.ENABLED


def test_a_cable_that_is_too_tight_is_paid_out_no_further_than_to_the_limit(loop):
    plant = loop.machine.plant
    plant.set_brake(MOTOR, closed=False)
    plant.set_torque(MOTOR, -4.0)
    loop.time.wait(0.2)
    plant.set_brake(MOTOR, closed=True)
    plant.set_torque(MOTOR, 0.0)
    loop.time.wait(1.0)
    assert "brake slips: motor_3" in loop.cause  # turned by hand
    assert loop.order("/supervisor/reset").accepted
    loop.wait_for(RobotState.DISABLED, 3.0)
    loop.time.wait(0.5)
    assert plant.tensions()[MOTOR] > 1000.0
    assert "is taut" in wind(loop, "in").message
    for _ in range(5):
        if "no longer tight" in loop.machine.drives.snapshot().last_winding:
            break
        assert wind(loop, "out").accepted
    assert 50.0 < plant.tensions()[MOTOR] < 250.0


def test_meanwhile_the_robot_cannot_be_enabled_and_is_stopped_by_the_operator(loop):
    assert loop.machine.call("/can_drives/motor_3/wind_out").accepted
    loop.time.wait(0.1)
    refused = loop.order("/supervisor/enable").message
    assert refused == "refused: the drives are in state winding (motor_3 is wound out)"
    assert "one winch at a time" in loop.machine.call("/can_drives/motor_4/wind_out").message
    assert loop.order("/supervisor/stop").accepted
    loop.wait_until(
        lambda: loop.machine.drives.states()[0] is DriverState.DISABLED, 1.0, lambda: "it is not over"
    )
    assert not any(device.automaton.brake_open for device in loop.machine.devices)
    assert loop.state is RobotState.DISABLED
    assert loop.machine.drives.snapshot().last_winding.endswith("it was stopped")
