"""What the supervisor watches while the robot is enabled: ages, motors, tensions, load cells and the pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from cspr_control.estimation.stuck import StuckReadings
from cspr_control.supervision.balance_check import BalanceSettings
from cspr_control.supervision.debounce import Debounce
from cspr_control.supervision.slack_cables import slack_problem
from cspr_control.supervision.torque_check import AT_LIMIT, Contradiction
from cspr_kinematics import Robot, way_outside
from cspr_msgs_py.topics import graph_topics
from cspr_msgs_py.wire.joint_state import JointStateSample


class MonitoredInput(StrEnum):
    """Inputs whose age is watched, by the topic that brings them."""

    MOTOR_STATES = "/motor_states"
    CABLE_TENSIONS = "/cable_tensions"
    REFERENCE = "/reference"
    SETPOINT = "/setpoint"
    PLATFORM_POSE = "/platform_pose"
    DRIVE_STATES = "/drive_states"

    @property
    def writer(self) -> str:
        """Name of the node that publishes it."""
        return _WRITERS[self.value]


_WRITERS = {topic.name: topic.writer for topic in graph_topics(0)}


class FaultKind(StrEnum):
    """What made the supervisor stop the robot."""

    STALE_TOPIC = "stale topic"
    NODE = "node failed"
    FOLLOWING_ERROR = "following error"
    TENSION_LOW = "cable tension below its limit"
    TENSION_HIGH = "cable tension above its limit"
    OVERSPEED = "overspeed"
    WORKSPACE = "workspace left"
    LOAD_CELL = "load cell not plausible"
    LENGTHS = "cable lengths fit no pose"
    PUBLISHERS = "two publishers"
    BRAKE = "brake slips"
    TORQUE = "torque fits no tension"
    CONFIGURATION = "wrong configuration"
    RECORDING = "recording failed"
    DRIVE_FAULT = "drive fault"
    DRIVE_STATE = "unexpected drive state"
    TIMEOUT = "no answer in time"


@dataclass(frozen=True)
class Fault:
    """Why the robot was stopped.

    Attributes
    ----------
    kind, detail
        What is wrong.
    controlled
        Whether the robot can still follow its reference, and so comes to rest along the path before the brakes
        close. Otherwise the drives are stopped at once.
    """

    kind: FaultKind
    detail: str
    controlled: bool = False

    def __str__(self) -> str:
        return f"{self.kind.value}: {self.detail}"


_FAILURE_LASTS = 1.5
"""Time for which a node counts as failed after it has said so, s: one that goes on failing says so every second."""

_BALANCE_LASTS = 2.5
"""Time for which the word of `mass_estimator` on the balance counts, s: it comes every second."""

_FELT = 0.5
"""Share of its motor's torque limit that a cable feels at least, unless something holds the winch."""

_LETS_GO = 0.25
"""Share of the limit on following errors from which a motor that falls further behind must push."""

_PUSHES = 0.1
"""Share of its torque limit that it adds to the feed-forward then, at least."""

_LETS_GO_TIME, _STALLS_TIME = 0.02, 0.04
"""s for which it may not, as torques follow commands late; and for which one at its limit may stand still."""

_STANDING = 3
"""Motor states from which angles that are exactly the same are said to stand still, ..."""

_SETPOINTS_GO_ON = 1.0  # rad
"""... if set-points have gone on by this much meanwhile."""

_GOES_ON = 20.0  # rad/s of a set-point that a motor at rest does not follow: 35 mm/s of cable
_AT_REST = 2.0  # rad/s of the motor: 3 mm/s of cable

_CONTROLLABLE_WITHOUT = (MonitoredInput.CABLE_TENSIONS, MonitoredInput.PLATFORM_POSE)
"""Inputs that the motors do not need to follow the reference until it comes to rest."""

_NODES_NOT_NEEDED = frozenset({"load_cells", "pose_estimator", "mass_estimator"})
"""Nodes that the motors do not need to follow the reference until it comes to rest."""


@dataclass(frozen=True)
class SupervisionLimits:
    """Limits beyond which the robot is stopped; the parameters among them are those of `cspr_msgs_py.parameters.table`.

    Attributes
    ----------
    max_ages
        Age from which each input counts as stale, s.
    starting_error
        In rad: the motors jump by as much when the robot is enabled. The difference is large where the lengths of the
        cables fit no pose, as after a cable was paid out.
    tension_min, tension_max
        Limits of the tensions of each cable (m,), N.
    motor_speed
        Largest speed of a motor, rad/s.
    workspace_min, workspace_max
        Corners (3,) of the box that the platform must not leave, m in base.
    workspace_margin
        How far out of it still counts as in it, m; and how much further out a robot may go that was enabled outside.
    motor_torque
        Largest torque of a motor, N m.
    transmission_ratio, motor_inertia
        Cable paid out by an angle of the motor, m/rad, and inertia at its shaft, kg m^2; relate torque and tension.
    stuck_time
        In s; the noise of a sound load cell never lets it show the very same value for long.
    length_misfit, slack_misfit, misfit_cycles, slack_tension, slack_hold
        Those of `LengthCheck`.
    balance
        Those of `BalanceCheck`, `HoldingCheck` and `Verification`.
    verification_required
        Whether a configuration must have been verified before the robot is enabled.
    allowed_drop
        In m, see `cspr_control.supervision.limit_bounds`.
    """

    max_ages: dict[MonitoredInput, float]
    following_error: float
    following_error_time: float
    starting_error: float
    tension_min: tuple[float, ...]
    tension_min_time: float
    tension_max: tuple[float, ...]
    tension_max_time: float
    motor_speed: float
    motor_speed_time: float
    workspace_min: tuple[float, float, float]
    workspace_max: tuple[float, float, float]
    workspace_margin: float
    transmission_ratio: float
    motor_inertia: float
    motor_torque: float
    tension_difference: float
    tension_difference_time: float
    stuck_time: float
    length_misfit: float
    slack_misfit: float
    misfit_cycles: int
    slack_tension: float
    slack_hold: float
    node_timeout: float
    enable_timeout: float
    stop_timeout: float
    drive_timeout: float
    balance: BalanceSettings
    verification_required: bool
    allowed_drop: float


class SupervisionChecks:
    """Holds the newest inputs and compares them with the limits.

    Times are monotonic times of arrival, s; stamps ROS time, ns.

    Parameters
    ----------
    count
        Number m of motors and cables.
    limits
        The limits.
    """

    def __init__(self, count: int, limits: SupervisionLimits) -> None:
        self._limits = limits
        self._arrivals = dict.fromkeys(MonitoredInput, -math.inf)
        self._measured = self._desired = JointStateSample(0, *np.zeros((3, count)))
        self._desired_acceleration = np.zeros(count)
        self._standing = np.zeros(count)  # motor states in which each angle has stayed the same
        self._errors_then = np.zeros(count)  # following errors when each angle last changed, rad
        self._setpoint_step = ""  # of a set-point that no motor can follow, in words
        self._heard: dict[str, float] = {}  # when each node last said how it is
        self._failures: dict[str, tuple[float, str]] = {}  # when each node last failed, and how
        self._position = np.full(3, np.nan)
        self._oriented = True
        self._outside_when_enabled = np.zeros(3)
        self._tensions = np.full(count, np.nan)
        self._balanced, self._unexplained = -math.inf, math.nan
        self._stuck = StuckReadings(count)
        self._tension_min, self._tension_max = map(np.array, (limits.tension_min, limits.tension_max))
        self._following_error = np.full(count, limits.following_error)
        self._letting_go = Debounce(count, _LETS_GO_TIME)
        self._stalled = Debounce(count, _STALLS_TIME)
        self._motor_speed = np.full(count, limits.motor_speed)
        self._workspace_min, self._workspace_max = map(np.array, (limits.workspace_min, limits.workspace_max))
        self._watches = {
            FaultKind.FOLLOWING_ERROR: Debounce(count, limits.following_error_time),
            FaultKind.OVERSPEED: Debounce(count, limits.motor_speed_time),
            FaultKind.TENSION_HIGH: Debounce(count, limits.tension_max_time),
            FaultKind.TENSION_LOW: Debounce(count, limits.tension_min_time),
            FaultKind.LOAD_CELL: Debounce(count, limits.tension_difference_time),
        }

    def clear(self) -> None:
        """Forget violations under way: the robot is about to be enabled.

        A platform that is outside of its workspace now may move, as long as it goes no further out.
        """
        out = self._way_outside()
        self._outside_when_enabled = np.where(np.isfinite(out), out, 0.0)
        self._setpoint_step = ""
        for watch in (*self._watches.values(), self._letting_go, self._stalled):
            watch.clear()

    def observe_arrival(self, source: MonitoredInput, time: float) -> None:
        """Note that an input arrived."""
        self._arrivals[source] = time

    def observe_motors(self, time: float, sample: JointStateSample) -> NDArray[np.float64]:
        """Store measured motor angles, rad, speeds, rad/s, and torques, N m, (m,) each; return the following errors."""
        self.observe_arrival(MonitoredInput.MOTOR_STATES, time)
        changed = sample.position != self._measured.position
        self._measured = sample
        errors = self.following_errors()
        self._standing = np.where(changed, 0, self._standing + 1)
        self._errors_then = np.where(changed, errors, self._errors_then)
        return errors

    def observe_balance(self, time: float, unexplained: float) -> None:
        """Note how much of the cells' sum no payload explains, as a multiple of what is allowed."""
        self._balanced, self._unexplained = time, unexplained

    def observe_node(self, time: float, name: str, failure: str = "") -> None:
        """Note that a node has said how it is, and what has gone wrong in it."""
        self._heard[name] = time
        if failure:
            self._failures[name] = time, failure

    def observe_pose(
        self, time: float, position: NDArray[np.float64], quaternion: NDArray[np.float64]
    ) -> None:
        """Store position (3,), m in base, and orientation (4,) of the platform."""
        self.observe_arrival(MonitoredInput.PLATFORM_POSE, time)
        self._position = position
        self._oriented = bool(np.isfinite(quaternion).all())

    def observe_setpoint(self, time: float, sample: JointStateSample) -> bool:
        """Store desired motor angles (m,), rad, and speeds (m,), rad/s; return whether no motor could follow them."""
        self.observe_arrival(MonitoredInput.SETPOINT, time)
        before, self._desired = self._desired, sample
        elapsed = (sample.stamp_ns - before.stamp_ns) * 1e-9
        if not elapsed > 0.0:
            return False
        self._desired_acceleration = (sample.velocity - before.velocity) / elapsed
        steps = sample.position - before.position
        within = np.abs(steps) <= self._motor_speed * elapsed + self._limits.starting_error
        if within.all():
            return False
        worst = int(np.where(within, -1.0, np.nan_to_num(np.abs(steps), nan=np.inf)).argmax())
        self._setpoint_step = (
            f"the set-point of motor_{worst + 1} steps by {steps[worst]:z.1f} rad within {1e3 * elapsed:.0f} ms, which "
            f"no motor can follow: who publishes /reference and /setpoint?"
        )
        return True

    def observe_tensions(self, time: float, tensions: NDArray[np.float64]) -> None:
        """Store measured cable tensions (m,), N."""
        self.observe_arrival(MonitoredInput.CABLE_TENSIONS, time)
        self._stuck.observe(time, tensions)
        self._tensions = tensions

    def slack_problem(self, robot: Robot, behind: NDArray[np.float64]) -> str:
        """Return which slack cable has to be wound in, see `slack_cables.slack_problem`."""
        # without a pose set-points stay where they were, and tell what has turned since
        behind = behind + self.following_errors()
        allowed = self._limits.starting_error
        return slack_problem(robot, self._measured.position, self._tensions, behind, allowed)

    def lengths_unclear(self, time: float) -> bool:
        """Return whether there is no recent pose, or motors are away from where they should be at rest."""
        source = MonitoredInput.PLATFORM_POSE
        stale = not self.age(source, time) <= self._limits.max_ages[source]
        return stale or not bool((np.abs(self.following_errors()) <= self._limits.starting_error).all())

    @property
    def stamp_ns(self) -> int:
        """Stamp of the newest motor states, ns; 0 before the first."""
        return self._measured.stamp_ns

    def age(self, source: MonitoredInput, time: float) -> float:
        """Return the age of an input, s; infinite before the first."""
        return time - self._arrivals[source]

    def following_errors(self) -> NDArray[np.float64]:
        """Desired minus measured motor angles (m,), rad, at the time of the measurement."""
        desired, measured = self._desired, self._measured
        ahead = (measured.stamp_ns - desired.stamp_ns) * 1e-9
        return np.asarray(desired.position + desired.velocity * ahead - measured.position)

    def setpoints_at_rest(self) -> bool:
        """Return whether the motors are to stand still: a reference at rest may have an offset that still moves."""
        return bool((np.abs(self._desired.velocity) <= _AT_REST).all())

    def stale(self, time: float) -> list[Fault]:
        """Return the inputs that are too old."""
        faults = []
        for source, largest in self._limits.max_ages.items():
            age = self.age(source, time)
            if not age <= largest:
                seen = f"was last received {age:.3f} s ago" if math.isfinite(age) else "has not been received"
                detail = f"{source.value} of {source.writer} {seen}, limit {largest:g} s"
                if source is MonitoredInput.PLATFORM_POSE and (slack := self._slackest()) is not None:
                    detail += f"; {slack}, and the lengths may fit no pose"
                faults.append(Fault(FaultKind.STALE_TOPIC, detail, source in _CONTROLLABLE_WITHOUT))
        return faults

    def failed_nodes(self, time: float) -> list[Fault]:
        """Return the nodes in which something has just gone wrong, then those that no longer say how they are.

        One that has never been heard has not died: whatever the robot needs of it is missed by its topic.
        """
        limit = self._limits.node_timeout
        failed = [
            (name, f"{name}: {failure}")
            for name, (since, failure) in self._failures.items()
            if not time - since > _FAILURE_LASTS
        ]
        silent = [
            (name, f"{name} was last heard {time - heard:.1f} s ago, limit {limit:g} s: has it ended?")
            for name, heard in self._heard.items()
            if not time - heard <= limit
        ]
        return [
            Fault(FaultKind.NODE, detail, controlled=name in _NODES_NOT_NEEDED)
            for name, detail in (*failed, *silent)
        ]

    def _slackest(self) -> str | None:
        """Return which cable carries the least, if that is less than it should."""
        cable = int((self._tensions - self._tension_min).argmin())
        if self._tensions[cable] >= self._tension_min[cable]:
            return None
        return f"cable_{cable + 1} carries {self._tensions[cable]:z.0f} N"

    def excess(self, time: float, under_torque: bool = True) -> list[Fault]:
        """Return what has been beyond a limit for longer than allowed.

        Parameters
        ----------
        time
            Monotonic, s.
        under_torque
            Whether all brakes are open, so that torques and tensions belong together.
        """
        errors = self.following_errors()
        faults = self._lasting_violations(time, errors)
        if self._setpoint_step:
            faults.insert(0, Fault(FaultKind.FOLLOWING_ERROR, self._setpoint_step))
        if under_torque:
            faults += self._standing_angles(errors)
            faults += self._motors_that_give_up(time, errors)
            faults += self._implausible_cells(time)
        else:
            self._errors_then = errors  # the motors have yet to follow
            self._letting_go.clear()
            self._stalled.clear()
            self._watches[FaultKind.LOAD_CELL].clear()
        outside = self._outside()
        if outside is not None:
            faults.append(Fault(FaultKind.WORKSPACE, outside, controlled=True))
        return faults

    # All comparisons are written so that a number that is not finite counts as beyond the limit.

    def _lasting_violations(self, time: float, errors: NDArray[np.float64]) -> list[Fault]:
        tensions, speeds = self._tensions, self._measured.velocity
        angle, speed, high, low = (
            self._following_error, self._motor_speed, self._tension_max, self._tension_min
        )  # fmt: skip
        faults = []
        for kind, within, values, text, limit in (
            (FaultKind.FOLLOWING_ERROR, np.abs(errors) <= angle, errors,
             "motor_{} is {:z.2f} rad behind, limit {:g} rad", angle),
            (FaultKind.OVERSPEED, np.abs(speeds) <= speed, speeds,
             "motor_{} turns at {:z.0f} rad/s, limit {:g} rad/s", speed),
            (FaultKind.TENSION_HIGH, tensions <= high, tensions, "cable_{} at {:z.0f} N, limit {:g} N", high),
            (FaultKind.TENSION_LOW, tensions >= low, tensions, "cable_{} at {:z.0f} N, limit {:g} N", low),
        ):  # fmt: skip
            worst = self._watches[kind].update(time, ~within)
            if worst is not None:
                detail = text.format(worst + 1, values[worst], limit[worst])
                if kind is FaultKind.FOLLOWING_ERROR:
                    detail += self._why_behind(worst)
                faults.append(Fault(kind, detail, controlled=kind is FaultKind.TENSION_LOW))
        return faults

    def _standing_angles(self, errors: NDArray[np.float64]) -> list[Fault]:
        """Return that angles of several motors stay exactly the same, as neither encoders nor winches do."""
        gone_on = np.abs(errors - self._errors_then) > _SETPOINTS_GO_ON
        standing = np.flatnonzero((self._standing >= _STANDING) & gone_on)
        if len(standing) < 2:
            return []
        source, names = MonitoredInput.MOTOR_STATES, ", ".join(f"motor_{k + 1}" for k in standing)
        detail = f"{source.value} of {source.writer} shows the same angles of {names} again and again"
        return [Fault(FaultKind.STALE_TOPIC, detail + " while their set-points go on")]

    def _motors_that_give_up(self, time: float, errors: NDArray[np.float64]) -> list[Fault]:
        """Return the motor of which it need not be waited for how far it will fall behind.

        Whatever the gains, a controller pushes towards its set-point: one that falls behind without has let go. And no
        sound motor stands still under all its torque while its set-point goes on.
        """
        limits, desired, measured = self._limits, self._desired, self._measured
        direction = np.sign(errors)
        worse = direction * (desired.velocity - measured.velocity) > 0.0
        idle = direction * (measured.effort - desired.effort) < _PUSHES * limits.motor_torque
        # what a set-point of long ago goes on to is nobody's wish
        fresh = self.age(MonitoredInput.SETPOINT, time) <= 0.5 * limits.max_ages[MonitoredInput.SETPOINT]
        behind = fresh & (np.abs(errors) > _LETS_GO * limits.following_error)
        stalled = (np.abs(measured.velocity) < _AT_REST) & (np.abs(desired.velocity) > _GOES_ON)
        for watch, given_up, text in (
            (self._letting_go, behind & worse & idle, "falls behind, by {:z.2f} rad so far"),
            (self._stalled, behind & stalled & self._at_limit(), "stands still, {:z.2f} rad behind so far"),
        ):
            motor = watch.update(time, given_up)
            if motor is not None:
                detail = f"motor_{motor + 1} {text.format(errors[motor])}{self._why_behind(motor)}"
                return [Fault(FaultKind.FOLLOWING_ERROR, detail)]
        return []

    def _why_behind(self, motor: int) -> str:
        """Return what keeps a motor from its set-point, by its torque and what its cable carries."""
        torque, carried = self._limits.motor_torque, self._tensions[motor]
        if not self._at_limit()[motor]:
            applied = self._measured.effort[motor]
            return f", its torque {applied:z.1f} of {torque:g} N m: its gains, its controller or its drive let go"
        blocked = abs(carried) * self._limits.transmission_ratio < _FELT * torque
        why = "its winch or brake is blocked" if blocked else "an obstacle, or a load too heavy for it"
        return f", its torque at the limit of {torque:g} N m, and its cable carries {carried:z.0f} N: {why}"

    def _at_limit(self) -> NDArray[np.bool_]:
        return np.asarray(np.abs(self._measured.effort) >= AT_LIMIT * self._limits.motor_torque)

    def _implausible_cells(self, time: float) -> list[Fault]:
        """Return the load cell or the motor where they contradict each other, and a cell that is stuck.

        What accelerates the winch does not reach the cable. The set-point says how much that is: its differences have
        no noise, and where it jumps, which no motor follows, they are wrong for one sample.
        """
        limits, tensions = self._limits, self._tensions
        accelerating = limits.motor_inertia * self._desired_acceleration
        torque_tensions = (accelerating - self._measured.effort) / limits.transmission_ratio
        beyond = ~(np.abs(tensions - torque_tensions) <= limits.tension_difference)
        cable = self._watches[FaultKind.LOAD_CELL].update(time, beyond)
        if cable is not None:
            unexplained = self._unexplained if time - self._balanced <= _BALANCE_LASTS else math.nan
            known = Contradiction(tensions, torque_tensions, beyond, self._at_limit(), unexplained)
            of_cell, culprit = known.culprit(cable)
            detail = (
                f"cable_{cable + 1} shows {tensions[cable]:z.0f} N, the torque of its motor corresponds to "
                f"{torque_tensions[cable]:z.0f} N; allowed difference {limits.tension_difference:g} N: {culprit}"
            )
            return [Fault(FaultKind.LOAD_CELL if of_cell else FaultKind.TORQUE, detail, controlled=True)]
        source = MonitoredInput.CABLE_TENSIONS
        fresh = self.age(source, time) <= limits.max_ages[source]
        stuck = self._stuck.longest(time, limits.stuck_time)
        if fresh and stuck is not None:
            cable, still = stuck
            detail = f"cable_{cable + 1} has shown exactly {tensions[cable]:zg} N for {still:.1f} s"
            return [Fault(FaultKind.LOAD_CELL, detail, controlled=True)]
        return []

    def _way_outside(self) -> NDArray[np.float64]:
        """Return how far the platform is out of its workspace along each axis (3,), m; nan before the first pose."""
        return way_outside(self._position, self._workspace_min, self._workspace_max)

    def _outside(self) -> str | None:
        """Return in words where the platform has left its workspace; None when it has not."""
        limits = self._limits
        allowed = self._outside_when_enabled + limits.workspace_margin
        if not self._oriented:
            return "the orientation of the platform is not a number"
        for axis in np.flatnonzero(~(self._way_outside() <= allowed)):
            low, high = limits.workspace_min[axis], limits.workspace_max[axis]
            return (
                f"the platform is at {'xyz'[axis]} = {self._position[axis]:z.3f} m, the workspace is from "
                f"{low:g} to {high:g} m"
            )
        return None

    def obstacle(self, time: float) -> str | None:
        """Return why the robot must not be enabled now; None when nothing speaks against it."""
        limits = self._limits
        if stale := self.stale(time) or self.failed_nodes(time):
            return str(stale[0])
        if not (self._oriented and np.isfinite(self._position).all()):
            return f"the pose of the platform is not finite: it is at {self._position} m"
        errors = self.following_errors()
        worst = int(np.abs(errors).argmax())
        if not abs(errors[worst]) <= limits.starting_error:
            return (
                f"motor_{worst + 1} is {errors[worst]:z.2f} rad away from its set-point, "
                f"limit {limits.starting_error:g} rad: the lengths of the cables fit no pose"
            )
        over = np.where(np.isfinite(self._tensions), self._tensions - self._tension_max, np.inf)
        highest = int(over.argmax())
        if not over[highest] <= 0.0:
            return (
                f"cable_{highest + 1} carries {self._tensions[highest]:z.0f} N, "
                f"limit {limits.tension_max[highest]:g} N"
            )
        return None
