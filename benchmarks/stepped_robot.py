"""The robot's driver, buses, devices and plant in simulated time: every step on command, nothing waits.

The parts are the product's own: the masters of drives and load cells, the emulated devices, MuJoCo's plant. In
between stands the model of the bus. All read this module's clock.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from heapq import heappop, heappush
from pathlib import Path

import can
import canopen

from cspr_drivers.bus.can_bus import CanPort, CanPorts
from cspr_drivers.canopen.frame_table import SYNC_COB_ID
from cspr_drivers.clock import Clock
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.drives.cycle_clock import CycleClock
from cspr_drivers.drives.master import DriveMaster
from cspr_drivers.drives.report import MotorStates
from cspr_drivers.load_cells.master import LoadCellMaster
from cspr_drivers.simulation.bus.bus_timing import DRIVER, BusTiming
from cspr_drivers.simulation.devices.drive import DriveEmulator
from cspr_drivers.simulation.devices.load_cell import LoadCellEmulator
from cspr_drivers.simulation.fault_injection import FaultInjector
from cspr_drivers.simulation.plant.plant import Plant
from cspr_drivers.simulation.plant.shared import SharedPlant
from cspr_drivers.simulation.simulation_config import SimulationConfig

TICK = 0.002  # s between two looks of a device at its time-outs and its brake
_BEGIN = 1000.0  # s, monotonic time at which the simulation begins
_SYSTEM = 1.7e9  # s, system time less monotonic time
_PATIENCE = 30.0  # s of real time for the devices to be configured


class SteppedClock(Clock):
    """The clock of the machine, standing still until told."""

    def __init__(self) -> None:
        self.time = _BEGIN

    def monotonic(self) -> float:
        """Time, s."""
        return self.time

    def sleep(self, duration: float) -> None:
        """Let time pass for the thread that steps; other threads get real time."""
        if threading.current_thread() is threading.main_thread():
            self.time += duration
        else:
            time.sleep(duration)

    def system(self) -> float:
        """Time since 1970, s."""
        return self.time + _SYSTEM

    def system_ns(self) -> int:
        """Time since 1970, ns."""
        return round((self.time + _SYSTEM) * 1e9)


class _SteppedCycleClock(CycleClock):
    """A cycle clock without a thread: the simulation calls `tick`."""

    _runs = False

    def start(self) -> None:
        self._runs = True

    def stop(self) -> None:
        self._runs = False

    @property
    def running(self) -> bool:
        return self._runs


class _End(can.BusABC):  # type: ignore[misc]
    """The driver's end of a bus."""

    def __init__(self, send: Callable[[can.Message], None]) -> None:
        super().__init__(channel=None)
        self._send = send
        self._closed = threading.Event()
        self.dead = False  # frames of a process that was killed are those that it has sent before

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if not self.dead:
            self._send(msg)

    def _recv_internal(self, timeout: float | None) -> tuple[None, bool]:
        self._closed.wait(timeout)
        return None, True

    def shutdown(self) -> None:
        self._closed.set()
        super().shutdown()


class _DevicesEnd:
    """The devices' end of a bus, as far as a canopen network that is told each frame needs one."""

    channel_info = "stepped"

    def __init__(self, send: Callable[[can.Message], None]) -> None:
        self.send = send


class SteppedRobot:
    """Driver, devices and plant, to be moved on with `run_until`.

    Parameters
    ----------
    can_config
        Buses and devices, all on the first bus or spread over several.
    simulation
        The true machine.
    eds
        Directory of the EDS files.

    Attributes
    ----------
    now
        Simulated time, s.
    drives, load_cells
        The driver's masters.
    devices
        The emulated drives.
    faults
        Puts faults into devices and buses.
    on_states, on_tensions, on_tick
        Called as the drivers publish, and every `TICK`.
    driver_runs
        Whether the driver does anything: a process that was stopped neither sends nor answers.
    """

    def __init__(self, can_config: CanConfig, simulation: SimulationConfig, eds: Path) -> None:
        self.clock = clock = SteppedClock()
        self.config = can_config
        self.plant = Plant(simulation)
        self.machine = SharedPlant(self.plant, simulation.payload_changes, clock)
        self.devices = tuple(
            DriveEmulator(
                drive,
                eds / "cia402_drive.eds",
                self.machine,
                index,
                simulation.brake,
                simulation.drive,
                can_config.brake_open_bit,
            )
            for index, drive in enumerate(can_config.drives)
        )
        self.amplifiers = tuple(
            LoadCellEmulator(
                cell,
                eds / "cia404_load_cell.eds",
                self.machine,
                index,
                simulation.load_cells,
                simulation.seed,
            )
            for index, cell in enumerate(can_config.load_cells)
        )
        self._conversion_time = simulation.load_cells.conversion_time
        self._lock = threading.Lock()  # over frames and events; the thread that configures devices sends too
        self._buses = {bus.name: BusTiming(bus.bitrate) for bus in can_config.buses}
        self._networks: dict[str, canopen.Network] = {}
        for bus in can_config.buses:
            network = canopen.Network(_DevicesEnd(self._sender(bus.name, "devices")))
            self._networks[bus.name] = network
            for config, node in zip(
                (*can_config.drives, *can_config.load_cells),
                (*self.devices, *self.amplifiers),
                strict=True,
            ):
                if config.bus == bus.name:
                    network.add_node(node)
        self.faults = FaultInjector(self.devices, self.amplifiers, self.machine, self._buses)
        self._events: list[tuple[float, int, Callable[[], None]]] = []
        self._count = 0
        self.driver_runs = True
        self.log: list[str] = []
        self.on_states: Callable[[MotorStates], None] = lambda states: None
        self.on_tensions: Callable[[int, tuple[float, ...]], None] = lambda stamp, tensions: None
        self.on_tick: Callable[[], None] = lambda: None
        for node in (*self.devices, *self.amplifiers):
            node.power_on()
        for bus in self._buses.values():
            bus.passed(self.now + 1.0)  # the devices booted before the driver came
        self._make_driver()
        self.at(self.now, self._cycle)
        self.at(self.now, self._tick)

    @property
    def now(self) -> float:
        """Simulated time, s, on the monotonic clock."""
        return self.clock.time

    def _make_driver(self) -> None:
        """Open the driver's ends of the buses, and make the two masters."""
        self._ends = [_End(self._sender(bus.name, DRIVER)) for bus in self.config.buses]
        ports = [
            CanPort(bus.name, end, clock=self.clock)
            for bus, end in zip(self.config.buses, self._ends, strict=True)
        ]
        self.ports = CanPorts(ports)
        self._port = {port.name: port for port in ports}
        self.drives = DriveMaster(
            self.config,
            self.ports,
            lambda states: self.on_states(states),
            self.log.append,
            _SteppedCycleClock,
        )
        self.load_cells = LoadCellMaster(
            self.config,
            self.ports,
            lambda *tensions: self.on_tensions(*tensions),
            self.log.append,
        )

    def kill_driver(self) -> None:
        """Let the driver end from one moment to the next, as by SIGKILL: it sends nothing more."""
        self.driver_runs = False
        for end in self._ends:
            end.dead = True
        self._end_threads()

    def restart_driver(self) -> None:
        """Start another driver in place of the one that was killed."""
        self._make_driver()
        self.driver_runs = True
        self.start()

    def _end_threads(self) -> None:
        self.drives._commissioning.stop()
        self.load_cells._commissioning.stop()
        self.ports.close()

    def start(self) -> None:
        """Start both masters and let them configure all devices."""
        self.load_cells.start()
        self.drives.start()
        self.wait_until(lambda: self.drives.states()[0].value == "disabled", "the drives are not ready")
        self.wait_until(
            lambda: not self.load_cells.snapshot(self.now).not_configured, "the cells are not ready"
        )

    def close(self) -> None:
        """Let the threads of both masters end."""
        self.faults.clear()
        self._end_threads()

    def at(self, time: float, action: Callable[[], None]) -> None:
        """Do something at a simulated time, s."""
        with self._lock:
            self._count += 1
            heappush(self._events, (time, self._count, action))

    def run_until(self, end: float) -> None:
        """Let simulated time pass up to a moment, s."""
        while (due := self._next_due()) <= end:
            self.clock.time = max(self.clock.time, due)
            for name, bus in self._buses.items():
                with self._lock:
                    frames = bus.passed(self.now)
                for passed in frames:
                    self._deliver(name, passed.sender, passed.frame)
            with self._lock:
                action = heappop(self._events)[2] if self._events[0][0] <= self.now else None
            if action is not None:
                action()
        self.clock.time = max(self.clock.time, end)
        self.machine.advance(self.machine.now(), exactly=True)

    def _next_due(self) -> float:
        with self._lock:
            due = self._events[0][0]
            for bus in self._buses.values():
                end = bus.next_end()
                if end is not None and end < due:
                    due = end
            return due

    def wait(self, duration: float) -> None:
        """Let simulated time pass, s."""
        self.run_until(self.now + duration)

    def wait_until(self, condition: Callable[[], bool], problem: str) -> None:
        """Let simulated time pass until something is so; threads of the driver get real time for it."""
        deadline = time.monotonic() + _PATIENCE
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError(f"{problem}: {self.drives.states()[:2]}, {self.log[-3:]}")
            self.wait(0.002)
            time.sleep(0)  # lets the thread that configures have its turn

    def _sender(self, bus: str, sender: str) -> Callable[[can.Message], None]:
        def send(message: can.Message) -> None:
            frame = can.Message(
                arbitration_id=message.arbitration_id, data=bytes(message.data), is_extended_id=False
            )
            with self._lock:
                self._buses[bus].offer(frame, sender, self.now)

        return send

    def _deliver(self, bus: str, sender: object, frame: can.Message) -> None:
        frame.timestamp = self.clock.system()
        if sender != DRIVER:
            if self.driver_runs:
                self._port[bus].receive(frame)
            return
        if frame.arbitration_id == SYNC_COB_ID:
            self._sync(bus)
        else:
            self._networks[bus].notify(frame.arbitration_id, bytearray(frame.data), frame.timestamp)

    def _sync(self, bus: str) -> None:
        moment = self.machine.now()
        self.machine.advance(moment, exactly=True)
        network = self._networks[bus]
        for drive in self.devices:
            if drive.network is network:
                drive.sync(moment)
        for cell in self.amplifiers:
            if cell.network is network:
                cell.latch()
                self.at(self.now + self._conversion_time, lambda cell=cell: cell.answer(self.machine.now()))  # type: ignore[misc]

    def _cycle(self) -> None:
        self.at(self.now + self.config.period, self._cycle)
        clock = self.drives.cycle_clock
        if clock.running and self.driver_runs:
            clock.tick(self.now)

    def _tick(self) -> None:
        self.at(self.now + TICK, self._tick)
        moment = self.machine.now()
        for node in (*self.devices, *self.amplifiers):
            node.tick(moment)
        self.on_tick()
