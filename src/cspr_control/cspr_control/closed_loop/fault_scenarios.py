"""Every fault in simulated time: how it comes about, what it must end in, and how the operator brings the robot back.

Each one ends as each fault must: held, brakes closed, latched, with a named cause; then the operator's reset and
enable, and nothing else, bring the robot back without a jump.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np

from cspr_control.closed_loop.loop import ClosedLoop
from cspr_control.closed_loop.robot import SimulatedRobot
from cspr_control.reference.point_to_point import PointToPoint
from cspr_control.supervision.checks import MonitoredInput
from cspr_drivers.simulation.fault_injection import FaultOrder, InjectedFault
from cspr_kinematics import Pose
from cspr_msgs_py.topics import RECORDER_STATE, SETPOINT
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import Status

RobotLoop: TypeAlias = "ClosedLoop[SimulatedRobot]"
PLACE = 2  # the motor or cable, from 0, that has the fault
_NEW_POSE = 0.1  # s, age up to which the lengths fit a pose now
_SECOND_AFTER = 0.3  # s at most, from the first fault of a pair to the second
_WINDING = 2.0  # s that turning a drum back by hand may take


@dataclass(frozen=True)
class FaultScenario:
    """A fault.

    Attributes
    ----------
    name
        That of the injected fault, if it is one.
    begin
        Lets it happen.
    cause
        Words that the latched cause contains.
    end
        Ends it, before the operator resets.
    onset
        What makes it a fault, where that takes a while from `begin` on; time and height count from then.
    towards
        Where a robot that moves goes along x, -1 or 1.
    moving, held
        Whether it can happen to a robot that moves, and to one that is held still, and shows there.
    lasts
        Longest time until the brakes hold, s.
    settling
        Time from closed brakes until nothing moves any more, s.
    rest
        Time for the estimate of the payload to recover before the operator enables again, s.
    harms_tension
        Whether the fault itself takes the tension out of a cable.
    harmless
        Whether it is none: the robot must go on with its motion, which begins with it, as if nothing were.
    tolerable
        Whether the robot may bear it as well, and go on as it should.
    home_counts
        Position value of all drives at the home pose, if not those of can.yaml.
    happens
        Time from `begin` on in which all of it happens, s.
    faults
        Number of faults, each of which may cost the height that one may.
    """

    name: str
    begin: Callable[[RobotLoop], object]
    cause: str
    end: Callable[[RobotLoop], None] = lambda loop: loop.machine.faults.clear()
    onset: Callable[[RobotLoop], bool] = lambda loop: True
    towards: float = 1.0
    moving: bool = True
    held: bool = True
    lasts: float = 2.0
    settling: float = 0.2
    rest: float = 0.1
    harms_tension: bool = False
    harmless: bool = False
    tolerable: bool = False
    home_counts: int | None = None
    happens: float = 0.0
    faults: int = 1

    def is_named(self, cause: str) -> bool:
        """Return whether a latched cause names this fault."""
        return self.cause in cause


@dataclass(frozen=True)
class FaultPair(FaultScenario):
    """Two faults, the second shortly after the first; either may be the cause."""

    causes: tuple[str, str] = ("", "")

    def is_named(self, cause: str) -> bool:
        """Return whether a latched cause names one of them."""
        return any(words in cause for words in self.causes)


def fault_pairs(scenarios: Sequence[FaultScenario], number: int, seed: int) -> Iterator[FaultPair]:
    """Draw pairs of faults that can both happen to a robot that moves, or both to one that is held still.

    Parameters
    ----------
    scenarios
        Of which they are drawn; those that are motions of their own are left out, as is what is harmless.
    number, seed
        Of the draw.
    """
    generator = np.random.default_rng(seed)
    usable = [scenario for scenario in scenarios if scenario.moving and not scenario.harmless]
    for _ in range(number):
        first, second = (usable[index] for index in generator.choice(len(usable), 2, replace=False))
        yield _pair(first, second, delay=round(float(generator.uniform(0.0, _SECOND_AFTER)), 3))


def _pair(first: FaultScenario, second: FaultScenario, delay: float) -> FaultPair:
    def begin(loop: RobotLoop) -> None:
        def follow() -> None:
            second.begin(loop)

        first.begin(loop)
        loop.time.at(loop.time.monotonic() + delay, follow)

    def end(loop: RobotLoop) -> None:
        second.end(loop)
        first.end(loop)

    return FaultPair(
        f"{first.name} + {second.name} {1e3 * delay:.0f} ms later",
        begin,
        cause="",
        end=end,
        onset=first.onset,
        towards=first.towards,
        held=first.held and second.held,
        lasts=first.lasts + second.lasts,
        settling=max(first.settling, second.settling),
        rest=max(first.rest, second.rest),
        harms_tension=first.harms_tension or second.harms_tension,
        happens=delay,
        faults=2,
        causes=(first.cause, second.cause),
    )


def _answer(torque: Callable[[float], float | None]) -> Callable[[RobotLoop], None]:
    return lambda loop: loop.tampering.__setitem__(PLACE, torque)


def _heal_controllers(loop: RobotLoop) -> None:
    loop.tampering.clear()


def _stale_command(loop: RobotLoop) -> None:
    stamp = loop.time.system_ns() - 200_000_000
    loop.machine.drives.command(PLACE, stamp, -1.0)


def _second_controller(loop: RobotLoop) -> None:
    loop.machine.drives.command(PLACE, loop.supervisor.checks.stamp_ns, -1.0)


def _second_publisher(loop: RobotLoop) -> None:
    """Let somebody else publish a set-point, for the same motor states: all motors at their home position."""
    zero = np.zeros((3, loop.robot.number_of_cables))
    loop.publish(SETPOINT, JointStateSample(loop.supervisor.checks.stamp_ns, *zero))


def _unknown_motor(loop: RobotLoop) -> None:
    loop.machine.drives.reject_command(PLACE, "names are ('motor_9',)")


def _freeze(loop: RobotLoop) -> None:
    loop.machine.driver_runs = False
    loop.time.at(loop.time.monotonic() + 1.0, lambda: setattr(loop.machine, "driver_runs", True))


def _kill_supervisor(loop: RobotLoop) -> None:
    """Kill it; whoever watches over processes starts another half a second later."""
    loop.machine.faults.inject(FaultOrder(InjectedFault.SUPERVISOR_KILLED))
    loop.time.at(loop.time.monotonic() + 0.5, loop.machine.faults.clear)


def _leave_workspace(loop: RobotLoop) -> None:
    outside = Pose(loop.robot.workspace_max * (0.0, 1.0, 0.0) + (0.0, 0.2, 1.0), np.eye(3))
    quick = replace(loop.player.limits, speed=0.8, acceleration=1.0)
    loop.play(lambda here: PointToPoint(here, outside, quick))


def sideways(here: Pose, distance: float) -> Pose:
    """Return the pose so far along x, m, from another."""
    return Pose(here.position + np.array([distance, 0.0, 0.0]), here.rotation)


def _hurry(loop: RobotLoop) -> None:
    quick = replace(loop.player.limits, speed=1.0, acceleration=3.0)
    loop.play(lambda here: PointToPoint(here, sideways(here, 1.0), quick))


def _lift_what_is_caught(loop: RobotLoop) -> None:
    loop.machine.faults.inject(FaultOrder(InjectedFault.PLATFORM_CAUGHT))
    slow = replace(loop.player.limits, speed=0.05)
    up = np.array([0.0, 0.0, 0.3])
    loop.play(lambda here: PointToPoint(here, Pose(here.position + up, here.rotation), slow))


def _brake_closed(loop: RobotLoop) -> list[bool]:
    return [not device.automaton.brake_open for device in loop.machine.devices]


def _stop_on_a_bad_brake(loop: RobotLoop) -> None:
    """Let a brake hold too little, and stop the robot as the operator does: the load ends up on that brake."""
    loop.machine.faults.inject(FaultOrder(InjectedFault.BRAKE_SLIP, PLACE))
    loop.order("/supervisor/stop")


def _answer_again(loop: RobotLoop) -> None:
    """Let the drive answer as it should, once the driver has been told what it did instead."""
    told = loop.machine.not_set_up
    loop.wait_until(
        lambda: any("it answers with 2 bytes" in problem for problem in told().values()),
        5.0,
        lambda: f"cut answers are not told: {told()}",
    )
    loop.machine.faults.clear()


def wait_until_set_up(loop: RobotLoop) -> None:
    """Let time pass until devices that booted or were away are set up again; nothing can be reset before."""
    waiting = loop.machine.not_set_up
    loop.wait_until(lambda: not waiting(), 10.0, lambda: f"devices are not set up: {waiting()}")


def _wind_back(loop: RobotLoop) -> None:
    """Turn a drum by hand, slowly and with its brake lifted, until the lengths of all cables fit a pose."""
    loop.machine.faults.clear()
    _heal_controllers(loop)
    plant, time = loop.machine.plant, loop.time
    wait_until_set_up(loop)
    plant.set_brake(PLACE, closed=False)
    end, checks = time.monotonic() + _WINDING, loop.supervisor.checks
    while time.monotonic() < end:
        error = checks.following_errors()[PLACE]
        known = checks.age(MonitoredInput.PLATFORM_POSE, time.monotonic()) < _NEW_POSE
        if known and abs(error) <= 0.1:
            break
        # A cable that hangs slack fits no pose: it is wound in gently until it does.
        slack = not known and plant.tensions()[PLACE] < loop.robot.tension_min[PLACE]
        hand = -0.6 if slack else max(-2.5, min(2.5, 10.0 * error)) - 1.2
        plant.set_torque(PLACE, max(-2.5, hand) - 0.05 * plant.motor_speeds()[PLACE])
        time.wait(0.002)
    plant.set_brake(PLACE, closed=True)
    plant.set_torque(PLACE, 0.0)


def _injected(fault: InjectedFault, cause: str, place: int | str = PLACE, **how: Any) -> FaultScenario:
    order = FaultOrder(fault, place)
    return FaultScenario(fault.value, lambda loop: loop.machine.faults.inject(order), cause, **how)


_DRUM_TURNS: dict[str, Any] = {"end": _wind_back, "harms_tension": True, "rest": 2.0}

SCENARIOS = (
    FaultScenario("command_stale", _stale_command, "older than the command timeout"),
    FaultScenario("command_not_finite", _answer(lambda torque: math.nan), "not finite", _heal_controllers),
    FaultScenario(
        "command_beyond_limit", _answer(lambda torque: 50.0), "beyond the torque limit", _heal_controllers
    ),
    FaultScenario("command_for_unknown_motor", _unknown_motor, "unreadable"),
    FaultScenario("second_controller", _second_controller, "motor_3: two torque commands for one SYNC"),
    FaultScenario("second_publisher", _second_publisher, "two publishers: stamps of /setpoint"),
    FaultScenario("controller_killed", _answer(lambda torque: None), "motor_3", _heal_controllers),
    FaultScenario(
        "driver_frozen",
        _freeze,
        "stale topic",
        lambda loop: loop.wait_until(lambda: loop.machine.driver_runs, 2.0, lambda: "the driver hangs"),
        lasts=3.0,
    ),
    FaultScenario(
        "driver_killed",
        lambda loop: loop.machine.kill_driver(),
        "stale topic",
        lambda loop: loop.machine.restart_driver(),
        lasts=3.0,
    ),
    FaultScenario(
        InjectedFault.SUPERVISOR_KILLED.value, _kill_supervisor, "no sign of life of the supervisor"
    ),
    FaultScenario("driver_ended", lambda loop: loop.machine.drives.disable(), "by themselves"),
    _injected(InjectedFault.DRIVE_SILENT, "motor_3"),
    _injected(InjectedFault.DRIVE_NO_FEEDBACK, "motor_3"),
    _injected(InjectedFault.DRIVE_NO_HEARTBEAT, "motor_3"),
    _injected(InjectedFault.DRIVE_RESET, "motor_3"),
    _injected(InjectedFault.SHORT_SDO, "motor_3: restarted", end=_answer_again),
    _injected(InjectedFault.DRIVE_FAULT, "motor_3"),
    _injected(InjectedFault.DRIVE_WRONG_MODE, "motor_3"),
    _injected(InjectedFault.DRIVE_EMERGENCY, "motor_3"),
    _injected(InjectedFault.DRIVE_RUNAWAY, "motor_3 applies", **_DRUM_TURNS),
    _injected(
        InjectedFault.WINCH_BLOCKED,
        "motor_3",
        **_DRUM_TURNS,
        towards=-1.0,
        held=False,
    ),
    FaultScenario(
        InjectedFault.BRAKE_SLIP.value,
        _stop_on_a_bad_brake,
        "brake slips: motor_3 has turned",
        onset=lambda loop: any(_brake_closed(loop)),
        settling=1.5,
        **_DRUM_TURNS,
    ),
    _injected(InjectedFault.ENCODER_FROZEN, "encoder of motor_3", held=False),
    _injected(InjectedFault.ENCODER_DRIFT, "motor_3", rest=1.0),  # it drifts on while its brake is closed
    FaultScenario("controller_no_torque", _answer(lambda torque: 0.0), "motor_3", **_DRUM_TURNS),
    _injected(InjectedFault.ENCODER_JUMP, "motor_3: its position steps by"),
    # the counter ends after 8 revolutions, which the motion makes
    _injected(
        InjectedFault.ENCODER_WRAP,
        "",
        onset=lambda loop: loop.machine.devices[PLACE].value(0x6064) < 0,
        held=False,
        lasts=12.0,
        harmless=True,
        home_counts=2**31 - 8 * 131_072,
    ),
    FaultScenario(
        "clock_back",
        lambda loop: setattr(loop.time, "set_by", -3600.0),
        "",
        onset=lambda loop: loop.time.time_of_day_set_by() < 0.0,
        held=False,
        lasts=12.0,
        harmless=True,
    ),
    _injected(InjectedFault.DUPLICATE_NODE, "motor_3 answers one SYNC twice"),
    _injected(InjectedFault.LOAD_CELL_DOUBLED, "cable_3: answers one SYNC twice"),
    _injected(InjectedFault.LOAD_CELL_SILENT, "cable_3"),
    _injected(InjectedFault.LOAD_CELL_SATURATED, "cable_3"),
    _injected(InjectedFault.LOAD_CELL_STUCK, "cable_3", lasts=4.0),
    _injected(InjectedFault.LOAD_CELL_DRIFTING, "cable_3", lasts=8.0),
    # held still, the dry friction of a motor hides as much as this
    _injected(InjectedFault.LOAD_CELL_OFFSET, "cable_3 reads", held=False),
    _injected(InjectedFault.LOAD_CELL_ZERO, "cable_3 reads"),
    _injected(InjectedFault.LOAD_CELL_GAIN, "cable_3 reads", held=False),
    _injected(InjectedFault.CABLE_SLACK, "cable_3", harms_tension=True, rest=2.0),
    _injected(InjectedFault.DRIVE_PULLING, "motor_3 applies", **_DRUM_TURNS),
    FaultScenario(
        "platform_caught",
        _lift_what_is_caught,
        "tension above its limit",
        onset=lambda loop: bool((loop.machine.plant.tensions() > loop.robot.tension_max).any()),
        moving=False,
        lasts=6.0,
        rest=2.0,
    ),
    FaultScenario(
        "overspeed",
        _hurry,
        "overspeed",
        onset=lambda loop: bool(
            np.abs(loop.machine.plant.motor_speeds()).max() > loop.robot.motor.speed_limit
        ),
        moving=False,
        lasts=6.0,
    ),
    FaultScenario(
        "workspace_left",
        _leave_workspace,
        "workspace",
        onset=lambda loop: bool(loop.machine.plant.platform_position()[1] > loop.robot.workspace_max[1]),
        moving=False,
        lasts=12.0,
    ),
    _injected(InjectedFault.EMERGENCY_STOP, "emergency stop"),
    FaultScenario(
        "quick_stop",
        lambda loop: loop.machine.drives.quick_stop("quick stop commanded"),
        "quick stop commanded",
    ),
    _injected(InjectedFault.BUS_CUT, "all drives: silent", "main"),
    _injected(InjectedFault.BUS_OFF, "bus main: bus-off", "main"),
    _injected(InjectedFault.BUS_DOWN, "bus main: Network is down", "main"),
    _injected(InjectedFault.BUS_REMOVED, "bus main: No such device", "main"),
    _injected(InjectedFault.BUS_BABBLING, "silent", "main"),
    _injected(InjectedFault.BUS_ERROR_FRAMES, "silent", "main"),
    FaultScenario(
        "disk_full",
        lambda loop: loop.publish(
            RECORDER_STATE, Status("recorder", Level.ERROR, "failed", {"cause": "no space left on device"})
        ),
        "no space left",
    ),
)
