"""What becomes of a load that swings on a sling, and of one that does not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from studies.experiment import BARE

from benchmarks.platform_rows import Row
from cspr_control.closed_loop.run import closed_loop, run
from cspr_drivers.simulation.simulation_config import Sling
from cspr_kinematics import Payload
from cspr_msgs_py.parameters.table import node_parameters
from cspr_msgs_py.topics import MOTOR_STATES, SETPOINT, Topic
from cspr_msgs_py.vocabulary import TrajectoryName

_DAMPED = {"feedforward": {"swing_damping": node_parameters("feedforward")["swing_damping"].maximum}}
_STIFFNESS = 60e3  # N/m
_WATCHED = 5.0  # s


def swing(name: str, length: float, degrees: float) -> list[Row]:
    """Let loads come aboard while they swing on a sling, m, towards x or y, each damped as much as may be."""
    angle = np.radians(degrees)
    times, notes = [], []
    for mass in (100.0, 200.0):
        for axis, deflection in (("x", (angle, 0.0)), ("y", (0.0, angle))):
            time, swings = _swings(mass, Sling(length, _STIFFNESS, deflection=deflection))
            beyond = time[swings > 0.2 * angle]
            times.append(float(beyond[-1]))
            notes.append(f"{mass:g} kg along {axis} {times[-1]:.2f} s")
    latest = max(times) if max(times) < _WATCHED - 1.0 else float("inf")
    return [Row(name, "within a fifth for good after, the latest", latest, 3.0, "s", note="; ".join(notes))]


def _swings(mass: float, sling: Sling) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times after a load has come aboard, s, and how far it hangs out of plumb, rad."""
    loop = closed_loop(replace(BARE, payload=0.0, added=(), sling=sling, parameters=_DAMPED))
    plant, swings = loop.machine.plant, []

    def listen(topic: Topic, sample: Any) -> None:
        if topic is MOTOR_STATES:
            hangs = plant.load_position() - plant.platform_position()
            swings.append((sample.stamp_ns, np.arctan2(np.hypot(hangs[0], hangs[1]), -hangs[2])))

    loop.begin()
    loop.enable()
    loop.time.wait(1.0)
    begin = loop.time.system_ns()
    loop.machine.change_payload(Payload(mass, np.zeros(3)), begin, sling=sling)
    loop.listeners.append(listen)
    loop.time.wait(_WATCHED)
    assert not loop.cause, loop.cause
    stamps, angles = np.array(swings).T
    return (stamps - begin) * 1e-9, angles


def no_swing(name: str) -> list[Row]:
    """Carry a load without a sling, with and without damping."""
    rigid = replace(BARE, trajectory=TrajectoryName.SMOOTH_19, payload=200.0, added=())
    angles = []
    for parameters in ({}, _DAMPED):
        published = run(replace(rigid, parameters=parameters), keep=True).published
        assert published is not None
        angles.append(published.joint_states(SETPOINT.name).position)
    ratio = rigid.read_machine().robot.winch.transmission_ratio
    different = 1e3 * ratio * float(np.abs(angles[1] - angles[0]).max())
    return [Row(name, "set-points, largest change by the damping", different, 0.0, "mm")]
