"""The robot in simulated time: the product's own drivers, devices and plant, and between them the model of the bus."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from cspr_control.closed_loop.machine import Publish
from cspr_control.closed_loop.simulated_time import SimulatedTime
from cspr_control.supervision.supervisor import Decision
from cspr_drivers.bus.can_ports import CanPorts
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.cycle.cycle_clock import CycleClock
from cspr_drivers.driver_messages import (
    bus_status,
    drive_diagnostics,
    drive_states,
    load_cell_diagnostics,
    load_cell_states,
)
from cspr_drivers.drives.master import DriveMaster
from cspr_drivers.drives.report import MotorStates
from cspr_drivers.drives.winding import Direction
from cspr_drivers.errors import DriverError
from cspr_drivers.load_cells.master import LoadCellMaster
from cspr_drivers.simulation.bus.simulated_bus import SimulatedBus
from cspr_drivers.simulation.devices.load_cell import LoadCellEmulator
from cspr_drivers.simulation.emulated_devices import EmulatedDevices
from cspr_drivers.simulation.fault_injection import FaultInjector
from cspr_drivers.simulation.plant.plant import Plant
from cspr_drivers.simulation.simulation_config import SimulationConfig, Sling
from cspr_kinematics import Payload
from cspr_msgs_py.topics import (
    CABLE_TENSIONS,
    DIAGNOSTICS,
    DRIVE_STATES,
    LOAD_CELL_STATES,
    MOTOR_STATES,
    ROSOUT,
    TRUE_POSE,
    Topic,
    cable_names,
)
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import LogLine, Status, StatusArray

TICK = 0.004  # s between two looks of a device at its time-outs and its brake
_STATE_PERIOD = 0.02  # s; how soon a change of state is published
_WATCH_PERIOD = 0.5  # s; how often the heartbeats of the load cells are looked at
_PLANT_LAG = 0.01  # s; at this distance the plant follows time where no SYNC moves it on
_PATIENCE = 10.0  # s for the devices to be set up
_NONE = np.empty(0)


class SimulatedRobot:
    """Drivers, buses, devices and plant; a `Machine`.

    Parameters
    ----------
    time
        Its time.
    can_config
        Buses and devices.
    simulation
        The true machine.
    eds
        Directory of the EDS files.
    believed
        Buses and devices as the driver believes them to be; as they are by default.

    Attributes
    ----------
    drives, load_cells
        The driver's masters.
    devices, amplifiers
        The emulated drives and amplifiers.
    faults
        Puts faults into devices and buses.
    on_tick
        Called every `TICK`.
    """

    def __init__(
        self,
        time: SimulatedTime,
        can_config: CanConfig,
        simulation: SimulationConfig,
        eds: Path,
        believed: CanConfig | None = None,
    ) -> None:
        self.time = time
        self.config = believed or can_config
        self.plant = Plant(simulation)
        self._emulated = EmulatedDevices(can_config, simulation, self.plant, eds, time)
        self.machine = self._emulated.machine
        self.devices, self.amplifiers = self._emulated.drives, self._emulated.load_cells
        self._buses = {
            bus.name: SimulatedBus(bus.name, bus.bitrate, time, self._sync) for bus in can_config.buses
        }
        for name, line in self._buses.items():
            self._emulated.join(name, line.network)
        timings = {name: line.timing.disturb for name, line in self._buses.items()}
        self.faults = FaultInjector(self.devices, self.amplifiers, self.machine, timings)
        self.publish: Publish = lambda topic, sample: None
        self.on_tick: Callable[[], None] = lambda: None
        self._published: dict[Topic, tuple[object, float]] = {}
        self._cables = cable_names(len(can_config.load_cells))
        self._emulated.power_on()
        for line in self._buses.values():
            time.add(line)
            line.timing.passed(time.monotonic() + 1.0)  # the devices booted before the driver came
        self._make_driver()
        time.every(can_config.period, self._cycle)
        time.every(TICK, self._tick)
        time.every(_STATE_PERIOD, self._publish_states)
        time.every(_WATCH_PERIOD, self._watch)
        time.every(1.0, self._report)

    # The machine

    def begin(self) -> None:
        """Start both masters and let them set up all devices."""
        self.load_cells.start()
        self.drives.start()
        end = self.time.monotonic() + _PATIENCE
        while waiting := self.not_set_up():
            if self.time.monotonic() > end:
                raise DriverError(f"devices are not set up: {waiting}")
            self.time.wait(_STATE_PERIOD)

    def not_set_up(self) -> dict[str, str]:
        """Return the devices that are not set up, with the reason."""
        cells = self.load_cells.snapshot(self.time.monotonic())
        return self.drives.snapshot().not_configured | cells.not_configured

    def command(self, commands: Sequence[tuple[int, int, float]]) -> None:
        """Give drives their torques, N m."""
        if self.driver_runs:
            for command in commands:
                self.drives.command(*command)

    def reject_command(self, motor: int, problem: str) -> None:
        """Give a drive's driver a command that cannot be read."""
        if self.driver_runs:
            self.drives.reject_command(motor, problem)

    def supervised(self, stamp_ns: int) -> None:
        """Give the driver the supervisor's sign of life."""
        if self.driver_runs:
            self.drives.supervised(stamp_ns)

    def call(self, service: str) -> Decision:
        """Answer a service of the driver."""
        if not self.driver_runs:
            return Decision(False, "the driver does not answer")
        drives = self.drives
        commands: dict[str, Callable[[], str | None]] = {
            "/can_drives/enable": drives.enable,
            "/can_drives/disable": drives.disable,
            "/can_drives/quick_stop": partial(drives.quick_stop, "quick stop commanded"),
            "/can_drives/fault_reset": drives.fault_reset,
        }
        for index, motor in enumerate(self.config.drives):
            for way in Direction:
                name = f"/can_drives/{motor.name}/wind_{way.name.lower()}"
                commands[name] = partial(drives.wind, index, way)
        refusal = commands[service]()
        return Decision(refusal is None, refusal or "accepted")

    def disturb(
        self, bus: str, identifier: int, through: Callable[[bytes], bytes | None]
    ) -> Callable[[], None]:
        """Let frames go through a function, None for nothing; return what ends that."""
        disturbed = self._buses[bus].disturbed
        disturbed[identifier] = through
        return partial(disturbed.__delitem__, identifier)

    def change_payload(
        self, payload: Payload, stamp_ns: int, duration: float = 0.0, sling: Sling | None = None
    ) -> None:
        """Let another payload come aboard from a moment on, ns of ROS time, within a duration, s, or on a sling."""
        self.machine.change_payload(payload, self.machine.from_ros_time(stamp_ns * 1e-9), duration, sling)

    def close(self) -> None:
        """End the driver."""
        self.faults.clear()
        self._end_driver()

    # The driver

    @property
    def driver_runs(self) -> bool:
        """Whether the driver does anything: a process that was stopped neither hears, nor sends, nor answers."""
        return all(line.driver_listens for line in self._buses.values())

    @driver_runs.setter
    def driver_runs(self, runs: bool) -> None:
        for line in self._buses.values():
            line.driver_listens = runs

    def kill_driver(self) -> None:
        """Let the driver end from one moment to the next, as by SIGKILL: it sends nothing more."""
        self.driver_runs = False
        for line in self._buses.values():
            line.cut_off()
        self._end_driver()

    def restart_driver(self) -> None:
        """Start another driver in place of the one that was killed."""
        self._make_driver()
        self.driver_runs = True
        self.begin()

    def _make_driver(self) -> None:
        """Open the driver's ends of the buses, and make the two masters."""
        self.ports = CanPorts([line.open() for line in self._buses.values()])
        self.ports.on_sync(self._emulated.announce_sync, threading.Lock())
        self.drives = DriveMaster(
            self.config,
            self.ports,
            self._publish_motors,
            partial(self._warn, "can_drives"),
            _SimulatedCycleClock,
        )
        self.load_cells = LoadCellMaster(
            self.config, self.ports, self._publish_tensions, partial(self._warn, "load_cells")
        )

    def _end_driver(self) -> None:
        self.time.end_tasks()
        self.ports.close()

    def _cycle(self) -> None:
        clock = self.drives.cycle_clock
        if clock.running and self.driver_runs:
            clock.tick(self.time.monotonic())

    # What it publishes

    def _publish_motors(self, states: MotorStates) -> None:
        angles, speeds, torques = map(np.array, (states.angles, states.speeds, states.torques))
        self.publish(MOTOR_STATES, JointStateSample(states.stamp_ns, angles, speeds, torques))

    def _publish_tensions(self, stamp_ns: int, tensions: tuple[float, ...]) -> None:
        self.drives.tensions(tensions)
        self.publish(CABLE_TENSIONS, JointStateSample(stamp_ns, _NONE, _NONE, np.array(tensions)))

    def _warn(self, node: str, text: str) -> None:
        self.publish(ROSOUT, LogLine(self.time.system_ns(), Level.WARN, node, text))

    def _publish_states(self) -> None:
        if not self.driver_runs:
            return
        now = self.time.monotonic()
        if self._is_due(DRIVE_STATES, self.drives.states(), now):
            self._publish_statuses(DRIVE_STATES, drive_states(self.drives.snapshot()))
        problems = self.load_cells.problems(now)
        if self._is_due(LOAD_CELL_STATES, problems, now):
            self._publish_statuses(LOAD_CELL_STATES, load_cell_states(self._cables, problems))

    def _is_due(self, topic: Topic, state: object, now: float) -> bool:
        """Return whether a state is to be published: when it has changed, and once a second."""
        before, since = self._published.get(topic, (None, -1.0))
        if state == before and now - since < 1.0:
            return False
        self._published[topic] = (state, now)
        return True

    def _report(self) -> None:
        if self.driver_runs:
            now = self.time.monotonic()
            self._publish_statuses(
                DIAGNOSTICS,
                [
                    *drive_diagnostics(self.drives.snapshot()),
                    *load_cell_diagnostics(self._cables, self.load_cells.snapshot(now)),
                    *(bus_status("can_drives", port) for port in self.ports),
                ],
            )

    def _publish_statuses(self, topic: Topic, statuses: Sequence[Status]) -> None:
        self.publish(topic, StatusArray(self.time.system_ns(), tuple(statuses)))

    def _watch(self) -> None:
        if self.driver_runs:
            self.load_cells.watch(self.time.monotonic())

    # The devices

    def _sync(self, network: object) -> None:
        """Let the devices of a network measure, and answer."""
        cells = self._emulated.measure(network, self.machine.now())
        pose = self._emulated.true_pose(self.time.system_ns())
        if pose is not None:
            self.publish(TRUE_POSE, pose)
        moment = self.time.monotonic() + self._emulated.conversion_time
        self.time.at(moment, partial(self._answer, cells))

    def _answer(self, cells: Sequence[LoadCellEmulator]) -> None:
        for cell in cells:
            cell.answer()

    def _tick(self) -> None:
        moment = self.machine.now()
        self.machine.advance(moment - _PLANT_LAG)
        self._emulated.tick(moment)
        self.on_tick()


class _SimulatedCycleClock(CycleClock):
    """A cycle clock without a thread: simulated time calls `tick`."""

    _runs = False

    def start(self) -> None:
        self._runs = True

    def stop(self) -> None:
        self._runs = False

    @property
    def running(self) -> bool:
        return self._runs
