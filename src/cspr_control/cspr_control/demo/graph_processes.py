"""The processes of a graph on this computer: recorder, simulated robot, control."""

from __future__ import annotations

import json
import os
from pathlib import Path

from cspr_control.demo.scenario import Scenario
from cspr_control.parameters.control_settings import robot_file
from cspr_msgs_py.parameters.file import ParameterFile

MODULES = {
    "simulated_robot": "cspr_drivers.nodes.simulated_robot",
    "control": "cspr_control.nodes.control",
    "recorder": "cspr_msgs_py.nodes.recorder",
    "robot_markers": "cspr_control.nodes.robot_markers",
}


def graph_processes(
    scenario: Scenario, source: Path, directory: Path, markers: bool = False
) -> dict[str, list[str]]:
    """Copy a configuration for a scenario; return the arguments of each process, by its name in `MODULES`.

    Parameters
    ----------
    scenario
        What is run.
    source
        Directory of the configuration.
    directory
        Of the run: takes config/, bag/ and log/.
    markers
        Whether /robot_markers are published.
    """
    config = directory / "config"
    scenario.copy_configuration(source, config)
    control_cpu, robot_cpu, recorder_cpu = (["-p", f"cpu:={cpu}"] for cpu in _cpus())
    attached = sorted(str(path) for path in config.rglob("*") if path.is_file())
    robot = robot_file(ParameterFile.from_yaml(config / "control.yaml"))
    robot_arguments = ros_arguments(config, can_config="can.yaml", simulation_config="simulation.yaml")
    control_arguments = ros_arguments(config, robot_config=robot)
    output = ros_parameter("output", str(directory / "bag"))
    processes = {
        "recorder": ["--ros-args", *output, *ros_parameter("attach", attached), *recorder_cpu],
        "simulated_robot": robot_arguments + scenario.priority_arguments() + robot_cpu,
        "control": control_arguments + scenario.control_arguments() + control_cpu,
    }
    if markers:
        processes["robot_markers"] = control_arguments + recorder_cpu
    return processes


def ros_arguments(config: Path, **files: str) -> list[str]:
    """ROS arguments by which nodes find, by parameter, the files of a configuration directory that they read."""
    arguments = ["--ros-args", "--params-file", str(config / "control.yaml")]
    for name, file in files.items():
        arguments += ros_parameter(name, str(config / file))
    return arguments


def ros_parameter(name: str, value: str | list[str]) -> list[str]:
    """ROS arguments that give a parameter texts: ROS reads YAML, of which JSON is a part, quotes included."""
    return ["-p", f"{name}:={json.dumps(value)}"]


def _cpus() -> tuple[int, int, int]:
    """CPUs for control, the simulated robot and the recorder: one each as far as there are any."""
    allowed = sorted(os.sched_getaffinity(0))
    return allowed[0], allowed[1 % len(allowed)], allowed[2] if len(allowed) > 2 else allowed[0]
