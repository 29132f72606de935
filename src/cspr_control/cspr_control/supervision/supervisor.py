"""The supervisor's state machine: what the operator may do, and what happens when something is wrong.

Pure: it takes what happened and when, and returns actions for its node to carry out. No path leads
from a fault, or from disabled, to enabled without the operator's command.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np

from cspr_control.supervision.checks import (
    Fault,
    FaultKind,
    MonitoredInput,
    SupervisionChecks,
    SupervisionLimits,
)
from cspr_msgs_py.vocabulary import DriverState, RobotState, TrajectoryPhase

_MOVING = (DriverState.WINDING, DriverState.ENABLING, DriverState.ENABLED, DriverState.STOPPING)

_HELD = 0.7
"""Time for which a robot that is verified is held first, s: torque and tension are compared meanwhile."""

_INSISTENCE = 0.2
"""Time after which a quick stop that has not worked is repeated, s."""


class Action(Enum):
    """What the supervisor asks of others."""

    ENABLE_DRIVES = "enable the drives"
    STOP_TRAJECTORY = "stop the trajectory"
    DISABLE_DRIVES = "disable the drives"
    QUICK_STOP = "quick stop the drives"
    RESET_DRIVES = "reset the drives' fault"
    MOVE_TO_VERIFY = "move to and fro"


@dataclass(frozen=True)
class Decision:
    """Answer to a command of the operator."""

    accepted: bool
    message: str


class Supervisor:
    """State machine of the robot.

    The node calls `update` regularly, and after each command and observation that matters; it carries out the
    actions returned, and reports the answers with `answered`. Times are monotonic, s.

    Parameters
    ----------
    count
        Number m of motors and cables.
    limits
        Limits beyond which the robot is stopped.

    Attributes
    ----------
    state
        State of the robot.
    fault
        What is latched; None outside the state FAULT and the stop that leads to it.
    remark
        Why the last enabling came to nothing without a fault; else empty.
    checks
        The watched inputs, to be told what arrives.
    phase
        What the reference does; to be set.
    recording_problem
        News, not yet checked, that the recording has failed, and why; to be set, and empty when it goes on.
    load_cell_problem
        What is wrong with the load cells, as their driver finds it; to be set, and empty when all is well.
    load_cell_doubt
        What is wrong with them as the balance of the platform and the motors find it; likewise.
    length_problem
        Why the cables' lengths fit no pose, or not well; likewise.
    publisher_problem
        Which topics have more than one publisher, as their messages show; likewise.
    doubled_topics
        Which topics have them, though nothing shows of it yet; likewise.
    brake_problem
        Which motors turn with their brakes closed, and how far; likewise.
    balance_problem
        Why the tensions fit no load, while the brakes are closed; likewise.
    torque_problem
        Why the torque of a motor does not fit the tension of its cable; likewise.
    unverified
        Why the configuration must be verified first; likewise.
    verification_problem
        What a verification that is under way must not go on with; likewise.
    verifying
        Whether the robot is verified, until that is judged.
    verification_complete
        Whether its motion came to its end.
    slack_problem
        Which slack cable has to be wound in before lengths can fit again; likewise.
    behind
        How far the motors were from their set-points when the robot was last stopped by a fault (m,), rad.
    """

    def __init__(self, count: int, limits: SupervisionLimits) -> None:
        self.state = RobotState.DISABLED
        self.fault: Fault | None = None
        self.remark = ""
        self.checks = SupervisionChecks(count, limits)
        self._limits = limits
        self._drives: DriverState | None = None
        self._drives_cause = ""
        self.phase = TrajectoryPhase.IDLE
        self._since = -math.inf  # of the state, or of the step within STOPPING
        self._trajectory_stopped = False
        self._disabling = False
        self._resetting = False
        self.recording_problem = ""
        self.load_cell_problem = self.load_cell_doubt = self.length_problem = self.publisher_problem = ""
        self.slack_problem = self.doubled_topics = self.brake_problem = ""
        self._stopped_by: Fault | None = None  # what was latched before the drives had to hold the load
        self._before_slip: Fault | None = None  # what was latched when a brake began to slip
        self.balance_problem = self.torque_problem = self.unverified = self.verification_problem = ""
        self.verifying = self.verification_complete = False
        self._asked_to_move = self._moves = False
        self.behind = np.zeros(count)
        self._quick_stop_time = -math.inf
        self._actions: list[Action] = []

    def enable(self, time: float) -> Decision:
        """Operator's command to open the brakes and let the motors follow their set-points."""
        if self.state is RobotState.HELD_BY_DRIVES:
            return self._enable_again(time)
        if self.state is not RobotState.DISABLED:
            latched = f" by {self.fault}; reset it first" if self.fault else ""
            return Decision(False, f"refused: the robot is in state {self.state.value}{latched}")
        obstacle = self.checks.obstacle(time)
        if self.verifying:
            obstacle = "what the verification has measured is being judged"
        if self.slack_problem and (self.length_problem or self.checks.lengths_unclear(time)):
            obstacle = self.slack_problem
        if self._drives is DriverState.WINDING:
            obstacle = self._drives_are()
        if problem := self.publisher_problem or self.doubled_topics:  # what else is wrong may come of it
            obstacle = str(Fault(FaultKind.PUBLISHERS, problem))
        if obstacle is None and (problem := self.load_cell_problem or self.load_cell_doubt):
            obstacle = f"load cells: {problem}"
        if obstacle is None and self.length_problem:
            obstacle = str(Fault(FaultKind.LENGTHS, self.length_problem))
        if obstacle is None and self.balance_problem:
            obstacle = self.balance_problem
        if obstacle is None and self.unverified:
            obstacle = f"{self.unverified}: call /supervisor/verify, with the load declared"
        if obstacle is None and self._drives is not DriverState.DISABLED:
            obstacle = self._drives_are()
        if obstacle is None and not self.phase.at_rest:
            obstacle = f"the trajectory is in phase {self.phase.value}"
        if obstacle is not None:
            return Decision(False, f"refused: {obstacle}")
        self.remark = ""
        self.behind = np.zeros_like(self.behind)
        self.recording_problem = ""  # an operator who enables without a recording does not want one
        self.checks.clear()
        self._enter(RobotState.ENABLING, time)
        self._actions.append(Action.ENABLE_DRIVES)
        return Decision(True, "enabling the drives")

    def verify(self, time: float) -> Decision:
        """Operator's command to enable the robot, move it a little and slowly, disable it, and judge what was seen."""
        unverified, self.unverified = self.unverified, ""
        decision = self.enable(time)
        self.unverified = unverified
        if decision.accepted:
            self.verifying = True
            self.verification_complete = self._asked_to_move = self._moves = False
            return Decision(True, "enabling the drives; then the platform moves by 50 mm to and fro for 25 s")
        return decision

    def verified(self, time: float, findings: str, remark: str) -> None:
        """Process what a verification found, in words, brakes closed: that is a fault; or nothing, and a remark."""
        self.verifying = False
        if findings and self.fault is not None:
            self.fault = Fault(
                self.fault.kind, f"{self.fault.detail}; verification: {findings}", self.fault.controlled
            )
        elif findings:
            self.fault = Fault(FaultKind.CONFIGURATION, findings, controlled=True)
            self._enter(RobotState.FAULT, time)
        else:
            self.remark = remark or self.remark

    def _enable_again(self, time: float) -> Decision:
        """Let the drives, which hold the load anyway, open the brakes, so that the operator can let it down."""
        if obstacle := self.checks.obstacle(time):
            return Decision(False, f"refused: {obstacle}")
        self.fault = None
        self.verifying = False
        self.checks.clear()
        self._enter(RobotState.ENABLING, time)
        self._actions.append(Action.ENABLE_DRIVES)
        return Decision(True, "opening the brakes again: let the load down on its supports, then stop")

    def stop(self, time: float) -> Decision:
        """Operator's command to come to rest along the path and close the brakes."""
        if self.state is RobotState.ENABLED:
            self._stop_along_path(time)
            return Decision(True, "stopping along the path, then closing the brakes")
        if self.state is RobotState.ENABLING:
            self._enter(RobotState.STOPPING, time)
            self._disable_drives(time)
            return Decision(True, "closing the brakes")
        if self.state is RobotState.HELD_BY_DRIVES:
            self.fault = None
            self._enter(RobotState.STOPPING, time)
            self._disable_drives(time)
            return Decision(True, "testing the brakes again")
        if self.state is RobotState.STOPPING:
            return Decision(True, "stopping already")
        if self._drives is DriverState.WINDING:
            self._actions.append(Action.DISABLE_DRIVES)
            return Decision(True, f"closing the brake: {self._drives_cause}")
        return Decision(True, f"nothing to stop: the robot is in state {self.state.value}")

    def reset(self, time: float) -> Decision:
        """Operator's command to forget the fault; the robot is disabled once the drives have none either."""
        if self.state is not RobotState.FAULT:
            return Decision(False, f"refused: no fault is latched, the robot is in state {self.state.value}")
        if self._drives in _MOVING:
            return Decision(False, f"refused: the drives are in state {self._drives.value}, not yet stopped")
        self._resetting = True
        self._since = time
        self._actions.append(Action.RESET_DRIVES)
        return Decision(True, "resetting the fault; enable the robot anew when its state is disabled")

    def observe_drives(self, time: float, state: DriverState, cause: str = "") -> None:
        """Store the state of the drives."""
        self.checks.observe_arrival(MonitoredInput.DRIVE_STATES, time)
        self._drives, self._drives_cause = state, cause

    def answered(self, time: float, action: Action, accepted: bool, message: str) -> None:
        """Process the answer to an action; no answer counts as refused."""
        if action is Action.STOP_TRAJECTORY:
            # Refused or unheard: rather close the brakes while the reference moves than not at all.
            self._trajectory_stopped = True
            if not accepted and self.state is RobotState.STOPPING and not self._disabling:
                self._disable_drives(time)
        elif accepted:
            return
        elif action is Action.ENABLE_DRIVES and self.state is RobotState.ENABLING:
            self.remark = f"the drives were not enabled: {message}"
            self._enter(RobotState.DISABLED, time)
        elif action is Action.MOVE_TO_VERIFY and self.state is RobotState.ENABLED:
            self.remark = f"verification: the platform did not move: {message}"
            self._stop_along_path(time)
        elif action is Action.DISABLE_DRIVES and self.state is RobotState.STOPPING:
            self._fail(time, Fault(FaultKind.DRIVE_STATE, f"the drives refused to disable: {message}"))
        elif action is Action.RESET_DRIVES and self._resetting:
            self._resetting = False
            self.fault, self._before_slip = (
                Fault(FaultKind.DRIVE_FAULT, f"the drives were not reset: {message}"),
                None,
            )

    def fail(self, time: float, problem: str) -> None:
        """Latch that the supervisor itself cannot be relied on, and stop the drives."""
        if self.state not in (RobotState.FAULT, RobotState.HELD_BY_DRIVES):
            self._fail(time, Fault(FaultKind.NODE, problem))

    def update(self, time: float) -> tuple[Action, ...]:
        """Run the checks and return what is to be done, in this order."""
        if self.state is RobotState.FAULT:
            self._update_fault(time)
            self._tell_slip()
        elif self.state is RobotState.HELD_BY_DRIVES:
            self._update_held(time)
        else:
            fault = self._find_fault(time)
            if fault is not None and fault.controlled and self.state is not RobotState.ENABLING:
                self._stop_for(fault, time)
            elif fault is not None:
                self._fail(time, fault)
            elif self.state is RobotState.ENABLING and self._drives is DriverState.ENABLED:
                self._enter(RobotState.ENABLED, time)
            elif self.state is RobotState.ENABLED and self.verifying:
                self._update_verification(time)
            if self.state is RobotState.STOPPING:
                self._update_stopping(time)
        return self.take_actions()

    def take_actions(self) -> tuple[Action, ...]:
        """Return what is to be done, in this order, and was not returned before."""
        actions = tuple(self._actions)
        self._actions.clear()
        return actions

    def _update_verification(self, time: float) -> None:
        """Ask for the motion when the robot has been held for a while, and disable it when that is over."""
        if not self._asked_to_move:
            if time - self._since >= _HELD:
                self._asked_to_move = True
                self._actions.append(Action.MOVE_TO_VERIFY)
        elif not self.phase.at_rest:
            self._moves = True
        elif self._moves:
            self.verification_complete = self.phase is TrajectoryPhase.FINISHED
            self._stop_along_path(time)

    def _tell_slip(self) -> None:
        """Say of a brake that slips how far it has by now, besides what was latched before."""
        if not self.brake_problem or self.fault is None:
            return
        if self.fault.kind is not FaultKind.BRAKE and self._before_slip is None:
            self._before_slip = self.fault
        slip, first = Fault(FaultKind.BRAKE, self.brake_problem), self._before_slip
        self.fault = slip if first is None else Fault(first.kind, f"{first.detail}; then {slip}")

    def _find_fault(self, time: float) -> Fault | None:
        if self.brake_problem:
            return Fault(FaultKind.BRAKE, self.brake_problem)
        if self._drives is DriverState.FAULT:
            cause = self._drives_cause or "reported by the driver without a cause"
            return Fault(FaultKind.DRIVE_FAULT, cause)
        if self.state is RobotState.DISABLED:
            unasked = Fault(FaultKind.DRIVE_STATE, "the drives are enabled although nobody enabled the robot")
            return unasked if self._drives is DriverState.ENABLED else None
        stopping = self.state is RobotState.STOPPING and not self._disabling
        following = self.state is RobotState.ENABLED or stopping
        checks = self.checks
        faults = checks.stale(time) + checks.failed_nodes(time) + checks.excess(time, following)
        if self.length_problem:  # the path itself is not known: nothing can come to rest along it
            faults.append(Fault(FaultKind.LENGTHS, self.length_problem))
        if self.publisher_problem:  # what else is wrong may come of it
            faults.insert(0, Fault(FaultKind.PUBLISHERS, self.publisher_problem))
        if self.doubled_topics:  # messages that all fit are no reason for more than to come to rest
            faults.insert(0, Fault(FaultKind.PUBLISHERS, self.doubled_topics, controlled=True))
        urgent = next((fault for fault in faults if not fault.controlled), None)
        urgent = urgent or self._find_drive_fault(time)
        if urgent is not None:
            return urgent
        tested = (
            self.state is RobotState.STOPPING and self._disabling
        )  # torques no longer belong to the tensions
        if problem := self.load_cell_problem or ("" if tested else self.load_cell_doubt):
            faults.insert(0, Fault(FaultKind.LOAD_CELL, problem, controlled=True))
        if self.verification_problem:
            faults.append(Fault(FaultKind.CONFIGURATION, self.verification_problem))
        if self.torque_problem:
            faults.append(Fault(FaultKind.TORQUE, self.torque_problem, controlled=True))
        if self.recording_problem:
            faults.append(Fault(FaultKind.RECORDING, self.recording_problem, controlled=True))
        return faults[0] if faults else None

    def _stop_for(self, fault: Fault, time: float) -> None:
        """Come to rest along the path, close the brakes, and latch the fault."""
        self.recording_problem = ""
        self._remember_errors()
        self.fault = self.fault or fault
        if self.state is RobotState.ENABLED:
            self._stop_along_path(time)

    def _remember_errors(self) -> None:
        """Keep what tells whose motor was to blame, before set-points follow the measured pose again."""
        if self.fault is None:
            self.behind = self.checks.following_errors()

    def _stop_along_path(self, time: float) -> None:
        self._enter(RobotState.STOPPING, time)
        self._trajectory_stopped = self._disabling = False
        self._actions.append(Action.STOP_TRAJECTORY)

    def _find_drive_fault(self, time: float) -> Fault | None:
        elapsed, limits = time - self._since, self._limits
        if self.state is RobotState.ENABLED and self._drives is not DriverState.ENABLED:
            return Fault(FaultKind.DRIVE_STATE, self._drives_are(" by themselves", "went to"))
        if self.state is RobotState.ENABLING and elapsed > limits.enable_timeout:
            late = f" {limits.enable_timeout:g} s after they were enabled"
            return Fault(FaultKind.TIMEOUT, self._drives_are(late))
        if self.state is RobotState.STOPPING and self._disabling and elapsed > limits.drive_timeout:
            late = f" {limits.drive_timeout:g} s after they were disabled"
            return Fault(FaultKind.TIMEOUT, self._drives_are(late))
        return None

    def _update_stopping(self, time: float) -> None:
        if self._disabling:
            if self._drives is DriverState.HELD_BY_DRIVES:
                self._hold(time)
            elif self._drives is DriverState.DISABLED:
                self._enter(RobotState.FAULT if self.fault else RobotState.DISABLED, time)
            return
        at_rest = self._trajectory_stopped and self.phase.at_rest and self.checks.setpoints_at_rest()
        if at_rest or time - self._since > self._limits.stop_timeout:
            self._disable_drives(time)

    def _update_held(self, time: float) -> None:
        """Do nothing that would take the torque; tell when it is gone."""
        if self._drives is DriverState.HELD_BY_DRIVES:
            self._hold(time)
        else:
            self._fail(
                time, Fault(FaultKind.DRIVE_FAULT, self._drives_cause or self._drives_are(" by themselves"))
            )

    def _hold(self, time: float) -> None:
        """Say which brake does not hold, besides what the robot was stopped for."""
        if self.state is not RobotState.HELD_BY_DRIVES:
            self._stopped_by = self.fault
            self._enter(RobotState.HELD_BY_DRIVES, time)
        first, slip = (
            self._stopped_by,
            Fault(FaultKind.BRAKE, f"the drives hold the load: {self._drives_cause}"),
        )
        self.fault = slip if first is None else Fault(first.kind, f"{first.detail}; then {slip}")

    def _update_fault(self, time: float) -> None:
        if self._drives in (DriverState.ENABLING, DriverState.ENABLED):
            self._resetting = False
            if time - self._quick_stop_time >= _INSISTENCE:
                self._quick_stop_time = time
                self._actions.append(Action.QUICK_STOP)
        elif self._resetting and self._drives in (DriverState.DISABLED, DriverState.NOT_READY):
            self.fault = self._before_slip = None
            self._enter(RobotState.DISABLED, time)
        elif self._resetting and time - self._since > self._limits.drive_timeout:
            self._resetting = False
            self.fault = Fault(FaultKind.DRIVE_FAULT, self._drives_are(" after the reset"))

    def _fail(self, time: float, fault: Fault) -> None:
        # A stop along the path that fails on the way keeps the cause that it began with, and names the second one too:
        # on a dead bus the load cells may be missed a moment before the drives are.
        first = self.fault
        self._remember_errors()
        self.fault = Fault(first.kind, f"{first.detail}; then {fault}") if first else fault
        self._enter(RobotState.FAULT, time)
        self._quick_stop_time = time
        self._actions = [Action.QUICK_STOP, Action.STOP_TRAJECTORY]

    def _disable_drives(self, time: float) -> None:
        self._disabling = True
        self._since = time
        self._actions.append(Action.DISABLE_DRIVES)

    def _enter(self, state: RobotState, time: float) -> None:
        self.state = state
        self._since = time
        self._resetting = False

    def _drives_are(self, when: str = "", verb: str = "are in") -> str:
        state = self._drives.value if self._drives else "unknown"
        cause = f" ({self._drives_cause})" if self._drives_cause else ""
        return f"the drives {verb} state {state}{when}{cause}"
