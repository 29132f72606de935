import ast
from pathlib import Path

import pytest
from rclpy.qos import DurabilityPolicy, HistoryPolicy, ReliabilityPolicy

from cspr_msgs_py import topics
from cspr_msgs_py.message_definitions import message_class
from cspr_msgs_py.qos import qos_profile
from cspr_msgs_py.topics import (
    CABLE_TENSIONS,
    DIAGNOSTICS,
    DRIVE_STATES,
    MOTOR_STATES,
    RECORDER_STATE,
    REFERENCE,
    ROBOT_STATE,
    SETPOINT,
    TRAJECTORY_STATE,
    graph_topics,
    motor_command,
)


def test_the_graph_has_one_command_topic_a_motor() -> None:
    six, twelve = graph_topics(6), graph_topics(12)
    assert len(twelve) - len(six) == 6
    assert motor_command(12) in twelve
    assert motor_command(12).name == "/motor_12/command"
    assert motor_command(12).writer == "motor_controller_12"


def test_names_are_unique_and_absolute() -> None:
    names = [topic.name for topic in graph_topics(8)]
    assert len(set(names)) == len(names)
    assert all(name.startswith("/") for name in names)


def test_each_topic_of_the_module_is_a_topic_of_the_graph() -> None:
    written = {node.targets[0].id for node in ast.parse(Path(topics.__file__).read_text()).body
               if isinstance(node, ast.Assign) and isinstance(node.value, ast.Call)
               and node.value.func.id in ("_stream", "_latched", "_reliable")}  # fmt: skip
    assert len(written) > 10
    assert [getattr(topics, name) for name in written if getattr(topics, name) not in graph_topics(0)] == []
    assert len(graph_topics(0)) == len(written)


def test_motors_are_counted_from_one() -> None:
    with pytest.raises(ValueError, match="counted from 1"):
        motor_command(0)


@pytest.mark.parametrize("topic", graph_topics(6), ids=lambda topic: topic.name)
def test_every_type_is_installed(topic) -> None:
    assert message_class(topic.type).__name__ == topic.type.split("/")[-1]
    assert topic.content


@pytest.mark.parametrize("topic", [REFERENCE, SETPOINT, MOTOR_STATES, CABLE_TENSIONS, motor_command(1)])
def test_samples_of_the_control_loop_are_never_repeated(topic) -> None:
    profile = qos_profile(topic)
    assert profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert profile.durability == DurabilityPolicy.VOLATILE
    assert profile.history == HistoryPolicy.KEEP_LAST
    assert profile.depth == 1


@pytest.mark.parametrize("topic", [ROBOT_STATE, TRAJECTORY_STATE, DRIVE_STATES, RECORDER_STATE])
def test_states_are_latched(topic) -> None:
    assert topic.latched
    profile = qos_profile(topic)
    assert profile.reliability == ReliabilityPolicy.RELIABLE
    assert profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert profile.depth == 1


def test_diagnostics_are_reliable_and_not_latched() -> None:
    profile = qos_profile(DIAGNOSTICS)
    assert profile.reliability == ReliabilityPolicy.RELIABLE
    assert profile.durability == DurabilityPolicy.VOLATILE
    assert profile.depth == 10
