"""The CAN side of the robot as `config/can.yaml` describes it: buses, devices, frames, times."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec

from cspr_drivers.canopen.frame_table import PdoLayout
from cspr_drivers.canopen.units import DriveUnits, LoadCellUnits
from cspr_drivers.config.can_file import (
    STANDARD_LAYOUTS,
    CanFile,
    CanValues,
    DriveEntry,
    LoadCellEntry,
    faults,
)
from cspr_drivers.config.file_errors import as_configuration_error
from cspr_drivers.config.identity import Identity
from cspr_kinematics.configuration.structure import structured
from cspr_kinematics.configuration.yaml_file import parse_yaml, read_yaml
from cspr_kinematics.errors import ConfigurationFileError

Units = TypeVar("Units", DriveUnits, LoadCellUnits)


@dataclass(frozen=True)
class BusConfig:
    """One CAN bus: its name here, python-can's interface and channel, bit rate in bit/s."""

    name: str
    interface: str
    channel: str
    bitrate: int


@dataclass(frozen=True)
class DeviceConfig(Generic[Units]):
    """The drive of one motor, or the amplifier of one cable's load cell.

    Attributes
    ----------
    name
        ``motor_1`` or ``cable_1`` for the first in the list.
    bus, node_id
        Name of its bus, and its CANopen node id there.
    units
        Scale and sign of its counts and torques, or scale and zero of its tensions.
    identity
        What its identity object must hold; `None` before the robot is commissioned.
    """

    name: str
    bus: str
    node_id: int
    units: Units
    identity: Identity | None = None

    def __str__(self) -> str:
        return f"{self.name} (node {self.node_id} on {self.bus})"


DriveConfig = DeviceConfig[DriveUnits]
LoadCellConfig = DeviceConfig[LoadCellUnits]


@dataclass(frozen=True)
class PdoConfig:
    """Layouts of the process data objects that are sent in each cycle; values in the order of `STANDARD_LAYOUTS`.

    `drive_tpdo_2` is `None` unless the drives send their velocity.
    """

    drive_rpdo: PdoLayout
    drive_tpdo: PdoLayout
    drive_tpdo_2: PdoLayout | None
    load_cell_tpdo: PdoLayout


@dataclass(frozen=True, kw_only=True)
class CanConfig(CanValues):
    """All of `can.yaml`, validated; the values that it shares with the file are those of its base class.

    Attributes
    ----------
    source
        File it was read from.
    buses, drives, load_cells
        In the order of the file; drives and load cells in the order of the robot's cables.
    pdo
        Frame layouts.
    """

    source: str
    buses: tuple[BusConfig, ...]
    drives: tuple[DriveConfig, ...]
    load_cells: tuple[LoadCellConfig, ...]
    pdo: PdoConfig

    @staticmethod
    def from_yaml(path: str | Path, remedy: str = "") -> CanConfig:
        """Read and validate a configuration file; `remedy` says how the user names another one.

        Raises
        ------
        ConfigurationError
            If the file cannot be read, or a key is missing, unknown, or has a value that is not allowed.
        """
        with as_configuration_error():
            return _config(read_yaml(path, remedy), str(path))

    @staticmethod
    def from_text(text: str, source: str) -> CanConfig:
        """Validate the text of a file as `from_yaml` does; `source` names it in messages."""
        with as_configuration_error():
            return _config(parse_yaml(text, source), source)

    @staticmethod
    def from_mapping(mapping: object, source: str) -> CanConfig:
        """Validate the content of a file as `from_yaml` does; `source` names it in messages."""
        with as_configuration_error():
            return _config(mapping, source)

    @property
    def period(self) -> float:
        """Duration of a cycle, s."""
        return 1.0 / self.rate

    @cached_property
    def fingerprint(self) -> str:
        """Short text that is another one for other drives, load cells or home poses."""
        return hashlib.sha256(repr((self.drives, self.load_cells)).encode()).hexdigest()[:16]


def _config(mapping: object, source: str) -> CanConfig:
    file = structured(CanFile, mapping, source)
    for key, value, problem in faults(file):
        raise ConfigurationFileError(source, key, value, problem)
    return CanConfig(
        **{field.name: getattr(file, field.name) for field in dataclasses.fields(CanValues)},
        source=source,
        buses=tuple(BusConfig(name, **vars(bus)) for name, bus in file.buses.items()),
        drives=_devices("motor", file.drives, DriveUnits),
        load_cells=_devices("cable", file.load_cells, LoadCellUnits),
        pdo=PdoConfig(**{key: _layout(key, names) for key, names in vars(file.pdo).items()}),
    )


def _devices(
    kind: str, entries: Sequence[DriveEntry | LoadCellEntry], units: type[Units]
) -> tuple[DeviceConfig[Units], ...]:
    """Return the devices of a list; their units are what the base class of the entries declares."""
    return tuple(
        DeviceConfig(
            f"{kind}_{k}", e.bus, e.node_id, msgspec.convert(e, units, from_attributes=True), e.identity
        )
        for k, e in enumerate(entries, start=1)
    )


def _layout(key: str, names: list[str]) -> Any:
    """Return the objects of a frame in the order that the configuration gives them; `None` where it gives none."""
    standard = STANDARD_LAYOUTS[key].objects
    known = {entry.name: entry for entry in standard}
    return PdoLayout(tuple(known[name] for name in names), values=standard) if names else None
