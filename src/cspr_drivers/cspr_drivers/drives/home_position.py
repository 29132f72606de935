"""Making the present pose the home pose: its position values become `home_counts` in the configuration."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from pathlib import Path

from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.config.file_replacement import replace_and_keep
from cspr_drivers.errors import ConfigurationError

_ENTRY = re.compile(r"^(?P<before>[^#\n]*?\bhome_counts:\s*)(?P<value>[-+]?\d+)", re.MULTILINE)


def with_home(config: CanConfig, counts: Sequence[int]) -> CanConfig:
    """Return the configuration with other position values (m,) at the home pose."""
    drives = tuple(
        dataclasses.replace(drive, units=dataclasses.replace(drive.units, home_counts=value))
        for drive, value in zip(config.drives, counts, strict=True)
    )
    return dataclasses.replace(config, drives=drives)


def store_home(config: CanConfig, counts: Sequence[int]) -> Path:
    """Write position values (m,) at the home pose into the file of a configuration; return where the old one is kept.

    Only these numbers change: comments and layout stay as they are.

    Raises
    ------
    ConfigurationError
        If the file cannot be read, written, or does not hold one ``home_counts`` per drive. It is left unchanged.
    """
    path = Path(config.source)
    try:
        return replace_and_keep(path, _replaced(path.read_text(encoding="utf-8"), config, counts))
    except OSError as error:
        raise ConfigurationError(f"{path}: home_counts cannot be stored: {error.strerror}") from None


def _replaced(text: str, config: CanConfig, counts: Sequence[int]) -> str:
    values = iter(counts)
    try:
        new = _ENTRY.sub(lambda found: f"{found['before']}{next(values)}", text)
        stored = [(e.node_id, e.units.home_counts) for e in CanConfig.from_text(new, config.source).drives]
    except (StopIteration, RuntimeError, ConfigurationError):
        stored = []
    if stored != [(drive.node_id, value) for drive, value in zip(config.drives, counts, strict=True)]:
        raise ConfigurationError(
            f"{config.source}: home_counts: has changed since it was read, or does not hold one "
            "number per drive: write " + ", ".join(map(str, counts)) + " there by hand"
        )
    return new
