"""An encoder that is wrong, slowly and at speed: how far the platform leaves its path, and what is named."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from cspr_control.closed_loop.run import closed_loop
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.reference.point_to_point import PointToPoint
from cspr_kinematics import Pose
from cspr_msgs_py.vocabulary import RobotState

CONFIG = Path(__file__).parents[2] / "config"
LEVEL, BACK, SHORT = (0.8, 0.0, 0.0), (-0.4, 0.0, 0.0), (0.08, 0.0, 0.0)


@dataclass(frozen=True)
class Departure:
    """How far the platform left its path and sank, m, from a fault until it rests; and why the robot stopped."""

    sideways: float
    sunk: float
    cause: str


@functools.cache
def departure(fault: str, speed: float, way: tuple[float, float, float]) -> Departure:
    """Move 200 kg along a straight line, let a fault happen at full speed, and see where that ends."""
    loop = closed_loop(Scenario(payload=200.0, config=CONFIG))
    plant, time = loop.machine.plant, loop.time
    try:
        loop.begin()
        time.wait(1.0)
        loop.enable()
        time.wait(0.5)
        begin = plant.platform_position()
        if speed:
            limits = replace(loop.player.limits, speed=speed, acceleration=max(0.3, 3.0 * speed**2))
            loop.play(
                lambda here: PointToPoint(here, Pose(here.position + np.array(way), here.rotation), limits)
            )
            middle = (loop.player.start_time + loop.player.end_time) / 2
            time.wait((middle - time.system_ns()) * 1e-9)
        places = [plant.platform_position()]
        loop.machine.on_tick = lambda: places.append(plant.platform_position())
        if fault == "quick_stop":
            loop.machine.call("/can_drives/quick_stop")
        else:
            loop.machine.faults.inject(loop.machine.faults.read(f"{fault} motor_3"))
        loop.wait_for(RobotState.FAULT, 3.0)
        time.wait(0.8)
        assert not any(device.automaton.brake_open for device in loop.machine.devices)
        cause = loop.cause
    finally:
        loop.machine.close()
    path, along = np.array(places), np.array(way) / np.linalg.norm(way)
    if not speed:
        along = np.zeros(3)
    off = path - begin - np.outer((path - begin) @ along, along)
    return Departure(float(np.linalg.norm(off, axis=1).max()), path[0, 2] - path[:, 2].min(), cause)


@pytest.mark.parametrize(
    ("fault", "speed", "way"),
    [
        ("encoder_frozen", 0.02, SHORT),
        ("encoder_frozen", 0.2, BACK),
        ("encoder_drift", 0.0, SHORT),
        ("encoder_drift", 0.6, LEVEL),
    ],
)
def test_it_costs_little_more_than_a_quick_stop(
    fault: str, speed: float, way: tuple[float, float, float]
) -> None:
    wrong, sound = departure(fault, speed, way), departure("quick_stop", speed, way)
    assert wrong.sideways - sound.sideways < 0.010
    assert wrong.sunk - sound.sunk < 0.020
    assert "cable lengths fit no pose" in wrong.cause
    assert "motor_3" in wrong.cause
    if fault == "encoder_frozen":
        assert "encoder of motor_3" in wrong.cause
