"""The new `can.yaml`: the old one with only the entries of drives and load cells replaced."""

from __future__ import annotations

import difflib
import re
from pathlib import Path

from cspr_drivers.commission.findings import CellFindings, Findings, WinchFindings
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.config.identity import Identity
from cspr_drivers.errors import ConfigurationError


def new_text(old: str, config: CanConfig, findings: Findings) -> str:
    """Return the text of the new file.

    Parameters
    ----------
    old
        Text of the present file; comments and all keys but ``drives`` and ``load_cells`` stay.
    config
        What it says.
    findings
        A finished walk.

    Raises
    ------
    ConfigurationError
        If the text has no such block to replace, or the new text is no valid configuration.
    """
    drives = [
        _drive(findings.winches[place], drive.units.torque_limit)
        for place, drive in enumerate(config.drives, start=1)
    ]
    cells = [
        _cell(findings.cells[place], cell.units.decimal_digits)
        for place, cell in enumerate(config.load_cells, start=1)
    ]
    text = _with_block(_with_block(old, "drives", drives, config.source), "load_cells", cells, config.source)
    CanConfig.from_text(text, f"{config.source}, as found")
    return text


def difference(old: str, new: str, path: Path) -> str:
    """Return what changes, as `diff -u` shows it; empty when nothing does."""
    lines = difflib.unified_diff(
        old.splitlines(keepends=True), new.splitlines(keepends=True), str(path), f"{path} (new)", n=1
    )
    return "".join(lines)


def _drive(winch: WinchFindings, torque_limit: float) -> str:
    return (
        f"  - {{bus: {winch.device.bus}, node_id: {winch.device.node_id}, polarity: {winch.polarity}, "
        f"encoder_increments: {winch.encoder_increments}, home_counts: {winch.home_counts}, "
        f"rated_torque: {winch.rated_torque!r}, torque_limit: {torque_limit!r},\n"
        f"     {_identity(winch.device.identity)}}}\n"
    )


def _cell(cell: CellFindings, decimal_digits: int) -> str:
    return (
        f"  - {{bus: {cell.device.bus}, node_id: {cell.device.node_id}, decimal_digits: {decimal_digits}, "
        f"scale: {round(cell.scale or 0.0, 6)!r}, offset: {round(cell.offset or 0.0, 3)!r},\n"
        f"     {_identity(cell.device.identity)}}}\n"
    )


def _identity(identity: Identity) -> str:
    return (
        f"identity: {{vendor_id: 0x{identity.vendor_id:X}, product_code: 0x{identity.product_code:X}, "
        f"revision_number: 0x{identity.revision_number:X}, serial_number: {identity.serial_number}}}"
    )


def _with_block(text: str, key: str, entries: list[str], source: str) -> str:
    """Return the text with the indented lines below a top-level key replaced."""
    pattern = re.compile(rf"^({key}:[^\n]*\n)((?:[ \t]+[^\n]*\n|[ \t]*\n(?=[ \t]))+)", re.MULTILINE)
    if not pattern.search(text):
        raise ConfigurationError(f"{source}: {key}: found no list with one entry per line to replace")
    return pattern.sub(lambda found: found[1] + "".join(entries), text, count=1)
