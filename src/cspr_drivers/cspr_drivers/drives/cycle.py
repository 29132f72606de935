"""The control cycle of all drives: frames, commands and moments in, motor states and frames to be sent out.

It has no bus, no thread, no lock and no clock: times are arguments, in seconds of one monotonic clock. The
caller serialises the calls, and sends the frames of each call before those of the next.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from cspr_drivers.brakes.brake_watch import BrakeWatch
from cspr_drivers.canopen import frame_table
from cspr_drivers.canopen.cia402 import decode_state
from cspr_drivers.canopen.emergency import Emergency
from cspr_drivers.canopen.frame_table import FunctionCode, cob_id
from cspr_drivers.canopen.nmt import NmtState
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.cycle.answer_balance import AnswerBalance
from cspr_drivers.cycle.cycle_watch import CycleWatch
from cspr_drivers.devices.setup import DriveFacts
from cspr_drivers.drives.group import IN_MOTION, DriveGroup
from cspr_drivers.drives.home_position import with_home
from cspr_drivers.drives.motor_feedback import MotorFeedback
from cspr_drivers.drives.report import MotorStates
from cspr_drivers.drives.torque_frames import CommandFault, Frame, TorqueFrame, command_fault
from cspr_drivers.drives.torque_watch import TorqueWatch
from cspr_drivers.drives.winding import Direction, Winding, winding_refusal
from cspr_msgs_py.vocabulary import DriverState

_SAME_HOME = 1.0  # rad at the motor shaft: one and the same pose, within backlash and noise
_CONFIRMED_WITHIN = 10.0  # s
_ALIVE = 0.25  # of the time without an RPDO at which a drive acts: how often a drive at rest gets one
_AGAIN = 0.02  # s after which a brake that has not moved is told again
_LONGEST_WAIT = 2.5  # periods after a SYNC in which the next one waits for the answers to it


class DriveCycle:
    """The m drives of a configuration, from one SYNC to the next.

    Parameters
    ----------
    config
        Buses, drives, times.

    Attributes
    ----------
    config
        The configuration in use.
    group
        State of the drives.
    watch
        Statistics of the cycles.
    facts
        What each drive has said about itself, `None` before it was configured (m).
    rejected, last_rejection
        Number of commands that were not passed on, and the newest of them in words.
    postponed
        SYNC frames left out since the drives were last enabled.
    defect
        Why this driver cannot be used until it is started again, in words; empty otherwise.
    last_winding
        What came of the last winding of a single winch, in words; empty before the first.
    """

    def __init__(self, config: CanConfig) -> None:
        count = len(config.drives)
        self.config = config
        self.group = DriveGroup(config)
        self._feedback = MotorFeedback(config)
        self.watch = CycleWatch(count, self._feedback.frames)
        frames = count * self._feedback.frames
        self._balance = AnswerBalance(frames, config.timeouts.feedback, config.period)
        self.facts: list[DriveFacts | None] = [None] * count
        self.rejected = 0
        self.last_rejection = ""
        self.postponed = 0
        self.defect = ""
        self._rpdos = [TorqueFrame(config, drive) for drive in config.drives]
        self._torque_watch = TorqueWatch(count, config.torque_check)
        self._outputs: list[tuple[bool, float] | None] = [
            None
        ] * count  # how each brake was told to be, and when
        self._brakes = BrakeWatch(count, config.largest_brake_slip)
        heartbeat = cob_id(FunctionCode.HEARTBEAT, config.master_node_id)
        self._heartbeats = [Frame(bus.name, heartbeat, bytes([NmtState.OPERATIONAL])) for bus in config.buses]
        self._heartbeat_due = 0.0
        self._sync_time = 0.0
        self._sync_stamp = 0
        self._published_stamp = 0
        self._home_told = (0.0,) * count, -math.inf  # the pose that was refused as home, and when
        self._tensions: tuple[Sequence[float], float] = (), -math.inf  # of the cables, N, and when they came
        self._winding: tuple[int, Winding] | None = None  # a winch that is wound alone
        self.last_winding = ""

    # Once a cycle.

    def wants_sync(self, now: float) -> bool:
        """Return whether the next SYNC may go out; not while answers to the last one may still come.

        An answer that came after the next SYNC would be taken for the answer to that one: a position of the
        wrong moment, and a speed that is off by half or more. A drive that stays silent stops the robot later.
        """
        if (
            self.group.state is not DriverState.NOT_READY
            and self.watch.missing
            and now - self._sync_time < _LONGEST_WAIT * self.config.period
        ):
            self.postponed += 1
            return False
        return True

    def sync(self, now: float, stamp_ns: int) -> None:
        """Begin the cycle of a SYNC that goes out now; its stamp in ns of ROS time."""
        self.watch.sync(counted=self.group.state is DriverState.ENABLED)
        self._balance.sync()
        self._sync_time = now
        self._sync_stamp = stamp_ns

    def step(self, now: float) -> list[Frame]:
        """Update the state; return heartbeats that are due, and control words to be sent (again)."""
        frames: list[Frame] = []
        if now >= self._heartbeat_due:
            self._heartbeat_due = now + self.config.timeouts.heartbeat_producer
            frames += self._heartbeats
        self.group.step(now)
        if self._feedback.disbelieved and self.group.state is not DriverState.FAULT:
            self._feedback.begin_anew()  # the operator has reset the fault
            self._brakes.clear()
        self._wind(now)
        deadline = now + self.config.period
        known = [drive.state is not None for drive in self.group.drives]
        for index, (rpdo, word) in enumerate(zip(self._rpdos, self.group.control_words, strict=True)):
            # at rest too, or drives that watch for it would miss it
            due = deadline - rpdo.deadline >= _ALIVE * self.config.timeouts.rpdo
            repeat = not rpdo.sent and (due or not self.group.settled(index) or self._winds(index))
            if known[index] and (repeat or word != rpdo.control_word):
                frames.append(rpdo.make(word, deadline))
            rpdo.sent = False
        return frames + self._brake_frames(now)

    def _brake_frames(self, now: float) -> list[Frame]:
        """Return what moves the brakes that the host commands, again while a drive does not report it done."""
        output = self.config.brake_output
        frames: list[Frame] = []
        if output is None:
            return frames
        for index, (drive, status) in enumerate(zip(self.config.drives, self.group.drives, strict=True)):
            closes, told = self.group.closes(index), self._outputs[index]
            if closes is None or status.state is None:
                continue
            missing = closes == status.brake_open and (closes or self.group.operates(index))
            if told is None or told[0] != closes or (missing and now - told[1] >= _AGAIN):
                self._outputs[index] = closes, now
                data = frame_table.DRIVE_RPDO2.encode(output.outputs(closes))
                deadline = now + self.config.period
                frames.append(Frame(drive.bus, cob_id(FunctionCode.RPDO2, drive.node_id), data, deadline))
        return frames

    # What the drives send.

    def feedback(self, now: float, index: int, data: bytes | bytearray) -> MotorStates | None:
        """Process the first frame of a drive; return the motor states when it was the last one missing.

        Of several that come in a cycle the first counts.

        Raises
        ------
        FrameError
            If the frame is cut short or too long, or its status word is that of no state.
        """
        status, position, torque = self.config.pdo.drive_tpdo.decode(data)
        if self._is_repeated(now, index, index):
            decode_state(status)  # what is no status word is counted all the same
            return None
        self.group.feedback(index, status, now)
        if self.watch.is_late(index):
            return None
        name, feedback = self.config.drives[index].name, self._feedback
        if problem := feedback.measured(index, position, torque, self._sync_time):
            self.group.quick_stop(f"{name}: {problem}", now)
        if self.group.proof is not None:
            self.group.proof.observe(index, feedback.angles[index])
        if index not in feedback.disbelieved:
            held = self.group.drives[index].held
            self.group.slips(index, self._brakes.observe(index, now, feedback.angles[index], held), now)
        applied, operates = feedback.torques[index], self.group.operates(index)
        if problem := self._torque_watch.answered(index, applied, now, operates):
            self.group.quick_stop(f"{name} {problem}", now)
        return self._answered(now, index)

    def velocity(self, now: float, index: int, data: bytes | bytearray) -> MotorStates | None:
        """Process the second frame of a drive, which holds its velocity; otherwise as `feedback`."""
        (velocity,) = frame_table.DRIVE_TPDO2.decode(data)
        facts = self.facts[index]
        place = index + len(self.facts)
        if self._is_repeated(now, index, place) or facts is None or facts.velocity_unit is None:
            return None
        if self.watch.is_late(place):
            return None
        if problem := self._feedback.moves(index, velocity * facts.velocity_unit):
            self.group.quick_stop(f"{self.config.drives[index].name}: {problem}", now)
        return self._answered(now, place)

    def _is_repeated(self, now: float, index: int, place: int) -> bool:
        """Return whether a frame of a drive is not the first in this cycle; one that no SYNC asked for is a fault."""
        if self._balance.answered(place):
            cause = f"{self.config.drives[index].name} answers one SYNC twice: another device has its node id"
            self.group.quick_stop(cause, now)
            self.group.explain(cause, now)
        elif not self.watch.has_answered(place):
            return False
        self.watch.feedback(place, now)  # counts it
        return True

    def _answered(self, now: float, place: int) -> MotorStates | None:
        if not self.watch.feedback(place, now):
            return None
        states = self._feedback.states(self._sync_stamp, self._sync_time)
        if states is not None:
            self._published_stamp = self._sync_stamp
        return states

    def inputs(self, now: float, index: int, data: bytes | bytearray) -> list[Frame]:
        """Process the digital inputs of a drive, sent when they change; return the frames of a stop, if any."""
        (inputs,) = frame_table.DRIVE_TPDO3.decode(data)
        entry = self.config.emergency_stop_input
        if entry is None:
            return []
        self.group.emergency_stop(index, entry.is_active(inputs), now)
        return self._changed(now)

    def emergency(self, now: float, index: int, code: int, register: int, data: bytes) -> list[Frame]:
        """Process an emergency message of a drive; return the frames of a stop, if any."""
        self.group.emergency(index, Emergency(code, register, data, now))
        return self._changed(now)

    def configured(self, now: float, index: int, facts: DriveFacts) -> None:
        """Note that a drive is configured, and what it has said about itself."""
        self.facts[index] = facts
        self.group.configured(index)
        if facts.error_register:
            self.group.emergency(index, Emergency(facts.error_code, facts.error_register, bytes(5), now))
        self.group.emergency_stop(index, facts.emergency_stop, now)

    def lost(self, now: float, index: int, reason: str) -> None:
        """Note that a drive is lost; when it comes back it may have forgotten its settings."""
        self.group.lost(index, reason, now)
        self._outputs[index] = None
        self._rpdos[index].control_word = None

    def bus_failed(self, now: float, bus: str, problem: str) -> list[Frame]:
        """Stop, with that as the cause, when a bus no longer carries frames: other faults will follow from it."""
        return self._stop(now, f"bus {bus}: {problem}")

    def thread_ended(self, now: float, problem: str) -> list[Frame]:
        """Stop for good, moving or at rest, when one of the driver's threads has ended by an error."""
        self.defect = self.defect or problem
        return self.quick_stop(now, self.defect)

    # Torque commands.

    def command(self, now: float, index: int, stamp_ns: int, torque: float) -> list[Frame]:
        """Return the frame that passes a torque, N m, on to a drive, or the frames of a stop when it may not have it.

        Parameters
        ----------
        now
            When the command came, s.
        index
            Of the drive.
        stamp_ns
            Stamp of the motor states that the command answers.
        torque
            At the motor shaft, N m; positive pays out.
        """
        rpdo = self._rpdos[index]
        units, age = self.config.drives[index].units, 1e-9 * (self._published_stamp - stamp_ns)
        fault = command_fault(torque, units.torque_limit, age, self.config.timeouts.command)
        if fault is not None:
            return self._reject(now, index, f"torque command of {torque:zg} N m is {fault.value}")
        if stamp_ns < rpdo.stamp_ns:
            self.watch.command(index, fresh=False, time=0.0)  # overtaken by a newer one
            return []
        if stamp_ns == rpdo.stamp_ns:
            return self._reject(now, index, "two torque commands for one SYNC: two nodes publish them")
        rpdo.stamp_ns = stamp_ns
        self.group.commanded(index, now)
        if self.group.state is DriverState.FAULT:
            return []  # the torque stays what it was when the fault came, until the brakes hold
        if self._winds(index):
            return []  # the winch has its torque from `_wind`
        if self.group.proof is not None:
            torque *= self.group.proof.torque_share(now)
        rpdo.torque = units.per_mille(torque)
        self._torque_watch.told(index, torque)
        deadline = self._sync_time + self.config.period
        return [rpdo.make(self.group.control_words[index], deadline, (index, stamp_ns))]

    def supervised(self, now: float, stamp_ns: int) -> None:
        """Process the supervisor's sign of life, stamped with the newest motor states that it has checked.

        It counts when these are as recent as those that commands answer: a supervisor that no longer hears any, and a
        recording that is played back, watch nothing.
        """
        age = 1e-9 * (self._published_stamp - stamp_ns)
        if 0.0 <= age <= self.config.timeouts.supervisor:
            self.group.supervised(now)

    def sent(self, now: float, index: int, stamp_ns: int) -> None:
        """Note that the frame of a torque command was put on the bus."""
        self.watch.command(index, fresh=stamp_ns == self._sync_stamp, time=now)

    def unreadable(self, now: float, index: int, problem: str) -> list[Frame]:
        """Count a command that could not be read; return the frames of a stop when the drives are in motion."""
        return self._reject(now, index, f"{CommandFault.UNREADABLE.value} torque command: {problem}")

    def _reject(self, now: float, index: int, problem: str) -> list[Frame]:
        self.rejected += 1
        self.last_rejection = f"{self.config.drives[index].name}: {problem}"
        return self._stop(now, self.last_rejection)

    # The operator's commands.

    def enable(self, now: float, index: int | None = None, unread: Iterable[int] = ()) -> str | None:
        """Begin to release the brakes, of all drives or of one; return why not; see `DriveGroup.enable`."""
        refusal = self.group.enable(now, index, unread)
        if refusal is None:
            self.watch.clear()
            self.postponed = 0
        return refusal

    def disable(self, now: float, index: int | None = None) -> list[Frame]:
        """Begin to close the brakes, of all drives or of one, and to take the torque away."""
        self.group.disable(now, index)
        return self._changed(now)

    def tensions(self, now: float, tensions: Sequence[float]) -> None:
        """Note the tensions of the cables (m,), N, up to which a single winch is wound."""
        self._tensions = tensions, now

    def wind(self, now: float, index: int, direction: Direction) -> str | None:
        """Begin to wind a single winch for a moment; return why not, and what to do, when that is refused."""
        tensions, limits, drive = self._known_tensions(now), self.config.winding, self.config.drives[index]
        if self.group.state is DriverState.DISABLED and (
            refusal := winding_refusal(index, direction, tensions, limits)
        ):
            return refusal
        limit = drive.units.torque_limit
        cable = self.config.load_cells[index].name
        winding = Winding(drive.name, cable, direction, limits, limit, tensions[index] if tensions else 0.0)
        refusal = self.group.wind(now, index, winding.doing)
        if refusal is None:
            self._winding = index, winding
            self._rpdos[index].torque = 0
            self._torque_watch.told(index, 0.0)
        return refusal

    def _winds(self, index: int) -> bool:
        return self._winding is not None and self._winding[0] == index

    def _wind(self, now: float) -> None:
        """Give a winch that is wound its torque, until it is over and the brake has closed."""
        if self._winding is None:
            return
        index, winding = self._winding
        if self.group.state is not DriverState.WINDING:
            self._winding = None
            ended = winding.end or "it was stopped"
            self.last_winding = f"{winding.doing}: by {winding.moved:+.2f} rad, {ended}"
            return
        self.group.commanded(index, now)
        if self.group.operates(index):
            tensions = self._known_tensions(now)
            angle, speed = self._feedback.angles[index], self._feedback.speeds[index]
            torque = winding.torque(now, angle, speed, tensions[index] if tensions else None)
            self._rpdos[index].torque = self.config.drives[index].units.per_mille(torque)
            self._torque_watch.told(index, torque)
            if winding.end:
                self.group.disable(now)

    def _known_tensions(self, now: float) -> Sequence[float]:
        tensions, time = self._tensions
        fresh = now - time <= self.config.timeouts.feedback and len(tensions) == len(self.facts)
        return tensions if fresh else ()

    def quick_stop(self, now: float, cause: str) -> list[Frame]:
        """Stop all drives at once and latch the cause."""
        self.group.quick_stop(cause, now, ordered=True)
        return self._changed(now)

    def fault_reset(self, now: float, index: int | None = None) -> str | None:
        """Begin to reset faults of the drives and the latched cause, or that of one drive; return why not."""
        moving = [self.config.drives[k].name for k in self._brakes.moving(now)]
        if moving:
            return f"not stopped yet: {', '.join(moving)} turns with its brake closed: support the load"
        refusal = self.defect or self.group.fault_reset(now, index)
        if refusal is None and index is None:
            self._brakes.clear()
        return refusal

    def home_refusal(self, now: float) -> str | None:
        """Return why the present pose cannot become the home pose, or `None`.

        Only at rest: a controller would take the jump of the angle for motion. Where that moves the home pose, who asks
        is told by how much, and has to ask again.
        """
        if self.group.state in IN_MOTION:
            return f"the drives are {self.group.state.value}: disable them first"
        for index, drive in enumerate(self.group.drives):
            silent = self.group.feedback_age(index, now) > self.config.timeouts.feedback
            if drive.state is None or silent:
                return f"{drive.name} does not report its position"
            if not drive.held:
                return f"the brake of {drive.name} is open"
            if index in self._feedback.disbelieved:
                return f"the position of {drive.name} is not believed: reset the fault first"
        return self._unconfirmed_home(now)

    def _unconfirmed_home(self, now: float) -> str | None:
        angles, (told, told_at) = tuple(self._feedback.angles), self._home_told
        moved = [index for index, angle in enumerate(angles) if abs(angle) > _SAME_HOME]
        again = now - told_at <= _CONFIRMED_WITHIN and all(
            abs(angle - before) <= _SAME_HOME for angle, before in zip(angles, told, strict=True)
        )
        if not moved or again:
            self._home_told = angles, -math.inf
            return None
        self._home_told = angles, now
        away = ", ".join(f"{self.config.drives[index].name} {angles[index]:+.1f} rad" for index in moved)
        return (
            f"this is not the home pose that is known, but {away} away from it: if it is the true one nevertheless, "
            f"call again within {_CONFIRMED_WITHIN:g} s"
        )

    def counts(self) -> list[int]:
        """Return the position values of the present pose (m)."""
        pairs = zip(self.config.drives, self._feedback.angles, strict=True)
        return [drive.units.counts(angle) for drive, angle in pairs]

    def set_home(self, counts: Sequence[int]) -> None:
        """Let the motor angles be zero at other position values (m)."""
        self._brakes.clear()
        self.config = with_home(self.config, counts)
        self._feedback.use(self.config)

    @property
    def at_rest(self) -> bool:
        """Whether all brakes hold, as far as is known, and none is about to open."""
        return self.group.state not in IN_MOTION and self.group.held

    def _stop(self, now: float, cause: str) -> list[Frame]:
        if self.group.state not in IN_MOTION:
            return []
        self.group.quick_stop(cause, now)
        return self._changed(now)

    def _changed(self, now: float) -> list[Frame]:
        """Return the changed control words, except for drives that already are where they should be."""
        deadline = now + self.config.period
        words = zip(self._rpdos, self.group.control_words, strict=True)
        return [
            rpdo.make(word, deadline)
            for index, (rpdo, word) in enumerate(words)
            if word != rpdo.control_word and not self.group.settled(index)
        ]
