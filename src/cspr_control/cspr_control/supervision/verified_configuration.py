"""Which configuration has been verified: kept in a file, so that every change of it asks for another verification."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np

from cspr_kinematics import Robot


class VerifiedConfiguration:
    """Knows the configuration that was verified last.

    A configuration is the robot as it is described, and drives, load cells and home pose as their driver tells them.

    Parameters
    ----------
    path
        Of the file; none is there before the first verification.
    robot
        The robot as the controller believes it to be.
    """

    def __init__(self, path: Path, robot: Robot) -> None:
        self._path = path
        text = json.dumps(asdict(robot), default=np.ndarray.tolist, sort_keys=True)
        self._robot = hashlib.sha256(text.encode()).hexdigest()[:16]

    def problem(self, drives: str) -> str:
        """Return what is not verified of the present configuration, given the driver's part of it; or nothing."""
        try:
            verified = json.loads(self._path.read_text(encoding="utf-8"))
            parts = {"robot.yaml": self._robot, "can.yaml or the home pose": drives}
            changed = [name for name, part in parts.items() if verified.get(name) != part]
        except (OSError, ValueError, AttributeError):
            return f"no verification is on record in {self._path}"
        return f"{' and '.join(changed)} changed since the last verification" if changed else ""

    def confirm(self, drives: str) -> str:
        """Write down that the present configuration is verified; return why not where that fails."""
        parts = {"robot.yaml": self._robot, "can.yaml or the home pose": drives}
        try:
            self._path.write_text(json.dumps(parts, indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            return f"{self._path} cannot be written: {error.strerror}"
        return ""
