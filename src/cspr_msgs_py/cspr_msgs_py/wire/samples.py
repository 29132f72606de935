"""What the slower topics carry, as plain records; those of the control cycle stand beside their codecs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspr_msgs_py.vocabulary import Level


class PoseSample(NamedTuple):
    """A pose in the frame ``base``: stamp in ns, position (3,) in m, quaternion (4,)."""

    stamp_ns: int
    position: NDArray[np.float64]
    quaternion_xyzw: NDArray[np.float64]


class InertiaSample(NamedTuple):
    """A point mass: stamp in ns, mass in kg, centre of mass (3,) in the frame ``platform``, m."""

    stamp_ns: int
    mass: float
    center_of_mass: NDArray[np.float64]


class WrenchSample(NamedTuple):
    """A wrench on the platform, about its origin, in ``base``: stamp in ns, force (3,) in N, moment (3,) in N m."""

    stamp_ns: int
    force: NDArray[np.float64]
    moment: NDArray[np.float64]


class SignOfLife(NamedTuple):
    """A header alone: stamp in ns."""

    stamp_ns: int


class Status(NamedTuple):
    """A diagnostic status, as it is on the latched topics and inside ``/diagnostics``."""

    name: str
    level: Level
    message: str
    values: Mapping[str, str] = {}
    hardware_id: str = ""

    @staticmethod
    def of(name: str, level: Level, message: str, values: Mapping[str, Any]) -> Status:
        """Return a status; the values are written with :func:`str`."""
        return Status(name, level, message, {key: str(value) for key, value in values.items()})


class LogLine(NamedTuple):
    """A line of the log: stamp in ns, how grave it is, who says it, and what."""

    stamp_ns: int
    level: Level
    name: str
    text: str


class StatusArray(NamedTuple):
    """Several statuses with one stamp in ns."""

    stamp_ns: int
    statuses: tuple[Status, ...]

    def find(self, name: str) -> Status | None:
        """Return the status of that name, the last if there are several; None if there is none."""
        return next((status for status in reversed(self.statuses) if status.name == name), None)
