"""All drives and load cells of a robot on its CAN buses, with the simulated machine behind them."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from types import TracebackType

import can
import canopen
from cspr_kinematics import Payload

from cspr_drivers.can_config import BusConfig, CanConfig
from cspr_drivers.errors import BusError, ConfigurationError, DriverError
from cspr_drivers.simulation.drive_emulator import DriveEmulator
from cspr_drivers.simulation.emulated_node import EmulatedNode
from cspr_drivers.simulation.load_cell_emulator import LoadCellEmulator
from cspr_drivers.simulation.shared_plant import PlantModel, SharedPlant
from cspr_drivers.simulation.simulation_config import SimulationConfig

DRIVE_EDS = "cia402_drive.eds"
LOAD_CELL_EDS = "cia404_load_cell.eds"

_TICK = 0.005  # s between two looks at time-outs and brakes
_LATE = 0.02  # s by which a tick may be late before silence of the master proves nothing
# Without SYNC the plant follows the clock at this distance, so that it never overtakes a SYNC still unread, whose
# time stamp says for when the devices have to measure.
_PLANT_LAG = 0.03  # s


class RobotEmulator:
    """The devices of `can.yaml`, on its buses as they are: virtual, or SocketCAN for a driver elsewhere.

    Each bus has one interface and one canopen network for all of its devices. They measure at the time stamp of
    each SYNC; in between, a thread looks after heartbeats, time-outs and brakes.

    Parameters
    ----------
    can_config
        Buses and devices.
    simulation
        The true machine; its noise and delays are those of the devices.
    plant
        The machine's model, at its time 0.
    eds_directory
        Directory of the EDS files `cia402_drive.eds` and `cia404_load_cell.eds`.

    Raises
    ------
    ConfigurationError
        If the two configurations differ in their number of motors, or an EDS file is missing.
    BusError
        If a bus cannot be opened.
    """

    def __init__(
        self, can_config: CanConfig, simulation: SimulationConfig, plant: PlantModel, eds_directory: Path
    ) -> None:
        count = simulation.robot.number_of_cables
        for key, devices in (("drives", can_config.drives), ("load_cells", can_config.load_cells)):
            if len(devices) != count:
                raise ConfigurationError(
                    f"{can_config.source}: {key}: lists {len(devices)} devices, the simulated robot has {count} cables"
                )
        for name in (DRIVE_EDS, LOAD_CELL_EDS):
            if not (eds_directory / name).is_file():
                raise ConfigurationError(
                    f"{eds_directory / name}: the object dictionary of the devices is missing"
                )
        self.machine = SharedPlant(plant, simulation.payload_changes)
        self.drives = tuple(
            DriveEmulator(
                config,
                eds_directory / DRIVE_EDS,
                self.machine,
                index,
                simulation.brake,
                simulation.drive,
                can_config.brake_open_bit,
            )
            for index, config in enumerate(can_config.drives)
        )
        self.load_cells = tuple(
            LoadCellEmulator(
                config,
                eds_directory / LOAD_CELL_EDS,
                self.machine,
                index,
                simulation.load_cells,
                simulation.seed,
            )
            for index, config in enumerate(can_config.load_cells)
        )
        self._nodes: tuple[EmulatedNode, ...] = (*self.drives, *self.load_cells)
        self._networks: list[canopen.Network] = []
        self._stopping = threading.Event()
        self._ticker = threading.Thread(target=self._keep_time, name="emulated devices", daemon=True)
        try:
            for bus in can_config.buses:
                network = _open(bus)
                self._networks.append(network)
                devices = (
                    *zip(can_config.drives, self.drives, strict=True),
                    *zip(can_config.load_cells, self.load_cells, strict=True),
                )
                for config, node in devices:
                    if config.bus == bus.name:
                        network.add_node(node)
        except DriverError:
            self.close()
            raise
        for node in self._nodes:
            node.power_on()
        self._ticker.start()

    def __enter__(self) -> RobotEmulator:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Take the devices off their buses; closing twice is allowed."""
        self._stopping.set()
        if self._ticker.is_alive():
            self._ticker.join()
        for network in self._networks:
            network.notifier.stop()
            network.bus.shutdown()
        self._networks = []

    @property
    def failure(self) -> DriverError | None:
        """The error that ended the simulation, `None` while it runs."""
        return self.machine.failure

    @property
    def payload(self) -> Payload:
        """What the platform carries now."""
        with self.machine.lock:
            return self.machine.plant.payload

    def change_payload(self, payload: Payload, at: float | None = None) -> None:
        """Let the platform carry another payload.

        Parameters
        ----------
        payload
            The payload in place of the present one.
        at
            When, s on the system clock; a time in the past, or `None`, means now.
        """
        with self.machine.lock:
            time_of_change = self.machine.now() if at is None else self.machine.from_system_time(at)
            self.machine.change_payload(payload, time_of_change)

    def slack_cables(self) -> tuple[int, ...]:
        """Return the numbers, from 0, of the cables without tension."""
        with self.machine.lock:
            tensions = self.machine.measure().tensions
        return tuple(index for index, tension in enumerate(tensions) if tension <= 0.0)

    def _keep_time(self) -> None:
        due = time.monotonic()
        while not self._stopping.is_set():
            due += _TICK
            delay = due - time.monotonic()
            late = delay < -_LATE
            if delay > 0.0:
                self._stopping.wait(delay)
            elif late:
                due = time.monotonic()
            try:
                self._tick(supervise=not late)
            except DriverError:
                return  # the plant failed, and `failure` says why

    def _tick(self, supervise: bool) -> None:
        with self.machine.lock:
            now = self.machine.now()
            self.machine.advance(now - _PLANT_LAG)
            for node in self._nodes:
                node.tick(now, supervise)


def _open(bus: BusConfig) -> canopen.Network:
    """Open a bus for emulated devices.

    Raises
    ------
    BusError
        If its interface cannot be opened.
    """
    network = canopen.Network()
    network.NOTIFIER_CYCLE = 0.1  # s that closing may take
    options = {} if bus.interface == "virtual" else {"bitrate": bus.bitrate}
    try:
        network.connect(interface=bus.interface, channel=bus.channel, **options)
    except (can.CanError, OSError, ValueError, ImportError) as error:
        raise BusError(f"bus {bus.name}: cannot open {bus.interface} {bus.channel}: {error}") from error
    return network
