"""The two geometries of `make paper`: the shipped one, and one that does all that the paper says of its robot.

The paper shows the coordinates of its exit and anchor points in a figure without numbers.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from ruamel.yaml import YAML

from cspr_kinematics import Robot
from cspr_kinematics.configuration.yaml_file import read_yaml

CONFIG = Path(__file__).parents[1] / "config"
SECOND_GEOMETRY = Path(__file__).with_name("second_geometry.yaml")

# m; the jumps of the printed trajectory slacken cables so far that lengths misfit by 3.2 mm with 200 kg
_SLACK_MISFIT = 5e-3


@dataclass(frozen=True)
class Geometry:
    """A robot by its directory of configuration, and how it is called in tables, and at the end of files' names."""

    name: str
    config: Path
    suffix: str = ""

    @cached_property
    def robot(self) -> Robot:
        """The robot."""
        return Robot.from_yaml(self.config / "robot.yaml")


SHIPPED = Geometry("shipped", CONFIG)


def second_geometry(directory: Path) -> Geometry:
    """Write the shipped configuration with the second geometry into a directory, and return it.

    Raises
    ------
    ConfigurationFileError
        If one of the files is not what it should be.
    """
    directory.mkdir(parents=True, exist_ok=True)
    for file in CONFIG.glob("*.yaml"):
        shutil.copyfile(file, directory / file.name)
    control = read_yaml(CONFIG / "control.yaml")
    control["supervisor"]["ros__parameters"]["slack_misfit"] = _SLACK_MISFIT
    robot = read_yaml(CONFIG / "robot.yaml") | read_yaml(SECOND_GEOMETRY)
    for name, changed in (("control", control), ("robot", robot)):
        with open(directory / f"{name}.yaml", "w", encoding="utf-8") as written:
            YAML().dump(changed, written)
    return Geometry("second", directory, "_second")
