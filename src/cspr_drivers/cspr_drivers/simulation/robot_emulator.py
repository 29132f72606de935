"""All drives and load cells of a robot on its CAN buses, with the simulated machine behind them."""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from typing import TYPE_CHECKING

import can
import canopen

from cspr_drivers.bus.can_bus import Receiver
from cspr_drivers.bus.opening import open_bus
from cspr_drivers.bus.virtual_bus import QuickVirtualBus
from cspr_drivers.canopen.frame_table import SYNC_COB_ID
from cspr_drivers.clock import COMPUTER, Clock
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.errors import BusError, DriverError
from cspr_drivers.simulation.bus.bus_timing import BusDisturbance
from cspr_drivers.simulation.bus.timed_bus import TimedBus
from cspr_drivers.simulation.devices.load_cell import LoadCellEmulator
from cspr_drivers.simulation.emulated_devices import EmulatedDevices
from cspr_drivers.simulation.fault_injection import FaultInjector
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_kinematics import KinematicsError, Payload
from cspr_msgs_py.wire.samples import PoseSample

if TYPE_CHECKING:
    from cspr_drivers.simulation.plant.plant import Plant

# s between two looks at time-outs and brakes. With SYNC the looks come with it; without, a thread looks, more
# often while a brake moves.
_TICK = 0.005
_IDLE_TICK = 0.02
_LATE = 0.02  # s; when the thread is later than this, silence of the master proves nothing
# Between SYNCs the plant follows the clock at this distance, so that it never overtakes an unread SYNC, whose
# time stamp says when the devices have to measure.
_PLANT_LAG = 0.03  # s
# s after which a SYNC is no longer answered: devices do not keep old SYNCs in a queue, and answering them
# would keep a computer that was held up from catching up.
_STALE = 0.05
_LONGEST_CLOSING = 0.1  # s until the receiving thread of a bus sees that it has to end


class RobotEmulator(EmulatedDevices):
    """The devices of `can.yaml`, on the buses that it names: virtual, or SocketCAN for a driver in another process.

    Each bus has one interface and one canopen network for all of its devices. They measure at the time stamp
    of each SYNC; in between, a thread looks after heartbeats, time-outs and brakes.

    Parameters
    ----------
    can_config, simulation, plant, eds_directory, clock
        As of `EmulatedDevices`.
    bus_timing
        Whether frames on virtual buses take as long as on a real bus, see `TimedBus`.
    publish_pose
        Given the true pose of the platform once per SYNC, when the amplifiers have answered it.

    Attributes
    ----------
    faults
        Puts faults into devices and buses.
    missed_syncs
        SYNCs that were not answered because they were read too late.

    Raises
    ------
    ConfigurationError
        As `EmulatedDevices`.
    BusError
        If a bus cannot be opened.
    """

    def __init__(
        self,
        can_config: CanConfig,
        simulation: SimulationConfig,
        plant: Plant,
        eds_directory: Path,
        bus_timing: bool = False,
        clock: Clock = COMPUTER,
        publish_pose: Callable[[PoseSample], None] = lambda sample: None,
    ) -> None:
        super().__init__(can_config, simulation, plant, eds_directory, clock)
        self._clock = clock
        self._publish_pose = publish_pose
        # The torques of a cycle are applied while the amplifiers convert, or by the next SYNC: their sender
        # need not wait for the plant.
        self.machine.inputs_at_once = 2 * len(self.drives)
        self._networks: list[canopen.Network] = []
        buses: dict[str, Callable[[BusDisturbance], None]] = {}
        self.missed_syncs = 0
        self._last_tick = 0.0
        self._stopping = threading.Event()
        # How far the plant moves on after a SYNC while there is time for it: never past the next one.
        self._head_start = self.conversion_time if self.conversion_time < can_config.period else 0.0
        self._conversions: SimpleQueue[
            tuple[float, tuple[LoadCellEmulator, ...], PoseSample | None] | None
        ] = SimpleQueue()
        self._converter = threading.Thread(target=self._convert, name="amplifiers", daemon=True)
        self._ticker = threading.Thread(target=self._keep_time, name="emulated devices", daemon=True)
        try:
            for bus in can_config.buses:
                network = canopen.Network(open_bus(bus, clock=clock))
                self._networks.append(network)
                if isinstance(network.bus, QuickVirtualBus):
                    network.bus = TimedBus(
                        network.bus, bus.bitrate, partial(self._deliver, network), bus_timing, clock
                    )
                    buses[bus.name] = network.bus.disturb
                else:
                    network.NOTIFIER_CYCLE = _LONGEST_CLOSING
                    network.listeners[:] = [
                        Receiver(partial(self._deliver, network), partial(self._interface_failed, network))
                    ]
                    network.connect()
                self.join(bus.name, network)
                network.subscribe(SYNC_COB_ID, partial(self._on_sync, network))
        except BusError:
            self.close()
            raise
        self.faults = FaultInjector(self.drives, self.load_cells, self.machine, buses)
        self.power_on()
        self._ticker.start()
        self._converter.start()

    def __enter__(self) -> RobotEmulator:
        return self

    def __exit__(self, *_raised: object) -> None:
        self.close()

    def close(self) -> None:
        """Take the devices off their buses; closing twice is allowed."""
        self._stopping.set()
        self._conversions.put(None)
        for thread in (self._ticker, self._converter):
            if thread.is_alive():
                thread.join()
        for network in self._networks:
            network.disconnect()
        self._networks = []

    @property
    def lag(self) -> float:
        """Time by which the plant is behind the clock, s; a few cycles are normal."""
        return self.machine.now() - self.machine.time

    @property
    def payload(self) -> Payload:
        """What the platform carries now."""
        return self.machine.plant.payload

    def change_payload(
        self, mass: float, center_of_mass: tuple[float, float, float], at: float | None = None
    ) -> None:
        """Let the platform carry another payload.

        Parameters
        ----------
        mass, center_of_mass
            Of the payload in place of the present one, kg, and m in the frame of the platform.
        at
            When, s of ROS time; a time in the past, or `None`, means now.

        Raises
        ------
        DriverError
            If no payload has them: the mass is negative, or a number is not finite.
        """
        try:
            payload = Payload(mass, center_of_mass)
        except KinematicsError as error:
            raise DriverError(str(error)) from None
        with self.machine.lock:
            time = self.machine.now() if at is None else self.machine.from_ros_time(at)
            self.machine.change_payload(payload, time)

    def slack_cables(self) -> tuple[int, ...]:
        """Return the numbers, from 0, of the cables that had no tension when the devices last measured."""
        # Without the lock: who asks is not to wait for the plant, and a measurement never changes.
        tensions = self.machine.newest_measurement.tensions
        return tuple(index for index, tension in enumerate(tensions) if tension <= 0.0)

    def _deliver(self, network: canopen.Network, message: can.Message) -> None:
        """Give a frame to the devices of a network, in the thread of its sender."""
        if message.is_error_frame or message.is_remote_frame:
            return
        try:
            network.notify(message.arbitration_id, message.data, message.timestamp)
        except Exception as error:  # the sender has no part in what goes wrong in a device
            if self.machine.failure is None:
                self.machine.failure = DriverError(f"an emulated device failed: {error!r}")
                traceback.print_exception(error)

    def _interface_failed(self, network: canopen.Network, error: Exception) -> None:
        """Go on after a failure, as the interface may come up again: canopen would stop sending."""
        if network.notifier is not None:
            network.notifier.exception = None
        self._clock.sleep(_LONGEST_CLOSING)

    def _on_sync(self, network: canopen.Network, _can_id: int, _data: bytearray, timestamp: float) -> None:
        machine = self.machine
        with machine.lock:
            time = machine.time_at(timestamp)
            if machine.now() - time > _STALE:
                self.missed_syncs += 1
                return
            load_cells = self.measure(network, time)
            pose = self.true_pose(round(1e9 * machine.ros_time(time)))
            if self.conversion_time == 0.0:
                for cell in load_cells:
                    cell.answer()
                self._tick_after_sync(time)
            else:
                self._conversions.put((time, load_cells, pose))
        if self.conversion_time == 0.0 and pose is not None:
            self._publish_pose(pose)

    def _convert(self) -> None:
        """Let the amplifiers answer each SYNC when their conversion is done."""
        machine = self.machine
        while (conversion := self._conversions.get()) is not None:
            time, load_cells, pose = conversion
            self._clock.sleep(max(0.0, time + self.conversion_time - machine.now()))
            with machine.lock:
                for cell in load_cells:
                    cell.answer()
                try:
                    machine.apply_arrived(machine.now())
                    # Done here, it need not be done at the next SYNC, when the drivers wait for the drives' answers.
                    machine.advance(time + self._head_start)
                    self._tick_after_sync(time)
                except DriverError:
                    return  # the plant failed, and `failure` says why
            if pose is not None:
                self._publish_pose(pose)

    def _keep_time(self) -> None:
        machine = self.machine
        due = machine.now()
        while True:
            settled = all(drive.automaton.settled for drive in self.drives)
            due += _IDLE_TICK if settled else _TICK
            if self._stopping.wait(self._clock.on_computer(max(0.0, due - machine.now()))):
                return
            with machine.lock:
                now = machine.now()
                late = now - due > _LATE
                if late:
                    due = now
                try:
                    if now - self._last_tick >= _TICK:
                        machine.advance(now - _PLANT_LAG)
                        machine.measure()
                        self.tick(now, supervise=not late)
                except DriverError:
                    return  # the plant failed, and `failure` says why

    def _tick_after_sync(self, time: float) -> None:
        """Look at time-outs and brakes; everything that was sent before the SYNC has been read."""
        if time - self._last_tick >= _TICK:
            self.tick(time)

    def tick(self, time: float, supervise: bool = True) -> None:
        """Let all devices do what is due; see `EmulatedNode.tick`."""
        self._last_tick = time
        super().tick(time, supervise)
