"""What becomes of a fault in simulated time: until all brakes hold, and how the operator brings the robot back."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cspr_control.closed_loop.fault_scenarios import FaultScenario, RobotLoop, sideways, wait_until_set_up
from cspr_control.closed_loop.loop import ClosedLoopError
from cspr_control.closed_loop.run import closed_loop
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.reference.point_to_point import PointToPoint
from cspr_msgs_py.vocabulary import DriverState, RobotState, TrajectoryPhase

Floats = NDArray[np.float64]

PAYLOAD = 200.0  # kg on a platform of 153 kg
LARGEST_DROP = 0.020  # m
LARGEST_MOVEMENT = 0.010  # m off the path, of a robot that bears a fault
_WAY = 0.6  # m along x, of a robot that moves
_HOLDING = 1.0  # s for which a robot that is held still has been enabled
_WOUND = 0.5  # s from one call of wind_in to the next
_CALLS = 50  # of wind_in, before the robot counts as one that cannot be enabled
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
    noticed
        From the fault until the robot begins to stop, s; None where it does not.
    duration
        From the fault until all brakes hold, s; None where they stay open, as they must after what is harmless.
    drop
        Height lost, from the fault until the platform rests on the brakes, m.
    moved
        Largest distance of the platform from the path that was planned, from the fault until it rests, m.
    lowest_tension, highest_tension
        Of all cables until the brakes hold, N.
    jump
        Largest movement of the platform while the operator enables it again, m.
    """

    cause: str
    controlled: bool
    noticed: float | None
    duration: float | None
    drop: float
    moved: float
    lowest_tension: float
    highest_tension: float
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


class _Watch:
    """What is seen of a robot from a fault on: heights, distances from the path, tensions, states, brakes."""

    def __init__(self, loop: RobotLoop, onset: Callable[[RobotLoop], bool]) -> None:
        self._loop = loop
        self._happens = onset
        self._begin = self._place
        self._end = self._begin
        self.onset: float | None = None
        self.noticed: float | None = None
        self.closed: float | None = None
        self.heights: list[float] = []
        self.distances: list[float] = []
        self.tensions: list[tuple[float, float]] = []  # lowest and highest
        self.states: set[RobotState] = set()
        loop.machine.on_tick = self.look

    @property
    def _place(self) -> Floats:
        return np.array(self._loop.machine.plant.platform_position())

    def plan(self) -> None:
        """Take the straight way from where the platform was at first to where the reference is to end."""
        destination = self._loop.player.destination
        if destination is not None:
            self._end = destination.position

    def look(self) -> None:
        loop, now, place = self._loop, self._loop.time.monotonic(), self._place
        if self.onset is None and self._happens(loop):
            self.onset = now
            self.heights.clear()
            self.distances.clear()
        self.heights.append(place[2])
        self.distances.append(_distance(place, self._begin, self._end))
        self.states.add(loop.state)
        running = loop.state is RobotState.ENABLED and loop.machine.drives.states()[0] is DriverState.ENABLED
        if self.noticed is None and not running:
            self.noticed = now
        if self.closed is None:
            tensions = loop.machine.plant.tensions()
            self.tensions.append((tensions.min(), tensions.max()))
            if not any(device.automaton.brake_open for device in loop.machine.devices):
                self.closed = now

    def outcome(self, jump: float) -> Outcome:
        """Return what became of it."""
        onset = self.onset or 0.0
        lowest, highest = np.array(self.tensions).T
        return Outcome(
            self._loop.cause,
            RobotState.STOPPING in self.states,
            None if self.noticed is None else self.noticed - onset,
            None if self.closed is None else self.closed - onset,
            self.heights[0] - min(self.heights),
            max(self.distances),
            lowest.min(),
            highest.max(),
            jump,
        )


def _distance(place: Floats, begin: Floats, end: Floats) -> float:
    """Return the distance of a place from the straight way between two others, m."""
    way = end - begin
    share = float((place - begin) @ way) / max(float(way @ way), 1e-12)
    return float(np.linalg.norm(place - begin - min(max(share, 0.0), 1.0) * way))


def _run(loop: RobotLoop, scenario: FaultScenario) -> Outcome:
    time = loop.time
    begin = time.monotonic()
    watch = _Watch(loop, scenario.onset)
    watch.look()
    scenario.begin(loop)
    watch.plan()
    while (
        watch.closed is None
        or loop.state is not RobotState.FAULT
        or time.monotonic() - begin <= scenario.happens
    ):
        time.wait(0.01)
        over = time.monotonic() - begin > scenario.lasts
        if over and scenario.tolerable and loop.state is RobotState.ENABLED:
            _require_borne(loop, watch)
            scenario.end(loop)  # which may stop it, as what has stood still for so long goes on with a step
            time.wait(_SETTLING)
            if not loop.cause:
                return watch.outcome(0.0)
            begin = time.monotonic()
        _require(not over or scenario.tolerable, f"not over after {scenario.lasts:g} s", loop)
        _require(time.monotonic() - begin < 4.0 * scenario.lasts, "neither held nor enabled", loop)
    time.wait(scenario.settling)
    loop.machine.on_tick = lambda: None
    _require_held(loop, scenario)
    _require(watch.onset is not None, "it has not happened", loop)
    outcome = watch.outcome(0.0)
    _require(
        outcome.drop <= scenario.faults * LARGEST_DROP, f"{1e3 * outcome.drop:.1f} mm of height lost", loop
    )
    scenario.end(loop)
    time.wait(_SETTLING)
    _require_held(loop, scenario)
    return replace(outcome, jump=_recover(loop, scenario.rest))


def _go_on(loop: RobotLoop, scenario: FaultScenario) -> Outcome:
    """Let happen what is harmless, and the motion go on to its end."""
    watch = _Watch(loop, scenario.onset)
    watch.plan()
    watch.look()
    _require(watch.onset is None, "it has happened before", loop)
    scenario.begin(loop)
    loop.wait_until(lambda: loop.player.phase.at_rest, scenario.lasts, lambda: "the motion does not end")
    loop.time.wait(_SETTLING)
    _require(watch.onset is not None, "it has not happened", loop)
    _require(loop.state is RobotState.ENABLED and not loop.cause, "it is not harmless", loop)
    finished = loop.player.phase is TrajectoryPhase.FINISHED
    _require(finished, f"the motion was given up: {loop.player.interruption}", loop)
    return watch.outcome(0.0)


def _require_borne(loop: RobotLoop, watch: _Watch) -> None:
    """See that the robot goes on as it should although something is wrong."""
    outcome = watch.outcome(0.0)
    _require(loop.state is RobotState.ENABLED and watch.closed is None, "neither held nor enabled", loop)
    _require(outcome.drop <= LARGEST_DROP, f"{1e3 * outcome.drop:.1f} mm of height lost", loop)
    _require(outcome.moved <= LARGEST_MOVEMENT, f"{1e3 * outcome.moved:.1f} mm off its path", loop)


def _recover(loop: RobotLoop, rest: float) -> float:
    """Reset and enable as the operator does; return the largest movement of the platform meanwhile, m."""
    robot, plant, time = loop.machine, loop.machine.plant, loop.time
    wait_until_set_up(loop)
    time.wait(rest)
    decision = loop.order("/supervisor/reset")
    _require(decision.accepted, decision.message, loop)
    loop.wait_for(RobotState.DISABLED, 3.0)
    time.wait(0.1)
    _ask_to_enable(loop)
    place = plant.platform_position()
    away = []
    robot.on_tick = lambda: away.append(float(np.linalg.norm(plant.platform_position() - place)))
    if loop.state is RobotState.DISABLED:
        loop.enable()
    loop.wait_for(RobotState.ENABLED, 5.0)
    time.wait(0.3)
    robot.on_tick = lambda: None
    _require(loop.state is RobotState.ENABLED, "not enabled again", loop)
    return max(away)


def _ask_to_enable(loop: RobotLoop) -> None:
    """Enable, and wind in first what hangs slack, as the refusals say."""
    for _ in range(_CALLS):
        decision = loop.order("/supervisor/enable")
        named = re.search(r"/can_drives/motor_\d+/wind_in", decision.message)
        if decision.accepted or not (named or loop.machine.drives.states()[0] is DriverState.WINDING):
            return
        if named:
            loop.machine.call(named.group())
        loop.time.wait(_WOUND)


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
