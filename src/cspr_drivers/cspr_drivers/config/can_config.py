"""The CAN side of the robot as `config/can.yaml` describes it: buses, devices, frames, times."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from cspr_drivers.canopen import frame_table
from cspr_drivers.canopen.frame_table import MappedObject, PdoLayout
from cspr_drivers.canopen.units import DriveUnits, LoadCellUnits
from cspr_drivers.config.config_section import ConfigSection, configuration_error
from cspr_drivers.config.identity import Identity, read_identity
from cspr_drivers.config.option_codes import OptionCodes, read_option_codes
from cspr_drivers.config.timeouts import Timeouts, read_timeouts

LARGEST_INT32 = 2**31 - 1


class VelocitySource(Enum):
    """Where the motor speed comes from."""

    POSITION_DIFFERENCE = "position_difference"  # of 6064h, over the time between the two SYNCs, filtered
    VELOCITY_ACTUAL = "velocity_actual"  # 606Ch, in a second TPDO


@dataclass(frozen=True)
class BusConfig:
    """One CAN bus: its name here, python-can's interface and channel, bit rate in bit/s."""

    name: str
    interface: str
    channel: str
    bitrate: int


@dataclass(frozen=True)
class DriveConfig:
    """The drive of one motor.

    Attributes
    ----------
    name
        ``motor_1`` for the first in the list.
    bus, node_id
        Name of its bus, and its CANopen node id there.
    units
        Scale and sign of its counts and torques.
    identity
        What its identity object must hold; `None` before the machine is commissioned.
    """

    name: str
    bus: str
    node_id: int
    units: DriveUnits
    identity: Identity | None = None

    def __str__(self) -> str:
        return f"{self.name} (node {self.node_id} on {self.bus})"


@dataclass(frozen=True)
class LoadCellConfig:
    """The amplifier of one cable's load cell; attributes as for `DriveConfig`, named ``cable_1``.."""

    name: str
    bus: str
    node_id: int
    units: LoadCellUnits
    identity: Identity | None = None

    def __str__(self) -> str:
        return f"{self.name} (node {self.node_id} on {self.bus})"


@dataclass(frozen=True)
class EmergencyStopInput:
    """Digital input of the drives that watches the emergency stop chain: bit of 60FDh, and its value when open."""

    bit: int
    active: int

    def is_active(self, inputs: int) -> bool:
        """Return whether the chain is open at a value of 60FDh."""
        return inputs >> self.bit & 1 == self.active


@dataclass(frozen=True)
class LoadCellChecks:
    """When a load cell counts as stuck.

    Attributes
    ----------
    stuck_time
        Time for which it shows the very same value, s...
    stuck_span
        ...while the tension of another cable changes by more than this, N.
    """

    stuck_time: float
    stuck_span: float


@dataclass(frozen=True)
class TorqueCheck:
    """When a drive counts as one that does not apply the torque it was told.

    Attributes
    ----------
    difference
        Largest difference of the two, N m...
    time
        ...and how long it may be exceeded, s.
    """

    difference: float
    time: float


@dataclass(frozen=True)
class PdoConfig:
    """Layouts of the process data objects that are sent in each cycle.

    `drive_tpdo_2` is `None` unless the drives send their velocity.
    """

    drive_rpdo: PdoLayout
    drive_tpdo: PdoLayout
    drive_tpdo_2: PdoLayout | None
    load_cell_tpdo: PdoLayout


@dataclass(frozen=True)
class CanConfig:
    """All of `can.yaml`, validated.

    Attributes
    ----------
    source
        File it was read from.
    rate
        SYNC frames a second, Hz.
    bus_load_limit
        Largest share of a cycle that process data may take on a bus.
    master_node_id
        Node id of the driver, which its heartbeat carries.
    velocity_source
        Where motor speeds come from.
    velocity_filter
        Time constant of the filter of speeds that are differences of positions, s; 0 for none.
    emergency_stop_input
        Digital input of the drives that watches the emergency stop chain; `None` when it is wired to none.
    brake_open_bit
        Bit of the status word that is set while a drive's brake is open (manufacturer specific: 8, 14 or 15).
    buses, drives, load_cells
        In the order of the file; drives and load cells in the order of the robot's cables.
    pdo
        Frame layouts.
    option_codes
        What the drives do when they stop.
    load_cell_checks
        When a load cell counts as stuck.
    torque_check
        When a drive counts as one that does not apply its torque.
    timeouts
        Limits in time.
    """

    source: str
    rate: float
    bus_load_limit: float
    master_node_id: int
    velocity_source: VelocitySource
    velocity_filter: float
    emergency_stop_input: EmergencyStopInput | None
    brake_open_bit: int
    buses: tuple[BusConfig, ...]
    drives: tuple[DriveConfig, ...]
    load_cells: tuple[LoadCellConfig, ...]
    pdo: PdoConfig
    option_codes: OptionCodes
    load_cell_checks: LoadCellChecks
    torque_check: TorqueCheck
    timeouts: Timeouts

    @staticmethod
    def from_yaml(path: str | Path) -> CanConfig:
        """Read and validate a configuration file.

        Raises
        ------
        ConfigurationError
            If the file cannot be read, or a key is missing, unknown, or has a value that is not allowed.
        """
        return CanConfig.from_section(ConfigSection.from_yaml(path))

    @staticmethod
    def from_mapping(mapping: object, source: str) -> CanConfig:
        """Validate a mapping as `from_yaml` does; `source` names it in messages."""
        return CanConfig.from_section(ConfigSection(source, "", mapping))

    @staticmethod
    def from_section(top: ConfigSection) -> CanConfig:
        """Validate the top-level section of a configuration."""
        buses = _buses(top.section("buses"))
        names = tuple(bus.name for bus in buses)
        velocity_source = VelocitySource(
            top.choice("velocity_source", [source.value for source in VelocitySource])
        )
        config = CanConfig(
            source=top.source,
            rate=top.number("rate", above=0.0),
            bus_load_limit=top.number("bus_load_limit", above=0.0),
            master_node_id=top.integer("master_node_id", 1, 127),
            velocity_source=velocity_source,
            velocity_filter=top.number("velocity_filter", minimum=0.0),
            emergency_stop_input=_emergency_stop_input(top.section_or_none("emergency_stop_input")),
            brake_open_bit=int(top.choice("brake_open_bit", [8, 14, 15])),
            buses=buses,
            drives=tuple(_drive(s, place, names) for place, s in enumerate(top.sections("drives"))),
            load_cells=tuple(
                _load_cell(s, place, names) for place, s in enumerate(top.sections("load_cells"))
            ),
            pdo=_pdo(top.section("pdo"), velocity_source),
            option_codes=read_option_codes(top.section("option_codes")),
            load_cell_checks=_load_cell_checks(top.section("load_cell_checks")),
            torque_check=_torque_check(top.section("torque_check")),
            timeouts=read_timeouts(top.section("timeouts")),
        )
        if config.bus_load_limit > 1.0:
            raise top.error("bus_load_limit", "must be at most 1")
        if len(config.load_cells) != len(config.drives):
            raise configuration_error(
                top.source,
                "load_cells",
                None,
                f"{len(config.load_cells)} entries for {len(config.drives)} drives: "
                "each cable has one motor and one load cell",
            )
        _require_distinct_nodes(config)
        top.finish()
        return config

    @property
    def period(self) -> float:
        """Duration of a cycle, s."""
        return 1.0 / self.rate


def _buses(section: ConfigSection) -> tuple[BusConfig, ...]:
    buses = []
    for name in section.names():
        entry = section.section(name)
        buses.append(
            BusConfig(
                name,
                interface=entry.text("interface"),
                channel=entry.text("channel"),
                bitrate=entry.integer("bitrate", 10_000, 1_000_000),
            )
        )
        entry.finish()
        for other in buses[:-1]:
            if (other.interface, other.channel) == (buses[-1].interface, buses[-1].channel):
                raise entry.error("channel", f"is already the channel of bus {other.name}")
    if not buses:
        raise configuration_error(section.source, section.path, None, "must name at least one bus")
    return tuple(buses)


def _node(section: ConfigSection, buses: tuple[str, ...]) -> tuple[str, int]:
    return str(section.choice("bus", buses)), section.integer("node_id", 1, 127)


def _drive(section: ConfigSection, place: int, buses: tuple[str, ...]) -> DriveConfig:
    bus, node_id = _node(section, buses)
    identity = read_identity(section)
    units = DriveUnits(
        polarity=int(section.choice("polarity", [1, -1])),
        encoder_increments=section.integer("encoder_increments", 1, LARGEST_INT32),
        home_counts=section.integer("home_counts", -LARGEST_INT32, LARGEST_INT32),
        rated_torque=section.number("rated_torque", minimum=0.001),
        torque_limit=section.number("torque_limit", above=0.0),
    )
    # 6071h counts thousandths of the rated torque in 16 bits.
    if not 1 <= units.max_torque <= 32767:
        raise section.error("torque_limit", "must be from 0.001 to 32.767 times rated_torque")
    section.finish()
    return DriveConfig(f"motor_{place + 1}", bus, node_id, units, identity)


def _load_cell(section: ConfigSection, place: int, buses: tuple[str, ...]) -> LoadCellConfig:
    bus, node_id = _node(section, buses)
    identity = read_identity(section)
    units = LoadCellUnits(
        decimal_digits=section.integer("decimal_digits", 0, 6),
        scale=section.number("scale"),
        offset=section.number("offset"),
    )
    if units.scale == 0.0:
        raise section.error("scale", "must not be zero")
    section.finish()
    return LoadCellConfig(f"cable_{place + 1}", bus, node_id, units, identity)


def _emergency_stop_input(section: ConfigSection | None) -> EmergencyStopInput | None:
    if section is None:
        return None
    entry = EmergencyStopInput(
        bit=section.integer("bit", 0, 31), active=int(section.choice("active", [0, 1]))
    )
    section.finish()
    return entry


def _torque_check(section: ConfigSection) -> TorqueCheck:
    check = TorqueCheck(section.number("difference", above=0.0), section.number("time", minimum=0.0))
    section.finish()
    return check


def _load_cell_checks(section: ConfigSection) -> LoadCellChecks:
    checks = LoadCellChecks(
        stuck_time=section.number("stuck_time", above=0.0), stuck_span=section.number("stuck_span", above=0.0)
    )
    section.finish()
    return checks


def _pdo(section: ConfigSection, velocity_source: VelocitySource) -> PdoConfig:
    velocity = velocity_source is VelocitySource.VELOCITY_ACTUAL
    pdo = PdoConfig(
        drive_rpdo=_layout(section, "drive_rpdo", frame_table.DRIVE_RPDO1),
        drive_tpdo=_layout(section, "drive_tpdo", frame_table.DRIVE_TPDO1),
        drive_tpdo_2=_layout(section, "drive_tpdo_2", frame_table.DRIVE_TPDO2) if velocity else None,
        load_cell_tpdo=_layout(section, "load_cell_tpdo", frame_table.LOAD_CELL_TPDO1),
    )
    if not velocity and section.texts("drive_tpdo_2"):
        raise section.error("drive_tpdo_2", f"must be empty with velocity_source = {velocity_source.value}")
    section.finish()
    return pdo


def _layout(section: ConfigSection, name: str, standard: PdoLayout) -> PdoLayout:
    """Return the objects of `standard` in the order that the configuration gives them."""
    known: dict[str, MappedObject] = {entry.name: entry for entry in standard.objects}
    names = section.texts(name)
    if sorted(names) != sorted(known):
        raise section.error(name, "must hold, in any order, " + ", ".join(known))
    return PdoLayout(tuple(known[entry] for entry in names))


def _require_distinct_nodes(config: CanConfig) -> None:
    taken: dict[tuple[str, int], str] = {
        (bus.name, config.master_node_id): "the driver" for bus in config.buses
    }
    groups: tuple[tuple[str, tuple[DriveConfig | LoadCellConfig, ...]], ...] = (
        ("drives", config.drives),
        ("load_cells", config.load_cells),
    )
    for key, devices in groups:
        for place, device in enumerate(devices):
            node = (device.bus, device.node_id)
            if node in taken:
                raise configuration_error(
                    config.source,
                    f"{key}[{place}].node_id",
                    device.node_id,
                    f"is already the node id of {taken[node]} on bus {device.bus}",
                )
            taken[node] = device.name
