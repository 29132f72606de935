"""What becomes of a fault in simulated time: until all brakes hold, and how the operator brings the robot back."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cspr_control.closed_loop.fault_scenarios import FaultScenario, RobotLoop, sideways, wait_until_set_up
from cspr_control.closed_loop.loop import ClosedLoopError
from cspr_control.closed_loop.run import closed_loop
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.reference.point_to_point import PointToPoint
from cspr_msgs_py.vocabulary import RobotState, TrajectoryPhase

PAYLOAD = 200.0  # kg on a platform of 153 kg
LARGEST_DROP = 0.020  # m
_WAY = 0.6  # m along x, of a robot that moves
_HOLDING = 1.0  # s for which a robot that is held still has been enabled
_SETTLING = 0.2  # s for which the robot is watched after what was harmless, or was repaired


@dataclass(frozen=True)
class Outcome:
    """What became of a fault.

    Attributes
    ----------
    cause
        As latched; empty after what is harmless.
    controlled
        Whether the robot came to rest along its path first.
    duration
        From the fault until all brakes hold, s; None where they stay open, as they must after what is harmless.
    drop
        Height lost, from the fault until the platform rests on the brakes, m.
    lowest_tension
        Of all cables until the brakes hold, N.
    jump
        Largest movement of the platform while the operator enables it again, m.
    """

    cause: str
    controlled: bool
    duration: float | None
    drop: float
    lowest_tension: float
    jump: float


class FaultError(ClosedLoopError):
    """A fault did not end as it must."""


def outcome_of(scenario: FaultScenario, moving: bool, config: Path) -> Outcome:
    """Let a fault happen to a robot that carries `PAYLOAD`, see it end, and bring the robot back to being enabled.

    Parameters
    ----------
    scenario
        The fault.
    moving
        Whether the robot moves, or holds its load still.
    config
        Directory of the configuration.

    Raises
    ------
    FaultError
        If it ends otherwise than held, brakes closed, latched and named, or the robot cannot be brought back; or if
        anything at all comes of what is harmless.
    """
    loop = closed_loop(Scenario(payload=PAYLOAD, config=config, home_counts=scenario.home_counts))
    try:
        loop.begin()
        loop.time.wait(2.0)  # the estimate of the payload settles
        loop.enable()
        if not moving:
            loop.time.wait(_HOLDING)
        else:
            way = _WAY * scenario.towards
            loop.play(lambda here: PointToPoint(here, sideways(here, way), loop.player.limits))
            if scenario.harmless:
                return _go_on(loop, scenario)
            middle = (loop.player.start_time + loop.player.end_time) / 2  # where it is fastest
            loop.time.wait((middle - loop.time.system_ns()) * 1e-9)
        return _run(loop, scenario)
    finally:
        loop.machine.close()


def _run(loop: RobotLoop, scenario: FaultScenario) -> Outcome:
    robot, plant, time = loop.machine, loop.machine.plant, loop.time
    heights: list[float] = []
    tensions: list[float] = []
    states: list[RobotState] = []
    closed_at: list[float] = []
    onset: list[float] = []

    def look() -> None:
        if not onset and scenario.onset(loop):
            onset.append(time.monotonic())
            heights.clear()
        heights.append(plant.platform_position()[2])
        states.append(loop.state)
        if not closed_at:
            tensions.append(plant.tensions().min())
            if not any(device.automaton.brake_open for device in robot.devices):
                closed_at.append(time.monotonic())

    begin = time.monotonic()
    robot.on_tick = look
    look()
    scenario.begin(loop)
    while not (closed_at and loop.state is RobotState.FAULT):
        time.wait(0.01)
        _require(time.monotonic() - begin < scenario.lasts, f"not over after {scenario.lasts:g} s", loop)
    time.wait(scenario.settling)
    robot.on_tick = lambda: None
    _require_held(loop, scenario)
    _require(bool(onset), "it has not happened", loop)
    duration, drop = closed_at[0] - onset[0], heights[0] - min(heights)
    _require(drop <= LARGEST_DROP, f"{1e3 * drop:.1f} mm of height lost", loop)
    cause = loop.cause
    scenario.end(loop)
    time.wait(_SETTLING)
    _require_held(loop, scenario)
    return Outcome(
        cause, RobotState.STOPPING in states, duration, drop, min(tensions), _recover(loop, scenario.rest)
    )


def _go_on(loop: RobotLoop, scenario: FaultScenario) -> Outcome:
    """Let happen what is harmless, and the motion go on to its end."""
    plant, time = loop.machine.plant, loop.time
    heights: list[float] = []
    tensions: list[float] = []
    onset: list[float] = []

    def look() -> None:
        if not onset and scenario.onset(loop):
            onset.append(time.monotonic())
        heights.append(plant.platform_position()[2])
        tensions.append(plant.tensions().min())

    look()
    _require(not onset, "it has happened before", loop)
    loop.machine.on_tick = look
    scenario.begin(loop)
    loop.wait_until(lambda: loop.player.phase.at_rest, scenario.lasts, lambda: "the motion does not end")
    time.wait(_SETTLING)
    _require(bool(onset), "it has not happened", loop)
    _require(loop.state is RobotState.ENABLED and not loop.cause, "it is not harmless", loop)
    finished = loop.player.phase is TrajectoryPhase.FINISHED
    _require(finished, f"the motion was given up: {loop.player.interruption}", loop)
    return Outcome("", False, None, heights[0] - min(heights), min(tensions), 0.0)


def _recover(loop: RobotLoop, rest: float) -> float:
    """Reset and enable as the operator does; return the largest movement of the platform meanwhile, m."""
    robot, plant, time = loop.machine, loop.machine.plant, loop.time
    wait_until_set_up(loop)
    time.wait(rest)
    decision = loop.order("/supervisor/reset")
    _require(decision.accepted, decision.message, loop)
    loop.wait_for(RobotState.DISABLED, 3.0)
    time.wait(0.1)
    place = plant.platform_position()
    away = []
    robot.on_tick = lambda: away.append(float(np.linalg.norm(plant.platform_position() - place)))
    loop.enable()
    time.wait(0.3)
    robot.on_tick = lambda: None
    _require(loop.state is RobotState.ENABLED, "not enabled again", loop)
    return max(away)


def _require_held(loop: RobotLoop, scenario: FaultScenario) -> None:
    _require(loop.state is RobotState.FAULT, "not latched", loop)
    _require(scenario.cause in loop.cause, f"the cause does not name '{scenario.cause}'", loop)
    _require(not any(device.automaton.brake_open for device in loop.machine.devices), "a brake is open", loop)
    speed = float(np.abs(loop.machine.plant.motor_speeds()).max())
    _require(speed < 0.1, f"a motor turns at {speed:.2f} rad/s", loop)
    _require(not loop.order("/supervisor/enable").accepted, "enable is accepted", loop)


def _require(condition: bool, problem: str, loop: RobotLoop) -> None:
    if not condition:
        state, cause, _ = loop.machine.drives.states()
        raise FaultError(
            f"{problem}; robot {loop.state.value} ({loop.cause}), drives {state.value} ({cause})"
        )
