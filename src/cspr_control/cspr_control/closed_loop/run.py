"""A run of the closed loop from a scenario: what the demo does live, in simulated time."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

from cspr_control.closed_loop.bag import recorded
from cspr_control.closed_loop.bare_plant import BarePlant
from cspr_control.closed_loop.loop import ClosedLoop, ClosedLoopError
from cspr_control.closed_loop.machine import Machine
from cspr_control.closed_loop.record import LoopRecord, LoopRecorder
from cspr_control.closed_loop.robot import SimulatedRobot
from cspr_control.closed_loop.scenario import PlannedFault, Scenario
from cspr_control.closed_loop.simulated_time import SimulatedTime
from cspr_control.parameters.control_settings import control_settings, robot_file
from cspr_control.parameters.experiment import MEASURING, SETTLING
from cspr_control.reference.catalogue import make_trajectory
from cspr_control.reference.point_to_point import PointToPoint
from cspr_control.reference.trajectory import Trajectory
from cspr_drivers.bus.bus_load import require_fitting_cycle
from cspr_drivers.errors import DriverError
from cspr_drivers.simulation.fault_injection import FaultOrder
from cspr_kinematics import Payload, Pose, Robot
from cspr_msgs_py.vocabulary import RobotState, TrajectoryPhase

_STEP = 0.02  # s between two looks at what goes on

Progress = Callable[[str, float], None]
"""Told what goes on, and the simulated time, s."""


def closed_loop(scenario: Scenario) -> ClosedLoop[Any]:
    """Make the closed loop of a scenario; it has not begun."""
    parameters = scenario.read_parameters()
    robot = Robot.from_yaml(scenario.config / robot_file(parameters))
    settings = control_settings(robot, parameters)
    time, simulation = SimulatedTime(), scenario.read_machine()
    machine: Machine
    if scenario.devices:
        buses = scenario.read_buses()
        require_fitting_cycle(buses, settings.control_rate)
        machine = SimulatedRobot(time, buses, simulation, scenario.config / "eds")
    else:
        machine = BarePlant(time, simulation, 1.0 / settings.control_rate)
    return ClosedLoop(robot, settings, machine, scenario.reaction_time, scenario.exact_mass, scenario.speed)


def run(
    scenario: Scenario,
    bag: Path | None = None,
    progress: Progress = lambda step, time: None,
    keep: bool = False,
) -> LoopRecord:
    """Enable the robot, let it follow the trajectory, stop it, and return what happened.

    Parameters
    ----------
    scenario
        The run.
    bag
        Where all that is published is recorded, if anywhere; must not exist yet.
    progress
        Told of what goes on.
    keep
        Whether the record keeps all that was published, as an analysis needs it.

    Raises
    ------
    ControlError, cspr_kinematics.KinematicsError, cspr_msgs_py.errors.MessagesError
        If a file of the configuration is not what it must be, the bag cannot be written, or a fault that nobody planned
        stopped the robot.
    """
    began = process_time()
    try:
        loop = closed_loop(scenario)
        recorder = LoopRecorder(loop)
        begin = loop.time.monotonic()
        with ExitStack() as opened:
            opened.enter_context(_without_collector())
            opened.callback(loop.machine.close)
            faults = [(planned, loop.machine.faults.read(planned.fault)) for planned in scenario.faults]
            published = opened.enter_context(recorded(bag, scenario, loop)) if bag or keep else None
            _operate(loop, scenario, faults, progress)
    except DriverError as error:
        raise ClosedLoopError(str(error)) from error
    record = recorder.record(scenario, loop.time.monotonic() - begin, process_time() - began)
    return replace(record, published=published if keep else None)


@contextmanager
def _without_collector() -> Iterator[None]:
    """Keep Python's cycle collector from walking again and again through all that a run has recorded."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()


def _operate(
    loop: ClosedLoop[Any],
    scenario: Scenario,
    faults: Sequence[tuple[PlannedFault, FaultOrder]],
    progress: Progress,
) -> None:
    """Do what an operator does, from switching on to switching off."""
    begin = loop.time.monotonic()
    first = min((planned.time for planned in scenario.faults), default=math.inf)

    def pause(step: str, duration: float, done: Callable[[], bool] = lambda: False) -> bool:
        end = loop.time.monotonic() + duration
        while not done() and loop.time.monotonic() < end:
            progress(step, loop.time.monotonic() - begin)
            loop.time.wait(min(_STEP, end - loop.time.monotonic()))
        return done()

    progress("starting", 0.0)
    loop.begin()
    loop.enable()
    player = loop.player

    def stopped() -> bool:
        early = not player.start_time or loop.time.system_ns() < player.start_time + first * 1e9
        if loop.state is RobotState.FAULT and early:
            raise ClosedLoopError(f"the robot stopped: {loop.cause}")
        return loop.state is RobotState.FAULT

    def over() -> bool:
        return stopped() or player.phase.at_rest

    pause("measuring the payload", MEASURING, stopped)
    _start(loop, scenario, faults)

    moving = (player.end_time - loop.time.system_ns()) * 1e-9
    if scenario.duration is not None:
        pause("moving", (player.start_time - loop.time.system_ns()) * 1e-9 + scenario.duration, over)
        loop.order("/trajectory_publisher/stop")
    pause("moving", moving + 1.0, over)
    if player.phase is not TrajectoryPhase.FINISHED and scenario.duration is None and not loop.cause:
        raise ClosedLoopError(f"the trajectory was not followed to its end: {player.interruption}")
    pause("settling", SETTLING)
    loop.order("/supervisor/stop")
    pause("stopping", SETTLING, lambda: loop.state in (RobotState.DISABLED, RobotState.FAULT))
    stopped()


def _start(
    loop: ClosedLoop[Any], scenario: Scenario, faults: Sequence[tuple[PlannedFault, FaultOrder]]
) -> None:
    """Begin the trajectory, and plan what happens on it."""
    player, settings = loop.player, loop.settings

    def make(present: Pose) -> Trajectory:
        trajectory = make_trajectory(scenario.trajectory, loop.robot, present, settings.trajectory)
        if scenario.phase is not None:
            approach = PointToPoint(present, trajectory.sample(0.0).pose, player.limits)
            player.dwell += (-scenario.phase - approach.duration - player.dwell) % (
                1.0 / settings.control_rate
            )
        return trajectory

    loop.play(make)
    lasts = (player.end_time - player.start_time) * 1e-9
    if scenario.duration is not None:
        lasts = min(lasts, scenario.duration)
    for time, mass in scenario.loads():
        if time < lasts:
            stamp = player.start_time + round(time * 1e9)
            loop.machine.change_payload(
                Payload(mass, scenario.payload_center), stamp, scenario.growth, scenario.sling
            )
    for planned, order in faults:
        if planned.time > lasts + SETTLING:
            raise ClosedLoopError(
                f"{planned.fault} at {planned.time:g} s would come too late: the trajectory is over after {lasts:g} s"
            )
        delay = planned.time + (player.start_time - loop.time.system_ns()) * 1e-9
        loop.time.at(loop.time.monotonic() + delay, partial(loop.machine.faults.inject, order))
