"""What a run of the demo changes in its copy of the configuration."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from rclpy.context import Context
from rclpy.node import Node

from cspr_control.demo.graph_processes import ros_parameter
from cspr_control.demo.scenario import DemoError, Scenario
from cspr_control.parameters.experiment import AddedPayload
from cspr_drivers.config.can_config import CanConfig
from cspr_msgs_py.parameters.file import ParameterFile
from cspr_msgs_py.parameters.table import TABLE
from cspr_msgs_py.vocabulary import Controller, TrajectoryName

CONFIG = Path(__file__).parents[3] / "config"
SCENARIO = Scenario(
    Controller.STATIC,
    False,
    TrajectoryName.SMOOTH_18,
    30.0,
    (AddedPayload(10.0, 2.0),),
    realtime=True,
    speed=1.0,
)


def copied(scenario: Scenario, directory: Path) -> dict[str, Any]:
    scenario.copy_configuration(CONFIG, directory)
    return {
        name: yaml.safe_load((directory / f"{name}.yaml").read_text(encoding="utf-8"))
        for name in ("robot", "can", "control", "simulation")
    }


def shipped(name: str) -> Any:
    return yaml.safe_load((CONFIG / f"{name}.yaml").read_text(encoding="utf-8"))


def parameters(files: dict[str, Any], node: str) -> Any:
    return files["control"][node]["ros__parameters"]


def test_what_was_chosen_stands_in_the_copy(tmp_path: Path) -> None:
    files = copied(SCENARIO, tmp_path / "config")
    assert files["simulation"]["payload"]["mass"] == 30.0
    assert parameters(files, "trajectory_publisher")["trajectory"] == "smooth-18"
    assert parameters(files, "feedforward")["model"] == "static"
    assert parameters(files, "feedforward")["payload_source"] == "nominal"
    assert files["robot"] == shipped("robot")
    assert files["can"] == shipped("can")
    usual = shipped("control")["supervisor"]["ros__parameters"]
    ages = {f"max_age.{name}": age for name, age in usual.pop("max_age").items()}
    assert parameters(files, "supervisor") == usual | ages


def test_without_real_time_priority_the_watchdogs_wait_longer(tmp_path: Path) -> None:
    files = copied(replace(SCENARIO, realtime=False), tmp_path / "config")
    assert files["can"]["timeouts"]["command"] > shipped("can")["timeouts"]["command"]
    CanConfig.from_mapping(files["can"], "can.yaml")  # and are allowed to
    relaxed, limits = parameters(files, "supervisor"), shipped("control")["supervisor"]["ros__parameters"]
    assert relaxed["max_age.motor_states"] > limits["max_age"]["motor_states"]
    assert relaxed["following_error_time"] > limits["following_error_time"]


def test_a_slower_machine_gives_every_limit_more_time(tmp_path: Path) -> None:
    files = copied(replace(SCENARIO, speed=0.25), tmp_path / "config")
    assert parameters(files, "/**")["setpoint_timeout"] == 4.0 * 0.1
    slow = parameters(files, "supervisor")
    usual = shipped("control")["supervisor"]["ros__parameters"]
    limits = [row for row in TABLE["supervisor"] if row.name in usual]
    assert len(limits) > 10
    for row in limits:
        assert slow[row.name] == pytest.approx(usual[row.name] * 4.0**row.stretch), row.name
    player = ParameterFile.from_yaml(tmp_path / "config" / "control.yaml").values("trajectory_publisher")
    assert player["max_gap"] == 4.0 * 0.1
    markers = ParameterFile.from_yaml(tmp_path / "config" / "control.yaml").values("robot_markers")
    assert markers["trail"] == 4.0 * 20.0
    assert player["stop_time"] == 0.5  # the machine's own
    assert parameters(files, "simulated_robot")["speed"] == 0.25
    assert {name: slow[f"max_age.{name}"] for name in usual["max_age"]} == {
        name: pytest.approx(4.0 * age) for name, age in usual["max_age"].items()
    }


@pytest.mark.parametrize(
    ("node", "name", "value", "slow"),
    [
        ("/**", "setpoint_timeout", 0.5, "5"),
        ("supervisor", "max_age.drive_states", 10.0, "100"),
        ("feedforward", "switch_slew", 0.005, "0.0005"),
    ],
)
def test_a_value_that_a_slower_machine_makes_too_large_is_refused_in_the_users_words(
    tmp_path: Path, node: str, name: str, value: float, slow: str
) -> None:
    shutil.copytree(CONFIG, tmp_path / "source")
    control = ParameterFile.from_yaml(CONFIG / "control.yaml")
    control.change(node, {name: value})
    (tmp_path / "source" / "control.yaml").write_text(control.text(), encoding="utf-8")
    SCENARIO.copy_configuration(tmp_path / "source", tmp_path / "in real time")
    with pytest.raises(
        DemoError, match=f"{name} is {value:g}, .* 0.1 of real time makes {slow}: .* must lie"
    ):
        replace(SCENARIO, speed=0.1).copy_configuration(tmp_path / "source", tmp_path / "slow")


def test_a_parameter_reaches_ros_whatever_its_text() -> None:
    paths = ['runs, [x]: "y"/ö\\n', "5", "# none", "~"]
    context = Context()
    rclpy.init(
        args=["--ros-args", *ros_parameter("paths", paths), *ros_parameter("path", paths[0])], context=context
    )
    try:
        node = Node("probe", context=context)
        assert node.declare_parameter("paths", [""]).value == paths
        assert node.declare_parameter("path", "").value == paths[0]
        node.destroy_node()
    finally:
        rclpy.try_shutdown(context=context)


def test_the_truth_comes_over_the_topic_of_the_estimate() -> None:
    told = replace(SCENARIO, exact_mass=True).control_arguments()
    # with the node's name: after a file that has a block of the node, one for all nodes counts for nothing
    assert "supervisor:verification_required:=false" in told
    assert told[-2:] == ["-r", "feedforward:/payload:=/simulation/payload"]


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("can", "rate: 1\n"),
        ("control", "- a\n"),
        ("simulation", "payload: [\n"),
        ("control", "a: !!timestamp 2001-99-99\n"),
    ],
)
def test_a_file_that_the_demo_cannot_use_is_named(tmp_path: Path, name: str, text: str) -> None:
    shutil.copytree(CONFIG, tmp_path / "source")
    (tmp_path / "source" / f"{name}.yaml").write_text(text, encoding="utf-8")
    with pytest.raises(DemoError, match=f"{name}.yaml does not suit the demo"):
        replace(SCENARIO, realtime=False).copy_configuration(tmp_path / "source", tmp_path / "config")
