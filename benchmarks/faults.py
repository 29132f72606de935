"""Every fault in simulated time: what it is called, how long until all brakes hold, and how far 353 kg sink.

The same scenarios are tests. Each one ends as each fault must: held, brakes closed, latched, with a named cause;
then the operator's reset and enable, and nothing else, bring the robot back without a jump.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.stepped_graph import LIMITS, SteppedGraph
from cspr_control.reference.point_to_point import MotionLimits, PointToPoint
from cspr_drivers.simulation.fault_injection import FaultOrder, InjectedFault
from cspr_kinematics import Pose
from cspr_msgs_py.vocabulary import RobotState

PAYLOAD = 200.0  # kg on a platform of 153 kg
LARGEST_DROP = 0.020  # m
_PLACE = 2  # the motor or cable, from 0, that has the fault
_WINDING = 2.0  # s that turning a drum back by hand may take
_SETTLING = 0.2  # s for which the robot is watched after the brakes hold


@dataclass(frozen=True)
class Scenario:
    """A fault.

    Attributes
    ----------
    name
        As in docs/operation.md.
    begin
        Lets it happen.
    cause
        Words that the latched cause contains.
    end
        Ends it, before the operator resets.
    onset
        What makes it a fault, where that takes a while from `begin` on; time and height count from then.
    moving, held
        Whether it can happen to a robot that moves, and to one that is held still.
    lasts
        Longest time until the brakes hold, s.
    rest
        Time for the estimate of the payload to recover before the operator enables again, s.
    harms_tension
        Whether the fault itself takes the tension out of a cable.
    """

    name: str
    begin: Callable[[SteppedGraph], None]
    cause: str
    end: Callable[[SteppedGraph], None] = lambda graph: graph.robot.faults.clear()
    onset: Callable[[SteppedGraph], bool] = lambda graph: True
    moving: bool = True
    held: bool = True
    lasts: float = 2.0
    rest: float = 0.1
    harms_tension: bool = False


@dataclass(frozen=True)
class Outcome:
    """What became of a fault.

    Attributes
    ----------
    cause
        As latched.
    controlled
        Whether the robot came to rest along its path first.
    duration
        From the fault until all brakes hold, s.
    drop
        Height lost, from the fault until the platform rests on the brakes, m.
    lowest_tension
        Of all cables until the brakes hold, N.
    jump
        Largest movement of the platform while the operator enables it again, m.
    """

    cause: str
    controlled: bool
    duration: float
    drop: float
    lowest_tension: float
    jump: float


def _inject(fault: InjectedFault, place: int | str = _PLACE) -> Callable[[SteppedGraph], None]:
    return lambda graph: graph.robot.faults.inject(FaultOrder(fault, place))


def _answer(torque: Callable[[float], float]) -> Callable[[SteppedGraph], None]:
    return lambda graph: graph.torque.__setitem__(_PLACE, torque)


def _heal_controllers(graph: SteppedGraph) -> None:
    graph.torque.clear()
    graph.dead_controllers.clear()


def _stale_command(graph: SteppedGraph) -> None:
    stamp = graph.robot.clock.system_ns() - 200_000_000
    graph.robot.drives.command(_PLACE, stamp, -1.0)


def _unknown_motor(graph: SteppedGraph) -> None:
    graph.robot.drives.reject_command(_PLACE, "names are ('motor_9',)")


def _freeze(graph: SteppedGraph) -> None:
    graph.robot.driver_runs = False
    graph.robot.at(graph.robot.now + 1.0, lambda: setattr(graph.robot, "driver_runs", True))


def _leave_workspace(graph: SteppedGraph) -> None:
    outside = Pose(graph.model.workspace_max * (0.0, 1.0, 0.0) + (0.0, 0.2, 1.0), np.eye(3))
    quick = MotionLimits(speed=0.8, acceleration=1.0, angular_speed=0.2, angular_acceleration=0.4)
    graph.start(PointToPoint(graph.model.home, outside, quick))


def _hurry(graph: SteppedGraph) -> None:
    here = graph.player.held_pose
    assert here is not None
    across = np.array([math.copysign(1.0, -here.position[0] - 1e-9), here.position[1], here.position[2]])
    quick = MotionLimits(speed=1.0, acceleration=3.0, angular_speed=0.2, angular_acceleration=0.4)
    graph.start(PointToPoint(here, Pose(across, here.rotation), quick))


def _lift_what_is_caught(graph: SteppedGraph) -> None:
    graph.robot.faults.inject(FaultOrder(InjectedFault.PLATFORM_CAUGHT))
    here = graph.player.held_pose
    assert here is not None
    slow = MotionLimits(speed=0.05, acceleration=0.3, angular_speed=0.2, angular_acceleration=0.4)
    graph.start(PointToPoint(here, Pose(here.position + np.array([0.0, 0.0, 0.3]), here.rotation), slow))


def _wind_back(graph: SteppedGraph) -> None:
    """Turn a drum by hand, slowly and with its brake lifted, until the lengths of all cables fit a pose."""
    graph.robot.faults.clear()
    _heal_controllers(graph)
    robot, plant = graph.robot, graph.robot.plant
    robot.wait_until(lambda: not robot.drives.snapshot().not_configured, "drives are not configured")
    plant.set_brake(_PLACE, closed=False)
    end = robot.now + _WINDING
    while robot.now < end and abs(error := graph.supervisor.checks.following_errors()[_PLACE]) > 0.1:
        hand = max(-2.5, min(2.5, 10.0 * error)) - 1.2
        plant.set_torque(_PLACE, max(-2.5, hand) - 0.05 * plant.motor_speeds()[_PLACE])
        robot.wait(0.002)
    plant.set_brake(_PLACE, closed=True)
    plant.set_torque(_PLACE, 0.0)


SCENARIOS = (
    Scenario("command stale", _stale_command, "older than the command timeout"),
    Scenario("command not finite", _answer(lambda torque: math.nan), "not finite", _heal_controllers),
    Scenario(
        "command beyond the limit", _answer(lambda torque: 50.0), "beyond the torque limit", _heal_controllers
    ),
    Scenario("command for an unknown motor", _unknown_motor, "unreadable"),
    Scenario(
        "controller killed", lambda graph: graph.dead_controllers.add(_PLACE), "motor_3", _heal_controllers
    ),
    Scenario(
        "driver frozen for 1 s",
        _freeze,
        "stale topic",
        lambda graph: graph.robot.wait_until(lambda: graph.robot.driver_runs, "the driver hangs"),
        lasts=3.0,
    ),
    Scenario(
        "driver killed",
        lambda graph: graph.robot.kill_driver(),
        "stale topic",
        lambda graph: graph.robot.restart_driver(),
        lasts=3.0,
    ),
    Scenario("driver ended, Ctrl-C or SIGTERM", lambda graph: graph.robot.drives.disable(), "by themselves"),
    Scenario("drive silent", _inject(InjectedFault.DRIVE_SILENT), "motor_3"),
    Scenario("drive without feedback", _inject(InjectedFault.DRIVE_NO_FEEDBACK), "motor_3"),
    Scenario("drive without heartbeat", _inject(InjectedFault.DRIVE_NO_HEARTBEAT), "motor_3"),
    Scenario("drive resets", _inject(InjectedFault.DRIVE_RESET), "motor_3"),
    Scenario("drive in fault", _inject(InjectedFault.DRIVE_FAULT), "motor_3"),
    Scenario("drive in the wrong mode", _inject(InjectedFault.DRIVE_WRONG_MODE), "motor_3"),
    Scenario("drive reports EMCY", _inject(InjectedFault.DRIVE_EMERGENCY), "motor_3"),
    Scenario(
        "drive runs away",
        _inject(InjectedFault.DRIVE_RUNAWAY),
        "motor_3 applies",
        _wind_back,
        harms_tension=True,
        rest=2.0,
    ),
    Scenario(
        "winch blocked",
        _inject(InjectedFault.WINCH_BLOCKED),
        "motor_3",
        _wind_back,
        held=False,
        harms_tension=True,
        rest=2.0,
    ),
    Scenario(
        "controller without torque",
        _answer(lambda torque: 0.0),
        "motor_3",
        _wind_back,
        harms_tension=True,
        rest=2.0,
    ),
    Scenario("load cell silent", _inject(InjectedFault.LOAD_CELL_SILENT), "cable_3"),
    Scenario("load cell saturated", _inject(InjectedFault.LOAD_CELL_SATURATED), "cable_3"),
    Scenario("load cell stuck", _inject(InjectedFault.LOAD_CELL_STUCK), "cable_3", lasts=4.0),
    Scenario("load cell drifts", _inject(InjectedFault.LOAD_CELL_DRIFTING), "cable_3", lasts=8.0),
    Scenario("slack cable", _inject(InjectedFault.CABLE_SLACK), "cable", harms_tension=True, rest=2.0),
    Scenario(
        "drive pulls",
        _inject(InjectedFault.DRIVE_PULLING),
        "motor_3 applies",
        _wind_back,
        harms_tension=True,
        rest=2.0,
    ),
    Scenario(
        "overloaded cable",
        _lift_what_is_caught,
        "tension above its limit",
        onset=lambda graph: bool(graph.robot.plant.tensions().max() > graph.model.tension_max),
        moving=False,
        lasts=6.0,
        rest=2.0,
    ),
    Scenario(
        "overspeed",
        _hurry,
        "overspeed",
        onset=lambda graph: bool(
            np.abs(graph.robot.plant.motor_speeds()).max() > graph.model.motor.speed_limit
        ),
        moving=False,
        lasts=6.0,
    ),
    Scenario(
        "workspace left",
        _leave_workspace,
        "workspace",
        onset=lambda graph: bool(graph.robot.plant.platform_position()[1] > graph.model.workspace_max[1]),
        moving=False,
        lasts=12.0,
    ),
    Scenario("emergency stop", _inject(InjectedFault.EMERGENCY_STOP), "emergency stop"),
    Scenario(
        "operator's quick stop",
        lambda graph: graph.robot.drives.quick_stop("quick stop commanded"),
        "quick stop commanded",
    ),
    Scenario("bus cut", _inject(InjectedFault.BUS_CUT, "main"), "all drives: silent"),
    Scenario("bus-off", _inject(InjectedFault.BUS_OFF, "main"), "bus main: bus-off"),
    Scenario("interface down", _inject(InjectedFault.BUS_DOWN, "main"), "bus main: Network is down"),
    Scenario("interface removed", _inject(InjectedFault.BUS_REMOVED, "main"), "bus main: No such device"),
    Scenario("bus full of a babbling node's frames", _inject(InjectedFault.BUS_BABBLING, "main"), "silent"),
    Scenario("error frames", _inject(InjectedFault.BUS_ERROR_FRAMES, "main"), "silent"),
    Scenario(
        "recorder's disk full",
        lambda graph: graph.supervisor.observe_recording("no space left on device"),
        "no space left",
    ),
)


class FaultError(AssertionError):
    """A fault did not end as it must."""


def run(graph: SteppedGraph, scenario: Scenario, moving: bool = False) -> Outcome:
    """Let a fault happen to a robot that is enabled, see it end, and bring the robot back to being enabled.

    Raises
    ------
    FaultError
        If it ends otherwise than held, brakes closed, latched and named, or the robot cannot be brought back.
    """
    robot, plant = graph.robot, graph.robot.plant
    if moving:
        _move(graph)
    heights, tensions = [], []
    states: list[RobotState] = []
    closed_at: list[float] = []
    onset: list[float] = []

    def look() -> None:
        if not onset and scenario.onset(graph):
            onset.append(robot.now)
            heights.clear()
        heights.append(plant.platform_position()[2])
        states.append(graph.state)
        if not closed_at:
            tensions.append(plant.tensions().min())
            if not any(device.automaton.brake_open for device in robot.devices):
                closed_at.append(robot.now)

    begin = robot.now
    robot.on_tick = look
    look()
    scenario.begin(graph)
    while not (closed_at and graph.state is RobotState.FAULT):
        robot.wait(0.01)
        _require(robot.now - begin < scenario.lasts, f"not over after {scenario.lasts:g} s", graph)
    robot.wait(_SETTLING)
    robot.on_tick = lambda: None
    _require_held(graph, scenario)
    _require(bool(onset), "it has not happened", graph)
    duration, drop = closed_at[0] - onset[0], heights[0] - min(heights)
    _require(drop <= LARGEST_DROP, f"{1e3 * drop:.1f} mm of height lost", graph)
    cause = graph.cause
    scenario.end(graph)
    robot.wait(_SETTLING)
    _require_held(graph, scenario)
    return Outcome(
        cause, RobotState.STOPPING in states, duration, drop, min(tensions), recover(graph, scenario.rest)
    )


def recover(graph: SteppedGraph, rest: float) -> float:
    """Reset and enable as the operator does; return the largest movement of the platform meanwhile, m."""
    robot, plant = graph.robot, graph.robot.plant
    # devices that booted or were away are configured again before anything can be reset
    robot.wait_until(lambda: not robot.drives.snapshot().not_configured, "drives are not configured")
    robot.wait_until(
        lambda: not robot.load_cells.snapshot(robot.now).not_configured, "cells are not configured"
    )
    robot.wait(rest)
    decision = graph.order(graph.supervisor.reset)
    _require(decision.accepted, decision.message, graph)
    graph.wait_for(RobotState.DISABLED, 3.0)
    robot.wait(0.1)
    place = plant.platform_position()
    away = []
    robot.on_tick = lambda: away.append(float(np.linalg.norm(plant.platform_position() - place)))
    graph.enable()
    robot.wait(0.3)
    robot.on_tick = lambda: None
    _require(graph.state is RobotState.ENABLED, "not enabled again", graph)
    return max(away)


def _move(graph: SteppedGraph) -> None:
    """Bring the platform to full speed, level."""
    here = graph.player.held_pose
    assert here is not None
    there = Pose(np.array([math.copysign(0.4, -here.position[0] - 1e-9), 0.0, 1.0]), here.rotation)
    graph.start(PointToPoint(here, there, LIMITS))
    graph.robot.wait(graph.player.dwell + 1.0)


def _require_held(graph: SteppedGraph, scenario: Scenario) -> None:
    _require(graph.state is RobotState.FAULT, "not latched", graph)
    _require(scenario.cause in graph.cause, f"the cause does not name '{scenario.cause}'", graph)
    _require(not any(device.automaton.brake_open for device in graph.robot.devices), "a brake is open", graph)
    speed = float(np.abs(graph.robot.plant.motor_speeds()).max())
    _require(speed < 0.1, f"a motor turns at {speed:.2f} rad/s", graph)
    _require(not graph.supervisor.enable(graph.robot.now).accepted, "enable is accepted", graph)


def _require(condition: bool, problem: str, graph: SteppedGraph) -> None:
    if not condition:
        state, cause, _ = graph.robot.drives.states()
        raise FaultError(
            f"{problem}; robot {graph.state.value} ({graph.cause}), drives {state.value} ({cause})"
        )


class _Bench:
    """A robot that is enabled; another one after a scenario that failed."""

    def __init__(self) -> None:
        self._graph: SteppedGraph | None = None

    def outcome(self, scenario: Scenario, moving: bool) -> Outcome | str:
        """Return what became of a fault, or what went wrong."""
        if self._graph is None:
            self._graph = SteppedGraph(PAYLOAD)
            self._graph.enable()
        try:
            return run(self._graph, scenario, moving)
        except (FaultError, TimeoutError, RuntimeError) as failure:
            self.close()
            return f"FAILED: {failure}"

    def close(self) -> None:
        if self._graph is not None:
            self._graph.close()
            self._graph = None


def main() -> None:
    """Print the table as docs/operation.md has it."""
    print(f"{PAYLOAD:g} kg on a platform of 153 kg; held still and moving level at {LIMITS.speed:g} m/s")
    print("| fault | cause on `/robot_state` | stop | held: brakes, ms | height, mm ", end="")
    print("| moving: brakes, ms | height, mm | lowest tension, N |")
    print("|---|---|---|---|---|---|---|---|")
    bench = _Bench()
    for scenario in SCENARIOS:
        cause, way, cells, lowest = "", "", [], math.inf
        for moving, possible in ((False, scenario.held), (True, scenario.moving)):
            outcome = bench.outcome(scenario, moving) if possible else "- | -"
            if isinstance(outcome, str):
                cells.append(outcome)
                continue
            cause, lowest = outcome.cause, min(lowest, outcome.lowest_tension)
            way = "along the path" if outcome.controlled else "quick stop"
            way += ", then quick stop" if outcome.controlled and "; then " in cause else ""
            cells.append(f"{1e3 * outcome.duration:.0f} | {1e3 * max(outcome.drop, 0.0):.1f}")
        print(
            f"| {scenario.name} | {cause} | {way} | {' | '.join(cells)} | {max(lowest, 0.0):.0f} |",
            flush=True,
        )
    bench.close()


if __name__ == "__main__":
    main()
