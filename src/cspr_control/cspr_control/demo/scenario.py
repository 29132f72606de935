"""What a run of the demo does, and the copy of the configuration that it runs with."""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from cspr_control.errors import ControlError
from cspr_control.reference.catalogue import TrajectoryName
from cspr_msgs_py import topics
from cspr_msgs_py.vocabulary import Controller, PayloadSource, controller_label

TRAJECTORIES = [
    name.value for name in TrajectoryName if name not in (TrajectoryName.HOLD, TrajectoryName.MOVE)
]

# A machine without real-time priority, shared with who knows what, may stand still for longer than a robot may be
# left alone. Without a robot, and without --realtime, the demo therefore waits longer than the configuration says.
_RELAXED_WATCHDOGS = {
    "command": 0.5,
    "feedback": 0.5,
    "rpdo": 1.0,
    "heartbeat_consumer": 2.0,
}  # s, in can.yaml
_RELAXED_AGES = {"motor_states": 1.0, "setpoint": 1.0, "cable_tensions": 1.0, "platform_pose": 1.0}  # s
_RELAXED_TIMES = {"following_error_time": 0.2}  # s, of the supervisor

# Parameters that count on the computer's clock, and so have to be told of a slower machine.
_DURATIONS = {
    "/**": ("setpoint_timeout",),
    "feedforward": ("payload_timeout",),
    "mass_estimator": ("time_constant", "tensions_timeout", "pose_timeout"),
    "supervisor": (
        "following_error_time",
        "tension_min_time",
        "tension_max_time",
        "motor_speed_time",
        "tension_difference_time",
        "stuck_time",
        "enable_timeout",
        "stop_timeout",
        "drive_timeout",
    ),
}
_RATES = {"feedforward": ("switch_slew",), "mass_estimator": ("mass_rate_limit",)}


class DemoError(ControlError):
    """The demo cannot go on; the message says at which step and why."""


@dataclass(frozen=True)
class AddedPayload:
    """A payload change: mass in kg, time in s after the start of the trajectory."""

    mass: float
    time: float


@dataclass(frozen=True)
class Scenario:
    """What one run of the demo does.

    Attributes
    ----------
    controller, exact_mass
        What is compared, and whether the feed-forward is told the true mass.
    trajectory
        One of `TRAJECTORIES`.
    payload, added
        Mass aboard from the start, kg, and what comes on top of it.
    realtime
        Whether control and drivers run under SCHED_FIFO, with the watchdogs that the configuration has.
    speed
        Seconds of the simulated machine in a second of the computer.
    """

    controller: Controller
    exact_mass: bool
    trajectory: str
    payload: float
    added: AddedPayload | None
    realtime: bool
    speed: float

    @property
    def title(self) -> str:
        """The controller in words."""
        return controller_label(self.controller, self.exact_mass)

    def copy_configuration(self, source: Path, target: Path) -> None:
        """Copy a configuration directory and change what this run has otherwise.

        Raises
        ------
        DemoError
            If a file lacks what has to be changed.
        """
        shutil.copytree(source, target, ignore=shutil.ignore_patterns("views"))
        with _edited(target / "simulation.yaml") as simulation:
            simulation["payload"]["mass"] = self.payload
            simulation["payload_changes"] = []
        with _edited(target / "can.yaml") as can:
            if not self.realtime:
                _relax(can["timeouts"], _RELAXED_WATCHDOGS)
        with _edited(target / "control.yaml") as control:
            control["trajectory_publisher"]["ros__parameters"]["trajectory"] = self.trajectory
            feedforward = control["feedforward"]["ros__parameters"]
            feedforward["model"] = str(self.controller.model)
            # the truth comes over the same path as the estimate would
            payload = PayloadSource.ESTIMATED if self.exact_mass else self.controller.payload_source
            feedforward["payload_source"] = str(payload)
            supervisor = control["supervisor"]["ros__parameters"]
            if not self.realtime:
                _relax(supervisor["max_age"], _RELAXED_AGES)
                _relax(supervisor, _RELAXED_TIMES)
            if self.speed != 1.0:
                self._slow_down(control)

    def _slow_down(self, control: dict[str, Any]) -> None:
        for node, names in _DURATIONS.items():
            for name in names:
                control[node]["ros__parameters"][name] /= self.speed
        for node, names in _RATES.items():
            for name in names:
                control[node]["ros__parameters"][name] *= self.speed
        ages = control["supervisor"]["ros__parameters"]["max_age"]
        for name in ages:
            ages[name] /= self.speed

    def control_arguments(self) -> list[str]:
        """ROS arguments of the control nodes."""
        arguments = self._priority()
        if self.exact_mass:
            arguments += ["-r", f"feedforward:{topics.PAYLOAD.name}:={topics.SIMULATED_PAYLOAD.name}"]
        return arguments

    def robot_arguments(self) -> list[str]:
        """ROS arguments of the simulated robot."""
        return ["-p", f"simulated_robot:speed:={self.speed}", *self._priority()]

    def _priority(self) -> list[str]:
        return ["-p", "realtime_priority:=50"] if self.realtime else []


def ros_arguments(config: Path) -> list[str]:
    """ROS arguments by which a node finds the files of a configuration directory."""
    arguments = ["--ros-args", "--params-file", str(config / "control.yaml")]
    for name in ("robot", "can", "simulation"):
        arguments += ros_parameter(f"{name}_config", f"{config / name}.yaml")
    return arguments


def ros_parameter(name: str, value: str | list[str]) -> list[str]:
    """ROS arguments that give a parameter texts: ROS reads YAML, of which JSON is a part, quotes included."""
    return ["-p", f"{name}:={json.dumps(value)}"]


def _relax(limits: dict[str, float], least: dict[str, float]) -> None:
    for name, limit in least.items():
        limits[name] = max(limit, limits[name])


@contextlib.contextmanager
def _edited(file: Path) -> Iterator[dict[str, Any]]:
    """Change the content of a YAML file."""
    try:
        values = yaml.safe_load(file.read_text(encoding="utf-8"))
        yield values
    except (OSError, yaml.YAMLError, ValueError, RecursionError, TypeError, KeyError) as error:
        raise DemoError(f"{file} is not as the demo needs it: {type(error).__name__} {error}") from error
    file.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
