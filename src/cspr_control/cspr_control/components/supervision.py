"""The supervisor as a component of the graph."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, ClassVar

import numpy as np

from cspr_control.components.component import (
    NOTHING,
    Call,
    Component,
    Output,
    Outputs,
    Publication,
    Remark,
    Timer,
)
from cspr_control.estimation.sync_pairs import SyncPair, SyncPairs
from cspr_control.reference.verification_motion import LIMITS
from cspr_control.supervision.balance_check import BalanceCheck
from cspr_control.supervision.checks import MonitoredInput, SupervisionLimits
from cspr_control.supervision.holding_check import HoldingCheck
from cspr_control.supervision.length_check import LengthCheck
from cspr_control.supervision.stamp_order import StampOrder
from cspr_control.supervision.supervisor import Action, Decision, Supervisor
from cspr_control.supervision.verification import Verdict, Verification
from cspr_control.supervision.verified_configuration import VerifiedConfiguration
from cspr_kinematics import Robot
from cspr_msgs_py.errors import failure_text
from cspr_msgs_py.topics import (
    CABLE_TENSIONS,
    DIAGNOSTICS,
    DRIVE_STATES,
    LOAD_CELL_CHECK,
    LOAD_CELL_STATES,
    MOTOR_STATES,
    PAYLOAD,
    PLATFORM_POSE,
    RECORDER_STATE,
    REFERENCE,
    ROBOT_STATE,
    SETPOINT,
    SUPERVISOR_ALIVE,
    TRAJECTORY_STATE,
    Topic,
    graph_topics,
)
from cspr_msgs_py.vocabulary import FOLLOWING, DriverState, HealthKey, Level, RobotState, TrajectoryPhase
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.reference import ReferenceSample
from cspr_msgs_py.wire.samples import InertiaSample, PoseSample, SignOfLife, Status, StatusArray

PERIOD = 0.02
"""Of the checks, s."""

SERVICES = {
    Action.ENABLE_DRIVES: "/can_drives/enable",
    Action.DISABLE_DRIVES: "/can_drives/disable",
    Action.QUICK_STOP: "/can_drives/quick_stop",
    Action.RESET_DRIVES: "/can_drives/fault_reset",
    Action.STOP_TRAJECTORY: "/trajectory_publisher/stop",
    Action.MOVE_TO_VERIFY: "/trajectory_publisher/verify",
}
"""Which service does what the supervisor asks of others."""

_BRAKED = (RobotState.DISABLED, RobotState.FAULT)
"""States of a robot that hangs on its brakes."""

_LOOKING = 1.0
"""Between two looks for second publishers, s."""

_NOT_NEEDED = ("*", "recorder", "robot_markers", "simulated_robot", "demo")
"""Writers of topics without which the robot can do; the recorder has a word of its own."""

_ACTIONS = {service: action for action, service in SERVICES.items()}


class SupervisionComponent(Component):
    """Watches the graph, decides with the state machine, and publishes the robot's state.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    limits
        Limits beyond which the robot is stopped.
    record
        Which configuration has been verified; where nobody keeps that, no verification is required.
    doubled
        Tells, in words, which topics with one writer have more publishers; asked once a second and before enabling.
    """

    inputs: ClassVar[tuple[Topic, ...]] = (
        MOTOR_STATES,
        REFERENCE,
        SETPOINT,
        CABLE_TENSIONS,
        PLATFORM_POSE,
        PAYLOAD,
        ROBOT_STATE,
        SUPERVISOR_ALIVE,
        DRIVE_STATES,
        LOAD_CELL_STATES,
        LOAD_CELL_CHECK,
        TRAJECTORY_STATE,
        RECORDER_STATE,
        DIAGNOSTICS,
    )
    calls: ClassVar[tuple[str, ...]] = tuple(SERVICES.values())

    def __init__(
        self,
        robot: Robot,
        limits: SupervisionLimits,
        doubled: Callable[[], Sequence[str]] = lambda: (),
        record: VerifiedConfiguration | None = None,
    ) -> None:
        super().__init__("supervisor", ROBOT_STATE, SUPERVISOR_ALIVE)
        m = robot.number_of_cables
        self._robot = robot
        self.supervisor = Supervisor(m, limits)
        self.lengths = LengthCheck(robot, limits)
        self.balance = BalanceCheck(robot, limits.balance)
        self.holding = HoldingCheck(robot, limits.balance.torque_accuracy)
        self._pairs = SyncPairs()
        self._speeds = np.zeros(m)  # of the newest motor states, rad/s
        self._record = record if limits.verification_required else None
        self._configuration = ""  # of drives and load cells, as their driver tells it
        self._verification: Verification | None = None
        self._judging: Iterator[Verdict | None] | None = None
        self._order = StampOrder()
        self._doubled = doubled
        self._watched = {topic.writer for topic in graph_topics(m)} - {self.name, *_NOT_NEEDED}
        self._recorder_problem = ""
        self._published_state: tuple[object, ...] = ()

    def configure(self, limits: SupervisionLimits) -> None:
        """Expect another load from now on."""
        self.balance.settings = limits.balance

    def begin(self) -> Outputs:
        """Return the state in which the robot begins, and which check is absent."""
        absent = self.lengths.absent
        remarks = [Remark(self.name, Level.WARN, f"absent check: {absent}")] if absent else []
        return [*remarks, *self._state_if_changed()]

    def timers(self) -> tuple[Timer, ...]:
        """Return the checks and the report."""
        looking = Timer(_LOOKING, self.look_for_publishers)
        return (*super().timers(), Timer(PERIOD, self.watch), looking)

    def services(self) -> Mapping[str, Callable[[float], tuple[Decision, Outputs]]]:
        """Return ``enable``, ``verify``, ``stop`` and ``reset``."""
        commands = (self.enable, self.verify, self.supervisor.stop, self.supervisor.reset)
        return {f"/{self.name}/{command.__name__}": partial(self._command, command) for command in commands}

    def enable(self, now: float) -> Decision:
        """Operator's command to enable the robot; see `Supervisor.enable`."""
        self._look(now)
        return self.supervisor.enable(now)

    def verify(self, now: float) -> Decision:
        """Operator's command to verify the configuration; see `Supervisor.verify`."""
        settings = self.balance.settings
        if settings.declared_load < 0.0:
            said = "ros2 param set /supervisor declared_load 0.0, or as many kg as hang from the platform"
            return Decision(False, f"refused: declare the load first: {said}")
        if (first := self.holding.before) is None:
            return Decision(False, "refused: no motor states and tensions of one SYNC have come")
        self._look(now)
        self.supervisor.balance_problem = self.balance.problem(now, weight_alone=True)
        decision = self.supervisor.verify(now)
        if decision.accepted:
            self._verification = Verification(self._robot, settings, first, LIMITS.speed)
            self._judging = None
        return decision

    def _look(self, now: float) -> None:
        """Look for what speaks against enabling, and takes too long for every cycle."""
        supervisor = self.supervisor
        supervisor.unverified = self._record.problem(self._configuration) if self._record else ""
        supervisor.doubled_topics = "; ".join(self._doubled())
        supervisor.slack_problem = ""
        supervisor.balance_problem = self.balance.problem(now)
        if supervisor.state is RobotState.DISABLED:  # brakes are closed: there is time
            supervisor.slack_problem = supervisor.checks.slack_problem(self._robot, supervisor.behind)

    def _command(self, command: Callable[[float], Decision], now: float) -> tuple[Decision, Outputs]:
        decision = command(now)
        remark = Remark(self.name, Level.OK, f"{command.__name__}: {decision.message}")
        return decision, [remark, *self.update(now)]

    def on_motor_states(self, now: float, sample: JointStateSample) -> Outputs:
        """Store the motor states for the next check; run the checks at once when the lengths no longer fit."""
        errors = self.supervisor.checks.observe_motors(now, sample)
        begun = self.lengths.observe_motors(now, sample, errors)
        doubled = self._order.observe(now, MOTOR_STATES, sample.stamp_ns)
        self._speeds = sample.velocity
        begun = self._observe_pair(now, self._pairs.motors(sample)) or begun
        return self.update(now) if begun or doubled else NOTHING

    def on_reference(self, now: float, sample: ReferenceSample) -> Outputs:
        """Note that there is a reference."""
        self.supervisor.checks.observe_arrival(MonitoredInput.REFERENCE, now)
        return self._in_order(now, REFERENCE, sample.stamp_ns)

    def on_setpoint(self, now: float, sample: JointStateSample) -> Outputs:
        """Store the set-point for the next check; run the checks at once when no motor can follow it."""
        stepped = self.supervisor.checks.observe_setpoint(now, sample)
        doubled = self._order.observe(now, SETPOINT, sample.stamp_ns)
        return self.update(now) if stepped or doubled else NOTHING

    def on_cable_tensions(self, now: float, sample: JointStateSample) -> Outputs:
        """Store the tensions for the next check; run the checks at once when the lengths no longer fit."""
        self.supervisor.checks.observe_tensions(now, sample.effort)
        begun = self.lengths.observe_tensions(now, sample)
        doubled = self._order.observe(now, CABLE_TENSIONS, sample.stamp_ns)
        begun = self._observe_pair(now, self._pairs.tensions(sample.stamp_ns, sample.effort)) or begun
        return self.update(now) if begun or doubled else NOTHING

    def _observe_pair(self, now: float, pair: SyncPair | None) -> bool:
        """Take what a SYNC brought; return whether it contradicts the configuration."""
        if pair is None:
            return False
        supervisor = self.supervisor
        if supervisor.state in _BRAKED:
            self.balance.observe(now, pair)
            self.holding.observe_braked(pair)
        elif supervisor.state is RobotState.ENABLED:
            found = self.holding.observe_enabled(now, pair, supervisor.checks.setpoints_at_rest())
            if supervisor.verifying and self._verification is not None:
                supervisor.verification_problem = self._verification.observe(pair, self._speeds)
            return found or bool(supervisor.verification_problem)
        return False

    def _judge(self, now: float) -> Outputs:
        """Go on judging a verification whose motion is over, a little at a time."""
        supervisor = self.supervisor
        if self._verification is None or supervisor.state not in _BRAKED or not supervisor.verifying:
            return NOTHING
        supervisor.verification_problem = ""
        self._judging = self._judging or self._verification.judge()
        verdict = next(self._judging)
        if verdict is None:
            return NOTHING
        self._verification = self._judging = None
        remark = "" if supervisor.remark or supervisor.fault else "verification: interrupted"
        if supervisor.verification_complete and not verdict.findings and supervisor.fault is None:
            problem = self._record.confirm(self._configuration) if self._record else ""
            remark = "; ".join(filter(None, ("verified", verdict.remark, problem)))
        supervisor.verified(now, verdict.findings, remark)
        level = Level.ERROR if verdict.findings else Level.OK
        said = Remark(
            self.name, level, f"verification: {verdict.findings or supervisor.remark or 'nothing found'}"
        )
        return [said, *self._state_if_changed()]

    def on_platform_pose(self, now: float, sample: PoseSample) -> Outputs:
        """Store where the platform is."""
        self.supervisor.checks.observe_pose(now, sample.position, sample.quaternion_xyzw)
        return self._in_order(now, PLATFORM_POSE, sample.stamp_ns)

    def _in_order(self, now: float, topic: Topic, stamp_ns: int, content: Hashable = None) -> Outputs:
        """Note the stamp of a message; run the checks at once when it repeats or goes back."""
        return self.update(now) if self._order.observe(now, topic, stamp_ns, content) else NOTHING

    def on_payload(self, now: float, sample: InertiaSample) -> Outputs:
        """Run the checks at once when the stamps go back, or one comes again with another payload."""
        return self._in_order(now, PAYLOAD, sample.stamp_ns, (sample.mass, *sample.center_of_mass.tolist()))

    def on_supervisor_alive(self, now: float, sample: SignOfLife) -> Outputs:
        """Run the checks at once when another supervisor lives."""
        return self.update(now) if self._order.heard(now, SUPERVISOR_ALIVE, sample.stamp_ns) else NOTHING

    def on_robot_state(self, now: float, sample: Status) -> Outputs:
        """Run the checks at once when somebody else says how the robot is."""
        return self.update(now) if self._order.heard(now, ROBOT_STATE, _said(sample)) else NOTHING

    def look_for_publishers(self, now: float) -> Outputs:
        """Ask who publishes on topics that have one writer; run the checks at once when there are more."""
        self.supervisor.doubled_topics = "; ".join(self._doubled())
        return self.update(now) if self.supervisor.doubled_topics else NOTHING

    def on_drive_states(self, now: float, sample: StatusArray) -> Outputs:
        """Store the state of the drives, and run the checks at once."""
        status = sample.find("can_drives")
        if status is None:
            self.refuse(DRIVE_STATES, f"{DRIVE_STATES.name} carries no status named can_drives")
            return NOTHING
        drives = self.read_word(DRIVE_STATES, DriverState, status.message)
        if drives is None:
            return NOTHING
        self._configuration = status.values.get("configuration", "")
        self.supervisor.observe_drives(now, drives, status.values.get("cause", ""))
        self.supervisor.brake_problem = self._slips(sample)
        return self.update(now)

    def _slips(self, sample: StatusArray) -> str:
        """Return which motors turn with their brakes closed, and by how much cable, in words."""
        slips = []
        for status in sample.statuses:
            if angle := status.values.get("slipped_rad", ""):
                try:
                    paid_out = 1e3 * self._robot.winch.transmission_ratio * float(angle)
                except ValueError:
                    self.refuse(DRIVE_STATES, f"{status.name}: slipped_rad is {angle!r}")
                    continue
                slips.append(f"{status.name} has turned by {angle} rad, {paid_out:+.0f} mm of cable")
        return f"{'; '.join(slips)}, with its brake closed" if slips else ""

    def on_diagnostics(self, now: float, sample: StatusArray) -> Outputs:
        """Note which nodes of the graph are alive, and what has gone wrong in them; then run the checks at once."""
        failed = False
        for status in sample.statuses:
            if status.name in self._watched:
                failure = status.values.get(HealthKey.FAILURE, "")
                self.supervisor.checks.observe_node(now, status.name, failure)
                failed = failed or bool(failure)
            if unexplained := status.values.get(HealthKey.CELLS_UNEXPLAINED, ""):
                with suppress(ValueError):
                    self.supervisor.checks.observe_balance(now, float(unexplained))
        return self.update(now) if failed else NOTHING

    def on_load_cell_states(self, now: float, sample: StatusArray) -> Outputs:
        """Store what the driver of the load cells finds, and run the checks at once."""
        status = sample.find("load_cells")
        if status is None:
            self.refuse(LOAD_CELL_STATES, f"{LOAD_CELL_STATES.name} carries no status named load_cells")
            return NOTHING
        self.supervisor.load_cell_problem = status.values.get("cause", "")
        return self.update(now)

    def on_load_cell_check(self, now: float, sample: Status) -> Outputs:
        """Store which load cell the balance of the platform contradicts, and run the checks at once."""
        self.supervisor.load_cell_doubt = sample.values.get("cause", "")
        return self.update(now)

    def on_trajectory_state(self, now: float, sample: Status) -> Outputs:
        """Store the phase of the trajectory."""
        phase = self.read_word(TRAJECTORY_STATE, TrajectoryPhase, sample.message)
        self.supervisor.phase = phase or self.supervisor.phase
        return NOTHING

    def on_recorder_state(self, now: float, sample: Status) -> Outputs:
        """Store whether the recorder still records."""
        problem = sample.values.get("cause", "") if sample.level >= Level.ERROR else ""
        self._recorder_problem = problem
        self.supervisor.recording_problem = problem
        if not problem:
            return NOTHING
        return [Remark(self.name, Level.ERROR, f"recorder: {problem}"), *self.update(now)]

    def answered(self, now: float, call: Call, accepted: bool, message: str) -> Outputs:
        """Store the answer to an action, and run the checks at once."""
        action = _ACTIONS[call.service]
        self.supervisor.answered(now, action, accepted, message)
        remark = () if accepted else (Remark(self.name, Level.WARN, f"{action.value}: {message}"),)
        return [*remark, *self.update(now)]

    def update(self, now: float) -> Outputs:
        """Run the checks; return the calls of other nodes' services, and the robot's state if it has changed."""
        supervisor = self.supervisor
        before = supervisor.state
        supervisor.publisher_problem = self._order.problem(now)
        supervisor.length_problem = self.lengths.problem(supervisor.checks.following_errors())
        if supervisor.length_problem and (turned := self.holding.turned_wrongly(now)):
            supervisor.length_problem += f"; {turned}"
        supervisor.torque_problem = self.holding.problem
        outputs: list[Output] = [Call(self.name, SERVICES[action]) for action in supervisor.update(now)]
        if supervisor.state is not before and supervisor.fault is not None:
            outputs.append(Remark(self.name, Level.ERROR, f"stopped by {supervisor.fault}"))
        return [*outputs, *self._state_if_changed()]

    def failed(self, now: float, error: Exception) -> Outputs:
        """Stop the drives: nobody watches the robot while its supervisor fails."""
        self.supervisor.fail(now, f"{self.name}: {failure_text(error)}")
        calls = [Call(self.name, SERVICES[action]) for action in self.supervisor.take_actions()]
        return [*calls, *self._state_if_changed(), *super().failed(now, error)]

    def watch(self, now: float) -> Outputs:
        """Run the checks, and say that they have been run."""
        outputs = [*self.update(now), *self._judge(now)]
        alive = SignOfLife(self.supervisor.checks.stamp_ns)
        self._order.sent(SUPERVISOR_ALIVE, alive.stamp_ns)
        return [*outputs, Publication(SUPERVISOR_ALIVE, alive)]

    def make_safe(self) -> Outputs:
        """Return what closes the brakes of a robot that is enabled: with the supervisor goes what watches it."""
        if self.supervisor.state not in FOLLOWING - {RobotState.HELD_BY_DRIVES}:
            return NOTHING  # torque that holds what a brake does not is not taken away
        return (Call(self.name, SERVICES[Action.QUICK_STOP]),)

    def _state_if_changed(self) -> Outputs:
        supervisor = self.supervisor
        cause = str(supervisor.fault) if supervisor.fault else ""
        values = {"cause": cause, "remark": supervisor.remark}
        if (supervisor.state, values) == self._published_state:
            return NOTHING
        self._published_state = supervisor.state, values
        bad = supervisor.state in (RobotState.FAULT, RobotState.HELD_BY_DRIVES)
        level = Level.ERROR if bad else Level.OK
        status = self._status(level, supervisor.state.value, values)
        self._order.sent(ROBOT_STATE, _said(status))
        return (Publication(ROBOT_STATE, status),)

    def status(self, now: float) -> Status:
        """Return the state, what is wrong, how old the inputs are, and how well the lengths of the cables fit."""
        supervisor = self.supervisor
        level, text = Level.OK, supervisor.state.value
        if supervisor.fault is not None:
            level, text = Level.ERROR, f"fault: {supervisor.fault}"
        elif self._recorder_problem:
            level, text = Level.WARN, f"{text}; recorder: {self._recorder_problem}"
        ages = {source: supervisor.checks.age(source, now) for source in MonitoredInput}
        values: dict[str, Any] = {
            f"age_{source.name.lower()}": f"{age:.3f}" for source, age in ages.items() if math.isfinite(age)
        }
        if math.isfinite(load := self.balance.load):
            values["load_when_braked"] = f"{load:z.2f}"
        values |= self.lengths.values() | {"unusable_messages": self.unusable, "last_problem": self.problem}
        return self._status(level, text, values)


def watched_topics(number_of_motors: int) -> tuple[Topic, ...]:
    """Return the topics that must have one publisher each."""
    return tuple(topic for topic in graph_topics(number_of_motors) if topic.writer not in _NOT_NEEDED)


def _said(status: Status) -> Hashable:
    return status.message, frozenset(status.values.items())
