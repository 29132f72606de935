"""What a run of the demo does, and the copy of the configuration that it runs with."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cspr_control.errors import ControlError
from cspr_control.parameters.experiment import Experiment
from cspr_kinematics import ConfigurationFileError
from cspr_kinematics.configuration.yaml_file import read_yaml, write_yaml
from cspr_msgs_py import topics
from cspr_msgs_py.errors import ParameterError
from cspr_msgs_py.parameters.file import ParameterFile

# A computer without real-time priority, shared with other programs, may stand still for longer than a robot may be
# left alone. Without a robot, and without --realtime, the demo therefore waits longer than the configuration says.
_RELAXED_WATCHDOGS = {
    "command": 0.5,
    "feedback": 0.5,
    "supervisor": 0.6,
    "rpdo": 1.0,
    "heartbeat_consumer": 2.0,
}  # s, in can.yaml
_RELAXED_DROP = 0.2  # m, allowed_drop in can.yaml: what these would cost if the machine were real
_RELAXED_LIMITS = {
    "allowed_drop": _RELAXED_DROP,
    "max_age.motor_states": 1.0,
    "max_age.reference": 1.0,
    "max_age.setpoint": 1.0,
    "max_age.cable_tensions": 1.0,
    "max_age.platform_pose": 1.0,
    "following_error_time": 0.2,
}  # s, and m, of the supervisor


class DemoError(ControlError):
    """The demo cannot go on; the message says at which step and why."""


@dataclass(frozen=True)
class Scenario(Experiment):
    """What one run of the demo does.

    Attributes
    ----------
    realtime
        Whether control and drivers run under SCHED_FIFO, with the watchdogs that the configuration has.
    speed
        Seconds of the simulated machine in a second of the computer.
    """

    realtime: bool = False
    speed: float = 1.0

    def copy_configuration(self, source: Path, target: Path) -> None:
        """Copy a configuration directory and change what this run has otherwise.

        Raises
        ------
        DemoError
            If a file lacks what has to be changed.
        """
        shutil.copytree(source, target, ignore=shutil.ignore_patterns("views", "security"))
        with _edited(target / "simulation.yaml") as simulation:
            simulation["payload"]["mass"] = self.payload
            simulation["payload_changes"] = []
        with _edited(target / "can.yaml") as can:
            if not self.realtime:
                _relax(can["timeouts"], _RELAXED_WATCHDOGS)
                can["allowed_drop"] = max(_RELAXED_DROP, can.get("allowed_drop", 0.0))
        control_file = target / "control.yaml"
        try:
            control = ParameterFile.from_yaml(control_file)
            if not self.realtime:
                limits = control.values("supervisor")
                _relax(limits, _RELAXED_LIMITS)
                control.change("supervisor", {name: limits[name] for name in _RELAXED_LIMITS})
            if self.speed != 1.0:
                control.slow_down(self.speed)
        except ParameterError as error:
            raise DemoError(f"{control_file} does not suit the demo: {error}") from error
        self.choose(control)
        control_file.write_text(control.text(), encoding="utf-8")

    def control_arguments(self) -> list[str]:
        """ROS arguments of the control nodes."""
        # the simulated machine is as the configuration says
        arguments = [*self.priority_arguments(), "-p", "supervisor:verification_required:=false"]
        if self.exact_mass:
            arguments += ["-r", f"feedforward:{topics.PAYLOAD.name}:={topics.SIMULATED_PAYLOAD.name}"]
        return arguments

    def priority_arguments(self) -> list[str]:
        """ROS arguments of control and the simulated robot."""
        return ["-p", "realtime_priority:=50"] if self.realtime else []


def _relax(limits: dict[str, float], least: dict[str, float]) -> None:
    for name, limit in least.items():
        limits[name] = max(limit, limits[name])


@contextlib.contextmanager
def _edited(file: Path) -> Iterator[dict[str, Any]]:
    """Change the content of a YAML file."""
    try:
        values = read_yaml(file)
        yield values
    except (ConfigurationFileError, TypeError, KeyError) as error:
        raise DemoError(f"{file} does not suit the demo: {type(error).__name__} {error}") from error
    write_yaml(file, values)
