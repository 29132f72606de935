"""Poses from the CSV file of a total station or of another instrument."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cspr_control.errors import ControlError

Floats = NDArray[np.float64]

_PLACE = ("time", "x", "y", "z")
_ORIENTATION = ("qx", "qy", "qz", "qw")
_UNIT = 1e-2  # by which the norm of a quaternion may differ from 1: files have few digits


def read_pose_file(path: Path) -> tuple[Floats, Floats, Rotation | None]:
    """Read a file of poses.

    Its first line names the columns, in any order: ``time`` in s, increasing; ``x``, ``y``, ``z`` in m; and ``qx``,
    ``qy``, ``qz``, ``qw`` if it has the orientation. Empty lines and lines that begin with ``#`` are left out.

    Returns
    -------
    time, position, rotation
        (n,), s; (n, 3), m; (n), None without orientation.

    Raises
    ------
    ControlError
        If the file cannot be read, lacks a column or has an unknown one, or a value is not what it should be: names
        the line and the column.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not text in UTF-8"
        raise ControlError(f"{path} cannot be read: {reason}") from error
    used = [(k, line) for k, line in enumerate(lines, 1) if line.strip() and not line.startswith("#")]
    if len(used) < 2:
        raise ControlError(f"{path} has {'no pose' if used else 'no line that names its columns'}")
    names = [name.strip() for name in used[0][1].split(",")]
    columns = (*_PLACE, *_ORIENTATION) if set(names) & set(_ORIENTATION) else _PLACE
    if sorted(names) != sorted(columns):
        raise ControlError(
            f"{path}, line {used[0][0]}: the columns are {', '.join(names)}; they must be {', '.join(_PLACE)}, or "
            f"these and {', '.join(_ORIENTATION)}: time in s, positions in m"
        )
    rows = []
    for (number, _), cells in zip(used[1:], csv.reader(line for _, line in used[1:]), strict=True):
        if len(cells) != len(names):
            raise ControlError(f"{path}, line {number} has {len(cells)} values for {len(names)} columns")
        rows.append([_number(path, number, name, cell) for name, cell in zip(names, cells, strict=True)])
    table = np.array(rows)[:, [names.index(name) for name in columns]]
    numbers = [number for number, _ in used[1:]]
    for place in np.flatnonzero(np.diff(table[:, 0]) <= 0.0)[:1]:
        raise ControlError(
            f"{path}, line {numbers[place + 1]}, column time: {table[place + 1, 0]:.9g} s is not later than "
            f"{table[place, 0]:.9g} s in line {numbers[place]}"
        )
    if columns is _PLACE:
        return table[:, 0], table[:, 1:4], None
    norms = np.linalg.norm(table[:, 4:], axis=1)
    for place in np.flatnonzero(np.abs(norms - 1.0) > _UNIT)[:1]:
        raise ControlError(
            f"{path}, line {numbers[place]}, columns {', '.join(_ORIENTATION)}: the norm is {norms[place]:.4g}, that "
            "of a rotation is 1"
        )
    return table[:, 0], table[:, 1:4], Rotation.from_quat(table[:, 4:])


def _number(path: Path, line: int, column: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ControlError(f"{path}, line {line}, column {column}: {text.strip()!r} is not a finite number")
    return value
