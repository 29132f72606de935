"""What `config/can.yaml` holds: each key with its type and range, and which values must fit each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Literal

from msgspec import Meta

from cspr_drivers.canopen import frame_table
from cspr_drivers.canopen.units import DriveUnits, LoadCellUnits
from cspr_drivers.config.height_cost import ALLOWED_DROP, height_faults
from cspr_drivers.config.identity import Identity
from cspr_drivers.config.option_codes import OptionCodes
from cspr_drivers.config.plausible_torque import torque_doubt
from cspr_drivers.config.timeouts import Timeouts
from cspr_kinematics.configuration.structure import NotNegative, Positive, Text
from cspr_msgs_py.parameters.table import CONTROL_RATE

STANDARD_LAYOUTS = {
    "drive_rpdo": frame_table.DRIVE_RPDO1,
    "drive_tpdo": frame_table.DRIVE_TPDO1,
    "drive_tpdo_2": frame_table.DRIVE_TPDO2,
    "load_cell_tpdo": frame_table.LOAD_CELL_TPDO1,
}
"""Objects of each process data object, in the order in which they stand in CiA 402 and CiA 404."""

NodeId = Annotated[int, Meta(ge=1, le=127)]


class VelocitySource(Enum):
    """Where the motor speed comes from."""

    POSITION_DIFFERENCE = "position_difference"  # of 6064h, over the time between the two SYNCs, filtered
    VELOCITY_ACTUAL = "velocity_actual"  # 606Ch, in a second TPDO


@dataclass(frozen=True)
class EmergencyStopInput:
    """Digital input of the drives that watches the emergency stop chain: bit of 60FDh, and its value when open."""

    bit: Annotated[int, Meta(ge=0, le=31)]
    active: Literal[0, 1]

    def is_active(self, inputs: int) -> bool:
        """Return whether the chain is open at a value of 60FDh."""
        return inputs >> self.bit & 1 == self.active


@dataclass(frozen=True)
class BrakeOutput:
    """Digital output of the drives that closes the brake at the host's command: bit of 60FEh, its value when closed."""

    bit: Annotated[int, Meta(ge=0, le=31)]
    closed: Literal[0, 1]

    @property
    def mask(self) -> int:
        """Value of 60FEh:02, with which the drive heeds the bit."""
        return 1 << self.bit

    def outputs(self, closed: bool) -> int:
        """Return the value of 60FEh:01 for a brake that is to be closed, or to be left to the drive."""
        return self.mask if closed == bool(self.closed) else 0


# A cell that is wrong by more, or for longer, is to be found.
_STUCK_TOO_LONG = "or a load cell that is stuck is not found within a second"
_OFF_TOO_FAR = "or a load cell that is stuck may be wrong by more than 60 N unnoticed"


@dataclass(frozen=True)
class LoadCellChecks:
    """When a load cell counts as stuck; with limits beyond which one would go unnoticed.

    Attributes
    ----------
    stuck_time
        Time for which it shows the very same value, s...
    stuck_span
        ...while the tension of another cable changes by more than this, N.
    """

    stuck_time: Annotated[float, Meta(gt=0.0, le=1.0, description=_STUCK_TOO_LONG)]
    stuck_span: Annotated[float, Meta(gt=0.0, le=60.0, description=_OFF_TOO_FAR)]


@dataclass(frozen=True)
class TorqueCheck:
    """When a drive counts as one that does not apply the commanded torque.

    Attributes
    ----------
    difference
        Largest difference of the two, N m...
    time
        ...and how long it may be exceeded, s.
    """

    difference: Positive
    time: NotNegative


@dataclass(frozen=True)
class WindingLimits:
    """How a single winch is wound, at the operator's command, until its cable is taut.

    Attributes
    ----------
    speed
        Of the motor, rad/s.
    torque
        Largest torque at the motor shaft with which it is wound in, or pushed out, N m.
    tension
        Of its cable, N: up to here it is wound in, and down to here a tighter one is paid out at once.
    """

    speed: Positive = 20.0
    torque: Positive = 0.5
    tension: Positive = 200.0


@dataclass(frozen=True, kw_only=True)
class CanValues:
    """What is used as it stands in the file.

    A key that only some drives need has a default, the value of all others, whose files need not name it.

    Attributes
    ----------
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
    largest_motor_speed
        Speed that no motor reaches, rad/s: a position or a speed (606Ch) that says so is not believed.
    emergency_stop_input
        Digital input of the drives that watches the emergency stop chain; `None` when it is wired to none.
    brake_open_bit
        Bit of the status word that is set while a drive's brake is open (manufacturer specific).
    option_codes
        What the drives do when they stop.
    load_cell_checks
        When a load cell counts as stuck.
    torque_check
        When a drive counts as one that does not apply its torque.
    brake_output
        Output of the drives by which the host closes their brakes; `None` where it cannot.
    largest_brake_slip
        Angle by which a motor with a closed brake may turn, rad.
    winding
        How a single winch is wound.
    timeouts
        Limits in time.
    allowed_drop
        Height that each limit in time may cost, m; see `height_cost`.
    """

    rate: Annotated[float, Meta(ge=CONTROL_RATE.minimum, le=CONTROL_RATE.maximum)]
    bus_load_limit: Annotated[float, Meta(gt=0.0, le=1.0)]
    master_node_id: NodeId
    velocity_source: VelocitySource
    velocity_filter: NotNegative = 0.0
    largest_motor_speed: Positive = 1000.0
    emergency_stop_input: EmergencyStopInput | None
    brake_open_bit: Literal[8, 14, 15]
    option_codes: OptionCodes
    load_cell_checks: LoadCellChecks
    torque_check: TorqueCheck
    brake_output: BrakeOutput | None = None
    largest_brake_slip: Positive = 0.5
    winding: WindingLimits = WindingLimits()
    timeouts: Timeouts
    allowed_drop: Annotated[float, Meta(gt=0.0, le=1.0)] = ALLOWED_DROP

    def brake_is_open(self, status_word: int) -> bool:
        """Return whether a drive reports its brake open."""
        return bool(status_word >> self.brake_open_bit & 1)


@dataclass(frozen=True)
class BusEntry:
    """One CAN bus: python-can's interface and channel, bit rate in bit/s."""

    interface: Text
    channel: Text
    bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000)]


@dataclass(frozen=True, kw_only=True)
class DriveEntry(DriveUnits):
    """The drive of one motor: its units, its bus and CANopen node id there, what its identity object holds."""

    bus: Text
    node_id: NodeId
    identity: Identity | None


@dataclass(frozen=True, kw_only=True)
class LoadCellEntry(LoadCellUnits):
    """The amplifier of one cable's load cell, as `DriveEntry`."""

    bus: Text
    node_id: NodeId
    identity: Identity | None


@dataclass(frozen=True)
class PdoEntry:
    """Names of the objects in each process data object, in the order of the frame."""

    drive_rpdo: list[str]
    drive_tpdo: list[str]
    drive_tpdo_2: list[str]
    load_cell_tpdo: list[str]


@dataclass(frozen=True, kw_only=True)
class CanFile(CanValues):
    """The content of `can.yaml`: an entry for each bus by its name, for each motor, and for each cable."""

    buses: dict[str, BusEntry]
    drives: Annotated[list[DriveEntry], Meta(min_length=1)]
    load_cells: Annotated[list[LoadCellEntry], Meta(min_length=1)]
    pdo: PdoEntry


def faults(file: CanFile) -> Iterator[tuple[str, object, str]]:
    """Yield key, value and problem of each value that does not fit the others; the first is the one to report."""
    if not file.buses:
        yield "buses", None, "must name at least one bus"
    yield from _bus_faults(file)
    rated = [drive.rated_torque for drive in file.drives]
    for place, drive in enumerate(file.drives):
        if doubt := torque_doubt(drive.rated_torque, drive.torque_limit, rated[:place]):
            yield f"drives[{place}].rated_torque", drive.rated_torque, doubt
    for place, cell in enumerate(file.load_cells):
        if cell.scale == 0.0:
            yield f"load_cells[{place}].scale", cell.scale, "must not be zero"
    if len(file.load_cells) != len(file.drives):
        problem = f"{len(file.load_cells)} entries for {len(file.drives)} drives: "
        yield "load_cells", None, problem + "each cable has one motor and one load cell"
    yield from _node_faults(file)
    yield from _pdo_faults(file)
    if file.timeouts.heartbeat_consumer <= file.timeouts.heartbeat_producer:
        value = file.timeouts.heartbeat_consumer
        yield "timeouts.heartbeat_consumer", value, "must be greater than heartbeat_producer"
    check, limits = file.torque_check, [drive.torque_limit for drive in file.drives]
    yield from height_faults(file.timeouts, check.time, check.difference, limits, file.allowed_drop)


def _bus_faults(file: CanFile) -> Iterator[tuple[str, object, str]]:
    taken: dict[tuple[str, str], str] = {}
    for name, bus in file.buses.items():
        other = taken.setdefault((bus.interface, bus.channel), name)
        if other != name:
            yield f"buses.{name}.channel", bus.channel, f"is already the channel of bus {other}"


def _node_faults(file: CanFile) -> Iterator[tuple[str, object, str]]:
    taken = {(bus, file.master_node_id): "the driver" for bus in file.buses}
    groups: tuple[tuple[str, str, Sequence[DriveEntry | LoadCellEntry]], ...] = (
        ("drives", "motor", file.drives),
        ("load_cells", "cable", file.load_cells),
    )
    for key, kind, entries in groups:
        for place, entry in enumerate(entries):
            if entry.bus not in file.buses:
                yield f"{key}[{place}].bus", entry.bus, f"must be one of {', '.join(file.buses)}"
            other = taken.setdefault((entry.bus, entry.node_id), f"{kind}_{place + 1}")
            if other != f"{kind}_{place + 1}":
                problem = f"is already the node id of {other} on bus {entry.bus}"
                yield f"{key}[{place}].node_id", entry.node_id, problem


def _pdo_faults(file: CanFile) -> Iterator[tuple[str, object, str]]:
    source = file.velocity_source
    for key, names in vars(file.pdo).items():
        known = [entry.name for entry in STANDARD_LAYOUTS[key].objects]
        if key == "drive_tpdo_2" and source is not VelocitySource.VELOCITY_ACTUAL:
            if names:
                yield f"pdo.{key}", names, f"must be empty with velocity_source = {source.value}"
        elif sorted(names) != sorted(known):
            yield f"pdo.{key}", names, f"must hold, in any order, {', '.join(known)}"
