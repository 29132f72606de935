"""Replacing a file so that a loss of power leaves the old one or the new one, and nothing in between."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path


def replace_file(path: Path, text: str) -> None:
    """Write a text in place of a file, or as a new one."""
    new = path.with_name(f"{path.name}.new")
    with new.open("w", encoding="utf-8") as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    new.replace(path)


def replace_and_keep(path: Path, text: str) -> Path:
    """Write a text in place of a file; return where the old one is kept."""
    kept = path.with_name(f"{path.name}.{datetime.now(UTC):%Y%m%dT%H%M%S.%fZ}")
    kept.write_bytes(path.read_bytes())
    replace_file(path, text)
    return kept
