"""The driver of all drives: it owns the control cycle, sends torques, and keeps the drives safe.

Three kinds of threads meet here: the cycle clock, the receiving thread of each bus, and whoever calls
`command` and the operator's methods. All share one lock, which is not held while motor states are published.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from functools import partial

from cspr_drivers.bus.can_bus import CanPort, CanPorts, CyclicFrame, FrameHandler
from cspr_drivers.canopen import frame_table
from cspr_drivers.canopen.emergency import Emergency
from cspr_drivers.canopen.frame_table import POSITION_ACTUAL, STATUS_WORD, TORQUE_ACTUAL, FunctionCode, cob_id
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.devices.device import OPERATIONAL, CanopenDevice, NmtCommand
from cspr_drivers.devices.setup import DriveFacts, set_up_drive
from cspr_drivers.devices.setup_thread import Commissioning
from cspr_drivers.drives.command_check import CommandCheck, CommandFault
from cspr_drivers.drives.cycle import Cycle
from cspr_drivers.drives.cycle_clock import CycleClock
from cspr_drivers.drives.group import IN_MOTION, DriveGroup, GroupState
from cspr_drivers.drives.home_position import store_home, with_home
from cspr_drivers.drives.motor_speed import PositionDifference
from cspr_drivers.drives.report import DriveReport, MotorStates
from cspr_drivers.drives.status import DriveStatus
from cspr_drivers.drives.torque_frames import torque_frames
from cspr_drivers.drives.torque_watch import TorqueWatch
from cspr_drivers.errors import BusError, ConfigurationError, DeviceError

_HEARTBEAT_WATCH = 0.02  # s between two looks at the heartbeats of the drives

_LONGEST_WAIT = 2.5  # periods after a SYNC in which the next one waits for the answers to it


class DriveMaster:
    """Driver of the m drives of a configuration.

    Parameters
    ----------
    config
        Buses, drives, times.
    ports
        The open buses; they stay open when the driver stops.
    publish
        Given the motor states of each cycle, in the receiving thread, as soon as the last drive has answered.
    report
        Given lines for the log.
    cycle_clock
        What calls the cycle once a period; simulated time has another.

    Attributes
    ----------
    cycle_clock
        The one in use.
    """

    def __init__(
        self,
        config: CanConfig,
        ports: CanPorts,
        publish: Callable[[MotorStates], None],
        report: Callable[[str], None],
        cycle_clock: type[CycleClock] = CycleClock,
    ) -> None:
        self._config = config
        self._ports = ports
        self._publish = publish
        count = len(config.drives)
        self._clock = ports.clock
        self._lock = threading.Lock()
        self._postponed = 0  # SYNC frames left out since the drives were last enabled
        self._group = DriveGroup(
            [drive.name for drive in config.drives], config.brake_open_bit, config.timeouts
        )
        tpdo_2 = config.pdo.drive_tpdo_2
        self._cycle = Cycle(count, frames=1 if tpdo_2 is None else 2)
        self._speed = PositionDifference(config.velocity_filter) if tpdo_2 is None else None
        self._speeds = [0.0] * count
        self._facts: list[DriveFacts | None] = [None] * count
        self._checks = [
            CommandCheck(drive.units.torque_limit, config.timeouts.command) for drive in config.drives
        ]
        self._angles = [0.0] * count
        self._torques = [0.0] * count
        self._sync_time = 0.0
        self._cycle_end = 0.0  # until when commands that answer this cycle's states are fresh
        self._sync_stamp = 0
        self._published_stamp = 0
        self._command_stamps = [0] * count
        self._frames = torque_frames(config, ports)
        self._torque_watch = TorqueWatch(count, config.torque_check)
        self._rejected = 0
        self._last_rejection = ""
        tpdo = config.pdo.drive_tpdo
        self._status_place = tpdo.position(STATUS_WORD)
        self._position_place = tpdo.position(POSITION_ACTUAL)
        self._torque_place = tpdo.position(TORQUE_ACTUAL)
        self._heartbeat = CyclicFrame(
            cob_id(FunctionCode.HEARTBEAT, config.master_node_id), bytes([OPERATIONAL])
        )
        self._heartbeat_due = 0.0
        self._heartbeats_due = 0.0
        self._other_driver = threading.Event()
        self._started = self._stopped = False
        self.cycle_clock = cycle_clock(config.period, self._tick, self._clock)
        self._commissioning = Commissioning(
            [str(drive) for drive in config.drives], self._configure, self._may_configure, report, self._clock
        )
        self._failures = [(port, partial(self._bus_failed, port.name)) for port in ports]
        self._devices = [
            CanopenDevice(
                str(drive),
                ports[drive.bus],
                drive.node_id,
                config.timeouts.sdo,
                on_boot=partial(self._booted, index),
                on_emergency=partial(self._emergency, index),
            )
            for index, drive in enumerate(config.drives)
        ]

    def start(self) -> None:
        """Begin to send SYNC and heartbeat, and to configure the drives.

        Raises
        ------
        BusError
            If another driver is active on one of the buses.
        """
        heartbeat = self._heartbeat.arbitration_id
        for port in self._ports:
            port.subscribe(heartbeat, lambda data, now: self._other_driver.set())
        if self._other_driver.wait(self._clock.on_computer(1.5 * self._config.timeouts.heartbeat_producer)):
            raise BusError(
                "another driver is active on the CAN bus: "
                f"its heartbeat as node {self._config.master_node_id} was seen"
            )
        self._started = True
        for port, identifier, handler in self._handlers():
            port.subscribe(identifier, handler)
        for port, failure in self._failures:
            port.on_failure(failure)
        self._ports.on_sync(self._begin_cycle, self._lock)
        self.cycle_clock.start()
        self._commissioning.start()

    def come_to_rest(self) -> None:
        """Close the brakes and wait until they hold, no longer than a limit."""
        self.disable()
        deadline = self._clock.monotonic() + 2.0 * self._config.timeouts.stop
        while self.cycle_clock.running and self._clock.monotonic() < deadline and not self._at_rest():
            self._clock.sleep(self._config.period)

    def stop(self) -> None:
        """Close the brakes, wait until they hold (no longer than a limit), and leave the bus."""
        if self._stopped:
            return
        self._stopped = True
        if self._started:
            self._leave_drives()
        for port in self._ports:
            port.unsubscribe(self._heartbeat.arbitration_id)
        for device in self._devices:
            device.release()

    def _leave_drives(self) -> None:
        self.come_to_rest()
        self._commissioning.stop()
        for device in self._devices:
            try:
                device.command(NmtCommand.ENTER_PRE_OPERATIONAL)
            except DeviceError:
                break  # the bus takes no frames; the drives notice the missing heartbeat
        self.cycle_clock.stop()
        self._ports.off_sync(self._begin_cycle)
        for port, failure in self._failures:
            port.off_failure(failure)
        for port, identifier, _ in self._handlers():
            port.unsubscribe(identifier)

    # Torque commands.

    def command(self, index: int, stamp_ns: int, torque: float) -> None:
        """Send a torque, N m, to a drive at once, if it may have it; else stop the drives.

        Parameters
        ----------
        index
            Of the drive.
        stamp_ns
            Stamp of the motor states that the command answers.
        torque
            At the motor shaft, N m; positive pays out.
        """
        with self._lock:
            fault = self._checks[index].fault(torque, 1e-9 * (self._published_stamp - stamp_ns))
            if fault is not None:
                self._refuse(index, f"torque command of {torque:g} N m {fault.value}")
                return
            if stamp_ns < self._command_stamps[index]:
                self._cycle.command(index, fresh=False, time=0.0)  # overtaken by a newer one
                return
            self._command_stamps[index] = stamp_ns
            now = self._clock.monotonic()
            self._group.commanded(index, now)
            if self._group.state is GroupState.FAULT:
                return  # the torque stays what it was when the fault came, until the brakes hold
            frame = self._frames[index]
            frame.torque = self._config.drives[index].units.per_mille(torque)
            self._torque_watch.told(index, torque)
            if frame.send(self._group.control_words[index], self._cycle_end):
                self._cycle.command(index, fresh=stamp_ns == self._sync_stamp, time=self._clock.monotonic())

    def reject_command(self, index: int, problem: str) -> None:
        """Count a command that could not be read; stop the drives when they are in motion."""
        with self._lock:
            self._refuse(index, f"{CommandFault.UNREADABLE.value} torque command: {problem}")

    # The operator's commands.

    def enable(self, index: int | None = None) -> str | None:
        """Begin to release the brakes, of all drives or of one; return why not when that is refused."""
        with self._lock:
            refusal = self._group.enable(self._clock.monotonic(), index)
            if refusal is None:
                self._cycle.clear()
                self.cycle_clock.clear()
                self._postponed = 0
            return refusal

    def disable(self, index: int | None = None) -> None:
        """Begin to close the brakes, of all drives or of one, and to take the torque away."""
        with self._lock:
            self._group.disable(self._clock.monotonic(), index)
            self._send_changed()

    def quick_stop(self, cause: str) -> None:
        """Stop all drives at once and latch the cause."""
        with self._lock:
            self._group.quick_stop(cause, self._clock.monotonic())
            self._send_changed()

    def fault_reset(self, index: int | None = None) -> str | None:
        """Begin to reset faults and the latched cause, or the fault of one drive; return why not when refused."""
        with self._lock:
            return self._group.fault_reset(self._clock.monotonic(), index)

    def set_home(self) -> str | None:
        """Take the present pose as the home pose and store it in the configuration file; return why not.

        The encoders go on counting as they do: the position value at which the motor angle is zero changes. Only at
        rest, for a controller would take the jump of the angle for motion.
        """
        with self._lock:
            now = self._clock.monotonic()
            if self._group.state in IN_MOTION:
                return f"the drives are {self._group.state.value}: disable them first"
            for index, drive in enumerate(self._group.drives):
                if (
                    drive.state is None
                    or self._group.feedback_age(index, now) > self._config.timeouts.feedback
                ):
                    return f"{drive.name} does not report its position"
                if not drive.held:
                    return f"the brake of {drive.name} is open"
            counts = [
                drive.units.counts(angle)
                for drive, angle in zip(self._config.drives, self._angles, strict=True)
            ]
            try:
                store_home(self._config, counts)
            except ConfigurationError as error:
                return str(error)
            self._config = with_home(self._config, counts)
            if self._speed is not None:
                self._speed.clear()
            return None

    @property
    def config(self) -> CanConfig:
        """The configuration in use."""
        return self._config

    def states(self) -> tuple[GroupState, str, tuple[DriveStatus, ...]]:
        """Return state and cause of the group, and the state of each drive."""
        with self._lock:
            return self._group.state, self._group.cause, self._group.drives

    def snapshot(self) -> DriveReport:
        """Return the present state."""
        now = self._clock.monotonic()
        with self._lock:
            return DriveReport(
                self._group.state,
                self._group.cause,
                self._group.drives,
                self._group.members,
                tuple(self._group.feedback_age(index, now) for index in range(len(self._devices))),
                tuple(device.heartbeat_age(now) for device in self._devices),
                tuple(device.nmt_state for device in self._devices),
                tuple(self._facts),
                self._commissioning.problems,
                self._cycle.statistics(),
                self._rejected,
                self._last_rejection,
                self.cycle_clock.skipped + self._postponed,
                self.cycle_clock.worst_lateness,
                self.cycle_clock.running,
            )

    # The cycle.

    def _tick(self, now: float) -> None:
        """Run in the clock's thread, so that a driver that hangs sends no heartbeat either."""
        if self._awaits_answers(now):
            self._postponed += 1
        else:
            self._ports.send_sync()
        for port in self._ports:
            if port.failure:
                self._bus_failed(port.name, port.failure)
        if now >= self._heartbeat_due:
            self._heartbeat_due = now + self._config.timeouts.heartbeat_producer
            for port in self._ports:
                port.send(self._heartbeat)
        deadline = now + self._config.period
        with self._lock:
            self._watch_heartbeats(now)
            self._group.step(now)
            for index, frame in enumerate(self._frames):
                word = self._group.control_words[index]
                repeat = not (frame.sent or self._group.settled(index))
                known = self._group.drives[index].state is not None
                if known and (repeat or word != frame.control_word):
                    frame.send(word, deadline)
                frame.sent = False

    def _awaits_answers(self, now: float) -> bool:
        """Whether the next SYNC is to be left out, because answers to the last one may still come.

        An answer that came after the next SYNC would be taken for the answer to that one: a position of the
        wrong moment, and a speed that is off by half or more. A drive that stays silent stops the robot later.
        """
        with self._lock:
            return (
                self._group.state is not GroupState.NOT_READY
                and bool(self._cycle.missing)
                and now - self._sync_time < _LONGEST_WAIT * self._config.period
            )

    def _begin_cycle(self, now: float, stamp_ns: int) -> None:
        self._cycle.sync(counted=self._group.state is GroupState.ENABLED)
        self._sync_time = now
        self._cycle_end = now + self.cycle_clock.period
        self._sync_stamp = stamp_ns

    def _feedback(self, index: int, data: bytes | bytearray, now: float) -> None:
        values = self._config.pdo.drive_tpdo.decode(data)
        units = self._config.drives[index].units
        with self._lock:
            self._group.feedback(index, values[self._status_place], now)
            if self._cycle.is_late(index):
                return
            self._angles[index] = units.angle(values[self._position_place])
            self._torques[index] = torque = units.torque(values[self._torque_place])
            problem = self._torque_watch.answered(index, torque, now, self._group.operates(index))
            if problem:
                self._group.quick_stop(f"{self._config.drives[index].name} {problem}", now)
            if not self._cycle.feedback(index, now):
                return
            states = self._complete()
        if states is not None:
            self._publish(states)

    def _velocity(self, index: int, data: bytes | bytearray, now: float) -> None:
        """Take the second frame of a drive, which holds its velocity."""
        (raw,) = frame_table.DRIVE_TPDO2.decode(data)
        with self._lock:
            facts = self._facts[index]
            place = index + len(self._facts)
            if facts is None or facts.velocity_unit is None or self._cycle.is_late(place):
                return
            self._speeds[index] = self._config.drives[index].units.polarity * raw * facts.velocity_unit
            if not self._cycle.feedback(place, now):
                return
            states = self._complete()
        if states is not None:
            self._publish(states)

    def _complete(self) -> MotorStates | None:
        """Return the motor states of the cycle in which everyone has answered; `None` while there is no speed."""
        angles = tuple(self._angles)
        if self._speed is None:
            speeds: list[float] | None = self._speeds
        else:
            speeds = self._speed.update(self._sync_time, angles)
        if speeds is None:
            return None  # the first cycle has no speed yet
        self._published_stamp = self._sync_stamp
        return MotorStates(self._sync_stamp, angles, tuple(speeds), tuple(self._torques))

    def _inputs(self, index: int, data: bytes | bytearray, now: float) -> None:
        """Take the digital inputs of a drive, which come when they change."""
        (inputs,) = frame_table.DRIVE_TPDO3.decode(data)
        entry = self._config.emergency_stop_input
        if entry is not None:
            with self._lock:
                self._group.emergency_stop(index, entry.is_active(inputs), now)
                self._send_changed()

    def _bus_failed(self, bus: str, problem: str) -> None:
        """Stop when a bus carries no frames any more, with that as the cause; what follows from it comes later."""
        with self._lock:
            if self._group.state in IN_MOTION:
                self._group.quick_stop(f"bus {bus}: {problem}", self._clock.monotonic())
                self._send_changed()

    def _handlers(self) -> Iterator[tuple[CanPort, int, FrameHandler]]:
        """Return which frames are for this driver, on which bus, and what takes them."""
        for index, drive in enumerate(self._config.drives):
            port = self._ports[drive.bus]
            yield port, cob_id(FunctionCode.TPDO1, drive.node_id), partial(self._feedback, index)
            if self._config.pdo.drive_tpdo_2 is not None:
                yield port, cob_id(FunctionCode.TPDO2, drive.node_id), partial(self._velocity, index)
            if self._config.emergency_stop_input is not None:
                yield port, cob_id(FunctionCode.TPDO3, drive.node_id), partial(self._inputs, index)

    def _send_changed(self) -> None:
        deadline = self._clock.monotonic() + self._config.period
        for index, (frame, word) in enumerate(zip(self._frames, self._group.control_words, strict=True)):
            if word != frame.control_word and not self._group.settled(index):
                frame.send(word, deadline)

    def _refuse(self, index: int, problem: str) -> None:
        self._rejected += 1
        self._last_rejection = f"{self._config.drives[index].name}: {problem}"
        if self._group.state in IN_MOTION:
            self._group.quick_stop(self._last_rejection, self._clock.monotonic())
            self._send_changed()

    def _at_rest(self) -> bool:
        with self._lock:
            return self._group.state not in IN_MOTION and self._group.held

    # The devices.

    def _configure(self, index: int) -> None:
        """Take a drive in; run by the commissioning thread."""
        try:
            facts = set_up_drive(self._devices[index], self._config, self._config.drives[index])
        except DeviceError as error:
            with self._lock:
                self._group.lost(index, error.problem, self._clock.monotonic())
            raise
        with self._lock:
            self._facts[index] = facts
            self._group.configured(index)
            if facts.error_register:
                past = Emergency(facts.error_code, facts.error_register, bytes(5), self._clock.monotonic())
                self._group.emergency(index, past)
            self._group.emergency_stop(index, facts.emergency_stop, self._clock.monotonic())

    def _may_configure(self) -> bool:
        with self._lock:
            return self._group.state not in IN_MOTION and self._group.held

    def _watch_heartbeats(self, now: float) -> None:
        if now < self._heartbeats_due:
            return
        self._heartbeats_due = now + _HEARTBEAT_WATCH
        times = self._config.timeouts
        for index, (device, drive) in enumerate(zip(self._devices, self._group.drives, strict=True)):
            if drive.unavailable:
                continue
            age = device.heartbeat_age(now)
            if age > times.heartbeat_consumer:
                self._lose(index, f"no heartbeat for {1e3 * age:.0f} ms", now)
            elif state := device.not_operational(grace=times.heartbeat_producer):
                self._lose(index, f"left NMT operational, it is {state}", now)

    def _booted(self, index: int) -> None:
        with self._lock:
            self._lose(index, "restarted", self._clock.monotonic())

    def _lose(self, index: int, reason: str, now: float) -> None:
        self._group.lost(index, reason, now)
        self._frames[index].control_word = None
        self._commissioning.request(index, reason)

    def _emergency(self, index: int, code: int, register: int, data: bytes) -> None:
        with self._lock:
            self._group.emergency(index, Emergency(code, register, data, self._clock.monotonic()))
            self._send_changed()
