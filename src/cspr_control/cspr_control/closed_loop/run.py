"""A run of the closed loop from a scenario: what the demo does live, in simulated time."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from time import process_time
from typing import Any

import numpy as np

from cspr_control.closed_loop.bare_plant import BarePlant
from cspr_control.closed_loop.loop import ClosedLoop, ClosedLoopError, Listener
from cspr_control.closed_loop.machine import Machine
from cspr_control.closed_loop.record import LoopRecord, LoopRecorder
from cspr_control.closed_loop.robot import SimulatedRobot
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.closed_loop.simulated_time import SimulatedTime
from cspr_control.parameters.control_settings import control_settings
from cspr_control.reference.catalogue import make_trajectory
from cspr_control.reference.point_to_point import PointToPoint
from cspr_control.reference.trajectory import Trajectory
from cspr_kinematics import Payload, Pose
from cspr_msgs_py.vocabulary import RobotState, TrajectoryPhase

_MEASURING = 2.0  # s for the load to be measured before the trajectory begins
_SETTLING = 1.5  # s after the end of the trajectory, or after a fault
_STEP = 0.1  # s between two words about the progress
_LATENCY = 0.0005  # s from the motor states to the torques, in one process
_LATENCY_WITH_BUS = 0.0015  # s, with what frames take on the bus before and after

Progress = Callable[[str, float], None]
"""Told what goes on, and the simulated time, s."""


def closed_loop(scenario: Scenario, listen: Listener | None = None) -> ClosedLoop[Any]:
    """Make the closed loop of a scenario; it has not begun.

    Parameters
    ----------
    scenario
        What it is made of.
    listen
        Told of all that is published; see `ClosedLoop.listeners`.
    """
    robot = scenario.read_robot()
    settings = control_settings(robot, scenario.read_parameters())
    time, simulation = SimulatedTime(), scenario.read_machine()
    machine: Machine
    if scenario.devices:
        machine = SimulatedRobot(time, scenario.read_buses(), simulation, scenario.config / "eds")
    else:
        machine = BarePlant(time, simulation, settings.period)
    latency = scenario.latency
    if latency is None:
        latency = _LATENCY if scenario.devices else _LATENCY_WITH_BUS
    loop = ClosedLoop(robot, settings, machine, latency, scenario.exact_mass, scenario.speed)
    if listen is not None:
        loop.listeners.append(listen)
    return loop


def run(
    scenario: Scenario, listen: Listener | None = None, progress: Progress = lambda step, time: None
) -> LoopRecord:
    """Enable the robot, let it follow the trajectory, stop it, and return what happened.

    Parameters
    ----------
    scenario
        The run.
    listen
        Told of each topic and sample that is published.
    progress
        Told of what goes on.

    Raises
    ------
    ControlError, cspr_kinematics.KinematicsError, cspr_drivers.errors.DriverError
        If a file of the configuration is not what it must be, or the robot stopped by a fault that nobody planned.
    """
    began = process_time()
    loop = closed_loop(scenario, listen)
    recorder = LoopRecorder(loop)
    begin = loop.time.monotonic()

    def pause(step: str, duration: float, done: Callable[[], bool] = lambda: False) -> bool:
        end = loop.time.monotonic() + duration
        while not done() and loop.time.monotonic() < end:
            progress(step, loop.time.monotonic() - begin)
            loop.time.wait_until(done, min(_STEP, end - loop.time.monotonic()))
        return done()

    try:
        progress("starting", 0.0)
        loop.begin()
        loop.enable()
        pause("measuring the load", _MEASURING, lambda: loop.state is RobotState.FAULT)
        _start(loop, scenario)
        player = loop.player

        def over() -> bool:
            return loop.state is RobotState.FAULT or player.phase.at_rest

        moving = (player.end_time - loop.time.system_ns()) * 1e-9
        if scenario.duration is not None:
            pause("moving", (player.start_time - loop.time.system_ns()) * 1e-9 + scenario.duration, over)
            loop.order("/trajectory_publisher/stop")
        pause("moving", moving + 1.0, over)
        if loop.state is RobotState.FAULT and not scenario.faults:
            raise ClosedLoopError(f"the robot stopped: {loop.cause}")
        if player.phase is not TrajectoryPhase.FINISHED and scenario.duration is None and not loop.cause:
            raise ClosedLoopError(f"the trajectory was not followed to its end: {player.interruption}")
        pause("settling", _SETTLING)
        loop.order("/supervisor/stop")
        pause("stopping", _SETTLING, lambda: loop.state in (RobotState.DISABLED, RobotState.FAULT))
    finally:
        loop.machine.close()
    return recorder.record(loop.time.monotonic() - begin, process_time() - began)


def _start(loop: ClosedLoop[Any], scenario: Scenario) -> None:
    """Begin the trajectory, and plan what happens on it."""
    player, settings = loop.player, loop.settings

    def make(present: Pose) -> Trajectory:
        trajectory = make_trajectory(scenario.trajectory, loop.robot, present, settings.trajectory.options)
        if scenario.phase is not None:
            approach = PointToPoint(present, trajectory.sample(0.0).pose, player.limits)
            player.dwell += (-scenario.phase - approach.duration - player.dwell) % settings.period
        return trajectory

    loop.play(make)
    mass = scenario.payload
    for added in sorted(scenario.added, key=lambda added: added.time):
        mass += added.mass
        stamp = player.start_time + round(added.time * 1e9)
        loop.machine.change_payload(Payload(mass, np.zeros(3)), stamp)
    for planned in scenario.faults:
        order = loop.machine.faults.read(planned.fault)
        delay = planned.time + (player.start_time - loop.time.system_ns()) * 1e-9
        loop.time.at(loop.time.monotonic() + delay, partial(loop.machine.faults.inject, order))
