"""The driver of all drives: a shell around the control cycle that sends what the cycle returns.

Three kinds of threads meet here: the cycle clock, the receiving thread of each bus, and the callers of `command`
and of the operator's methods. One lock guards the state of the cycle and is held neither while frames are sent nor
while motor states are published. A thread that makes frames holds another one until they are sent, so that no frame
overtakes one that was made before it.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from functools import partial

from cspr_drivers.bus.can_bus import CanPort, CyclicFrame, FrameHandler
from cspr_drivers.bus.can_ports import CanPorts
from cspr_drivers.canopen.frame_table import FunctionCode, cob_id
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.cycle.cycle_clock import CycleClock
from cspr_drivers.devices.device import CanopenDevice, leave_operational
from cspr_drivers.devices.setup import check_drive, set_up_drive
from cspr_drivers.devices.setup_thread import SetupThread
from cspr_drivers.drives.cycle import DriveCycle
from cspr_drivers.drives.home_position import store_home
from cspr_drivers.drives.report import DriveReport, MotorStates
from cspr_drivers.drives.status import DriveStatus
from cspr_drivers.drives.torque_frames import Frame
from cspr_drivers.drives.winding import Direction
from cspr_drivers.errors import ConfigurationError, DeviceError
from cspr_drivers.thread_end import telling
from cspr_msgs_py.vocabulary import DriverState

_HEARTBEAT_WATCH = 0.02  # s between two looks at the heartbeats of the drives
_READERS = (
    2  # drives of which settings are read at the same time: more would crowd the cycle out of a busy computer
)


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
        self._ports = ports
        self._publish = publish
        self._report = report
        self._clock = ports.clock
        self._cycle = DriveCycle(config)
        self._lock = threading.Lock()  # over the cycle
        self._sending = threading.Lock()  # over what it returns, until that is sent
        self._storing = threading.Lock()  # while a home pose is stored: nothing is enabled meanwhile
        self._message = CyclicFrame(0)  # the one being sent
        self._reading: set[int] = set()  # drives whose settings are being read again
        self._heartbeats_due = 0.0
        self._started = self._stopped = False
        self.cycle_clock = cycle_clock(config.period, self._tick, self._clock, self._thread_ended)
        self._setup = SetupThread(
            [str(drive) for drive in config.drives],
            self._configure,
            self._may_configure,
            report,
            self._clock,
            on_end=self._thread_ended,
        )
        self._devices = [
            CanopenDevice(
                str(drive),
                ports[drive.bus],
                drive.node_id,
                config.timeouts.sdo,
                on_boot=partial(self._lose, index, "restarted"),
                on_emergency=partial(self._act, self._cycle.emergency, index),
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
        wait = self._clock.on_computer(1.5 * self.config.timeouts.heartbeat_producer)
        self._ports.require_no_driver(self.config.master_node_id, wait)
        self._started = True
        for port, identifier, handler in self._handlers():
            port.subscribe(identifier, handler)
        for port in self._ports:
            port.on_failure = partial(self._act, self._cycle.bus_failed, port.name)
        self._ports.on_sync(self._cycle.sync, self._lock)
        self.cycle_clock.start()
        self._setup.start()

    def come_to_rest(self, for_good: bool = False) -> None:
        """Close the brakes and wait until they hold, no longer than a limit.

        Before the driver goes `for_good` it waits without one while drives have to hold the load in place of a brake:
        with its heartbeat their torque would go.
        """
        self.disable()
        deadline = self._clock.monotonic() + 2.0 * self.config.timeouts.stop
        told = not for_good
        while self.cycle_clock.running and not self._at_rest():
            held = self.states()[0] is DriverState.HELD_BY_DRIVES
            if held and not told:
                told = True
                self._report(
                    f"{self.states()[1]}: the drives keep their torque, and the driver does not end: support the load, "
                    "then kill it"
                )
            if self._clock.monotonic() >= deadline and not (for_good and held):
                break
            self._clock.sleep(self.config.period)

    def stop(self) -> None:
        """Close the brakes, wait until they hold (no longer than a limit), and leave the bus."""
        if self._stopped:
            return
        self._stopped = True
        if self._started:
            self.come_to_rest(for_good=True)
            self._setup.stop()
            leave_operational(self._devices)
            self.cycle_clock.stop()
            self._ports.off_sync(self._cycle.sync)
            for port in self._ports:
                port.on_failure = None
            for port, identifier, _ in self._handlers():
                port.unsubscribe(identifier)
        for device in self._devices:
            device.release()

    # Torque commands.

    def command(self, index: int, stamp_ns: int, torque: float) -> None:
        """Send a torque, N m, to a drive at once, if it may have it; else stop the drives. See `DriveCycle.command`."""
        self._act(self._cycle.command, index, stamp_ns, torque)

    def reject_command(self, index: int, problem: str) -> None:
        """Count a command that could not be read; stop the drives when they are in motion."""
        self._act(self._cycle.unreadable, index, problem)

    def supervised(self, stamp_ns: int) -> None:
        """Note the supervisor's sign of life; see `DriveCycle.supervised`."""
        with self._lock:
            self._cycle.supervised(self._clock.monotonic(), stamp_ns)

    # The operator's commands.

    def enable(self, index: int | None = None) -> str | None:
        """Begin to release the brakes, of all drives or of one; return why not when that is refused.

        First all settings of these drives are read again: somebody may have changed them with the maker's program. One
        that is no longer as it was set up stops that, by its name and both values, and is set up again. Drives that
        hold the load, as a brake does not, are not asked: whatever they are set to, they must go on holding.
        """
        concerned: Sequence[int] = range(len(self._devices)) if index is None else (index,)
        with self._storing, self._lock:
            if self._reading:
                return "the settings of the drives are still being read: try again in a moment"
            if self._cycle.group.state is DriverState.HELD_BY_DRIVES:
                concerned = ()
            refusal = self._cycle.enable(self._clock.monotonic(), index, concerned)
            if refusal is not None:
                return refusal
            self.cycle_clock.clear()
            self._reading.update(concerned)
        for reader in range(min(_READERS, len(concerned))):
            drives, name = concerned[reader::_READERS], f"reader {reader + 1} of settings"
            self._clock.start(telling(partial(self._read_again, drives), name, self._thread_ended), name)
        return None

    def tensions(self, tensions: Sequence[float]) -> None:
        """Note the tensions of the cables (m,), N; see `DriveCycle.tensions`."""
        with self._lock:
            self._cycle.tensions(self._clock.monotonic(), tensions)

    def wind(self, index: int, direction: Direction) -> str | None:
        """Begin to wind a single winch for a moment; return why not, and what to do, when that is refused."""
        with self._storing, self._lock:
            return self._cycle.wind(self._clock.monotonic(), index, direction)

    def disable(self, index: int | None = None) -> str | None:
        """Begin to close the brakes, of all drives or of one, and to take the torque away; return why not."""
        with self._lock:
            refusal = self._cycle.group.disable_refusal(index)
        if refusal is None:
            self._act(self._cycle.disable, index)
        return refusal

    def quick_stop(self, cause: str) -> None:
        """Stop all drives at once and latch the cause."""
        self._act(self._cycle.quick_stop, cause)

    def fault_reset(self, index: int | None = None) -> str | None:
        """Begin to reset faults and the latched cause, or the fault of one drive; return why not when refused."""
        with self._lock:
            return self._cycle.fault_reset(self._clock.monotonic(), index)

    def set_home(self) -> str | None:
        """Make the present pose the home pose and store it in the configuration file; return why not.

        The encoders go on counting as they do: the position value at which the motor angle is zero changes.
        """
        with self._storing:
            with self._lock:
                refusal = self._cycle.home_refusal(self._clock.monotonic())
                counts = self._cycle.counts()
            if refusal is None:
                try:
                    store_home(self.config, counts)
                except ConfigurationError as error:
                    return str(error)
                with self._lock:
                    self._cycle.set_home(counts)
            return refusal

    # What is known.

    @property
    def config(self) -> CanConfig:
        """The configuration in use."""
        return self._cycle.config

    def states(self) -> tuple[DriverState, str, tuple[DriveStatus, ...]]:
        """Return state and cause of the group, and the state of each drive."""
        group = self._cycle.group
        with self._lock:
            return group.state, group.cause, group.drives

    def snapshot(self) -> DriveReport:
        """Return the present state."""
        cycle, group, now = self._cycle, self._cycle.group, self._clock.monotonic()
        with self._lock:
            return DriveReport(
                group.state,
                group.cause,
                group.drives,
                group.members,
                tuple(group.feedback_age(index, now) for index in range(len(self._devices))),
                tuple(device.heartbeat_age(now) for device in self._devices),
                tuple(device.nmt_state for device in self._devices),
                tuple(cycle.facts),
                self._setup.problems,
                cycle.watch.statistics(),
                cycle.rejected,
                cycle.last_rejection,
                self.cycle_clock.skipped + cycle.postponed,
                self.cycle_clock.worst_lateness,
                self.cycle_clock.running,
                self._clock.time_of_day_set_by(),
                cycle.last_winding,
                cycle.config.fingerprint,
                group.last_proof,
            )

    def _at_rest(self) -> bool:
        with self._lock:
            return self._cycle.at_rest

    # The cycle.

    def _tick(self, now: float) -> None:
        """Run in the clock's thread, so that a driver that hangs sends no heartbeat either."""
        with self._lock:
            wants_sync = self._cycle.wants_sync(now)
        if wants_sync:
            self._ports.send_sync()
        for port in self._ports:
            if port.ended:
                self._thread_ended(port.ended)
            elif port.failure:
                self._act(self._cycle.bus_failed, port.name, port.failure)
        self._watch_devices(now)
        self._act(self._cycle.step)

    def _thread_ended(self, problem: str) -> None:
        self._act(self._cycle.thread_ended, problem)

    def _act(self, act: Callable[..., list[Frame]], *arguments: object) -> None:
        """Call a method of the cycle with the time and its arguments, and send the frames that it returns."""
        with self._sending:
            with self._lock:
                frames = act(self._clock.monotonic(), *arguments)
            for frame in frames:
                self._message.arbitration_id = frame.cob_id
                self._message.assign(frame.data)
                sent = self._ports[frame.bus].send(self._message, frame.deadline)
                if sent and frame.command is not None:
                    with self._lock:
                        self._cycle.sent(self._clock.monotonic(), *frame.command)

    def _take(
        self, take: Callable[..., MotorStates | None], index: int, data: bytes | bytearray, now: float
    ) -> None:
        """Give a frame with measurements to the cycle; publish the motor states when it was the last one missing."""
        with self._lock:
            states = take(now, index, data)
        if states is not None:
            self._publish(states)

    def _take_inputs(self, index: int, data: bytes | bytearray, now: float) -> None:
        self._act(self._cycle.inputs, index, data)

    def _handlers(self) -> Iterator[tuple[CanPort, int, FrameHandler]]:
        """Return which frames are for this driver, on which bus, and what takes them."""
        config, cycle = self.config, self._cycle
        for index, drive in enumerate(config.drives):
            port = self._ports[drive.bus]
            for function, used, handler in (
                (FunctionCode.TPDO1, config.pdo.drive_tpdo, partial(self._take, cycle.feedback, index)),
                (FunctionCode.TPDO2, config.pdo.drive_tpdo_2, partial(self._take, cycle.velocity, index)),
                (FunctionCode.TPDO3, config.emergency_stop_input, partial(self._take_inputs, index)),
            ):
                if used is not None:
                    yield port, cob_id(function, drive.node_id), handler

    # The devices.

    def _configure(self, index: int) -> None:
        """Configure a drive; run by the set-up thread."""
        try:
            facts = set_up_drive(self._devices[index], self.config, self.config.drives[index])
        except DeviceError as error:
            with self._lock:
                self._cycle.lost(self._clock.monotonic(), index, error.problem)
            raise
        with self._lock:
            self._cycle.configured(self._clock.monotonic(), index, facts)

    def _may_configure(self, index: int) -> bool:
        with self._lock:
            return self._cycle.at_rest and index not in self._reading

    def _read_again(self, indices: Sequence[int]) -> None:
        """Compare the settings of drives that are to be enabled with those of their set-up; in a thread of its own."""
        for index in indices:
            problem, facts = "", self._cycle.facts[index]
            try:
                if facts is not None:
                    check_drive(self._devices[index], self.config, self.config.drives[index], facts)
            except DeviceError as error:
                problem = error.problem
            with self._lock:
                self._reading.difference_update(indices if problem else (index,))
                if not problem:
                    self._cycle.group.confirmed(index, self._clock.monotonic())
            if problem:
                self._lose(index, f"settings read again before enabling: {problem}")
                return

    def _watch_devices(self, now: float) -> None:
        if now < self._heartbeats_due:
            return
        self._heartbeats_due = now + _HEARTBEAT_WATCH
        for index, (device, drive) in enumerate(zip(self._devices, self.states()[2], strict=True)):
            if not drive.unavailable and (problem := device.problem(now, self.config.timeouts)):
                self._lose(index, problem)

    def _lose(self, index: int, reason: str) -> None:
        with self._lock:
            self._cycle.lost(self._clock.monotonic(), index, reason)
        self._setup.request(index, reason)
