"""What has been found out about a robot so far, kept in a file so that commissioning can be resumed."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec

from cspr_drivers.commission.found_devices import FoundDevice
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.config.file_replacement import replace_file
from cspr_drivers.errors import ConfigurationError

_FORM = 1  # of the file; another one is not read


@dataclass
class WinchFindings:
    """What is known about one winch; `None` and `False` for what is not known yet.

    Attributes
    ----------
    device
        Its drive.
    encoder_increments
        Increments per revolution of the motor shaft.
    rated_torque
        N m.
    polarity
        +1 when the encoder counts up as cable is paid out, else -1.
    scale_checked, brake_holds
        Whether these tests were passed.
    home_counts
        Position value at the home pose.
    """

    device: FoundDevice
    encoder_increments: int
    rated_torque: float
    polarity: int
    scale_checked: bool = False
    brake_holds: bool = False
    home_counts: int | None = None


@dataclass
class CellFindings:
    """What is known about one load cell.

    Attributes
    ----------
    device
        Its amplifier.
    tared
        Whether its zero was taken with a slack cable.
    scale, offset
        Of its calibration; `None` before it.
    rms_residual
        Of the calibration, N.
    home_tension
        Of its cable at the home pose, N.
    """

    device: FoundDevice
    tared: bool = False
    scale: float | None = None
    offset: float | None = None
    rms_residual: float | None = None
    home_tension: float | None = None


@dataclass
class Findings:
    """All winches and load cells, by the number of their cable, from 1."""

    winches: dict[int, WinchFindings] = field(default_factory=dict)
    cells: dict[int, CellFindings] = field(default_factory=dict)

    def forget_missing(self, present: Iterable[FoundDevice]) -> list[FoundDevice]:
        """Forget devices that are no longer on the bus; return them."""
        found = set(present)
        gone: list[FoundDevice] = []
        kinds: tuple[dict[int, Any], ...] = (self.winches, self.cells)
        for kind in kinds:
            for place in [place for place, finding in kind.items() if finding.device not in found]:
                gone.append(kind.pop(place).device)
        return gone


def commissioned(config: CanConfig, present: Iterable[FoundDevice]) -> Findings:
    """Return what a configuration says about those of its devices that are on the bus, unchanged."""
    found = {(device.bus, device.node_id): device for device in present}
    findings = Findings()
    for place, drive in enumerate(config.drives, start=1):
        device = found.get((drive.bus, drive.node_id))
        if device is not None and device.identity == drive.identity:
            units = drive.units
            findings.winches[place] = WinchFindings(
                device,
                units.encoder_increments,
                units.rated_torque,
                units.polarity,
                scale_checked=True,
                brake_holds=True,
                home_counts=units.home_counts,
            )
    for place, cell in enumerate(config.load_cells, start=1):
        device = found.get((cell.bus, cell.node_id))
        if device is not None and device.identity == cell.identity:
            findings.cells[place] = CellFindings(device, True, cell.units.scale, cell.units.offset)
    return findings


@dataclass(frozen=True)
class FindingsFile:
    """The file in which findings are kept until `can.yaml` is written.

    Parameters
    ----------
    path
        The file.
    """

    path: Path

    def load(self) -> Findings:
        """Return what is kept; nothing when there is no file.

        Raises
        ------
        ConfigurationError
            If the file is there and cannot be used.
        """
        try:
            content = json.loads(self.path.read_text(encoding="utf-8"))
            if not isinstance(content, dict) or content.get("form") != _FORM:
                raise self._unusable("it has another format")
            return msgspec.convert(content, Findings, str_keys=True)
        except FileNotFoundError:
            return Findings()
        except (OSError, ValueError, msgspec.ValidationError) as error:
            raise self._unusable(str(error)) from None

    def save(self, findings: Findings) -> None:
        """Keep the findings; the file is whole at any moment."""
        content = {"form": _FORM, **dataclasses.asdict(findings)}
        replace_file(self.path, json.dumps(content, indent=1) + "\n")

    def remove(self) -> None:
        """Forget everything."""
        self.path.unlink(missing_ok=True)

    def _unusable(self, problem: str) -> ConfigurationError:
        return ConfigurationError(f"{self.path}: cannot be resumed: {problem}; start over with --restart")
