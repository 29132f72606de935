"""All drives and load cells of a robot, with the simulated machine that they share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import canopen

from cspr_drivers.clock import COMPUTER, Clock
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.errors import ConfigurationError
from cspr_drivers.simulation.devices.drive import DriveEmulator
from cspr_drivers.simulation.devices.load_cell import LoadCellEmulator
from cspr_drivers.simulation.devices.node import EmulatedNode
from cspr_drivers.simulation.plant.shared import SharedPlant
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_msgs_py.wire.samples import PoseSample

if TYPE_CHECKING:
    from cspr_drivers.simulation.plant.plant import Plant

DRIVE_EDS = "cia402_drive.eds"
LOAD_CELL_EDS = "cia404_load_cell.eds"


class EmulatedDevices:
    """The devices of `can.yaml`, on no bus yet; the owner of the clock calls `measure` and `tick` with plant times, s.

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
    clock
        Clock of the machine.

    Attributes
    ----------
    machine
        The plant with its lock and time.
    drives, load_cells
        The devices, in the order of the cables.
    conversion_time
        From SYNC to the answer of an amplifier, s.

    Raises
    ------
    ConfigurationError
        If the two configurations differ in their number of motors, or an EDS file is missing.
    """

    def __init__(
        self,
        can_config: CanConfig,
        simulation: SimulationConfig,
        plant: Plant,
        eds_directory: Path,
        clock: Clock = COMPUTER,
    ) -> None:
        _require_devices(can_config, simulation.robot.number_of_cables, eds_directory)
        self.machine = machine = SharedPlant(plant, simulation.payload_changes, clock)
        self.drives = tuple(
            DriveEmulator(
                can_config, index, eds_directory / DRIVE_EDS, machine, simulation.brake, simulation.drive
            )
            for index in range(len(can_config.drives))
        )
        eds = eds_directory / LOAD_CELL_EDS
        self.load_cells = tuple(
            LoadCellEmulator(config, eds, machine, index, simulation.load_cells, simulation.seed)
            for index, config in enumerate(can_config.load_cells)
        )
        self.conversion_time = simulation.load_cells.conversion_time
        self._half_period_ns = round(0.5e9 * can_config.period)
        self._stamp_ns = 0  # of the cycle whose SYNC a driver of this process has announced last; 0 for none
        self._posed_ns = 0  # stamp of the true pose that was returned last
        self._nodes: tuple[EmulatedNode, ...] = (*self.drives, *self.load_cells)
        self._buses = [drive.bus for drive in can_config.drives] + [
            cell.bus for cell in can_config.load_cells
        ]

    def join(self, bus: str, network: canopen.Network) -> None:
        """Put the devices of a bus on its network."""
        for name, node in zip(self._buses, self._nodes, strict=True):
            if name == bus:
                network.add_node(node)

    def power_on(self) -> None:
        """Boot all devices."""
        for node in self._nodes:
            node.power_on()

    def measure(self, network: canopen.Network, time: float) -> tuple[LoadCellEmulator, ...]:
        """Let the devices of a network measure at a SYNC; drives answer it, the amplifiers returned do so later.

        Drives come first on a real bus too, by their identifiers.
        """
        self.machine.advance(time, exactly=True)
        for drive in self.drives:
            if drive.network is network:
                drive.sync()
        cells = tuple(cell for cell in self.load_cells if cell.network is network)
        for cell in cells:
            cell.latch()
        return cells

    def announce_sync(self, now: float, stamp_ns: int) -> None:
        """Note the stamp of the motor states of the SYNC that comes next; a handler of `CanPorts.on_sync`."""
        self._stamp_ns = stamp_ns

    def true_pose(self, system_ns: int) -> PoseSample | None:
        """Return the pose of the platform as measured at a SYNC; None if another bus had this cycle's SYNC before.

        Parameters
        ----------
        system_ns
            When the SYNC was on the bus, ns of ROS time: the stamp where no driver of this process has announced it.
        """
        stamp = self._stamp_ns or system_ns
        if stamp - self._posed_ns < self._half_period_ns:
            return None
        self._posed_ns = stamp
        plant = self.machine.plant
        return PoseSample(stamp, plant.platform_position(), plant.platform_quaternion())

    def tick(self, time: float, supervise: bool = True) -> None:
        """Let all devices do what is due; see `EmulatedNode.tick`."""
        for node in self._nodes:
            node.tick(time, supervise)


def _require_devices(can_config: CanConfig, count: int, eds_directory: Path) -> None:
    for key, devices in (("drives", can_config.drives), ("load_cells", can_config.load_cells)):
        if len(devices) != count:
            raise ConfigurationError(
                f"{can_config.source}: {key}: lists {len(devices)} devices, but the simulated robot has "
                f"{count} cables"
            )
    for name in (DRIVE_EDS, LOAD_CELL_EDS):
        if not (eds_directory / name).is_file():
            raise ConfigurationError(
                f"{eds_directory / name}: missing; it describes the devices of {can_config.source}, beside it"
            )
