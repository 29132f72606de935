import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from std_msgs.msg import String

from cspr_msgs_py.bag_reader import Bag
from cspr_msgs_py.conversions import diagnostic_status, from_diagnostic_status
from cspr_msgs_py.errors import BagError, StartError
from cspr_msgs_py.joint_state import JointStateCodec
from cspr_msgs_py.message_definitions import message_class
from cspr_msgs_py.nodes.process import advertise
from cspr_msgs_py.nodes.recorder import Recorder
from cspr_msgs_py.topics import MOTOR_STATES, ROBOT_STATE, motor_command, motor_names

CODEC = JointStateCodec(motor_names(6))


def parameters(**values: object) -> list[Parameter]:
    return [Parameter(name, value=value) for name, value in values.items()]


@pytest.fixture
def start(context: Context, executor) -> Callable[..., Recorder]:
    def start(**values: object) -> Recorder:
        recorder = Recorder(context=context, parameter_overrides=parameters(nice=0, **values))
        executor.add_node(recorder)
        return recorder

    return start


def spin_until(executor, condition: Callable[[], bool], timeout: float = 20.0) -> None:
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, "it took too long"
        executor.spin_once(timeout_sec=0.02)


def test_round_trip(tmp_path: Path, context: Context, executor, start) -> None:
    configuration = tmp_path / "robot.yaml"
    configuration.write_text("name: test\n")
    source = Node("source", context=context)
    executor.add_node(source)
    state = advertise(source, ROBOT_STATE)
    state.publish(diagnostic_status("supervisor", 0, "disabled"))  # before anybody listens

    recorder = start(output=str(tmp_path / "bag"), attach=[str(configuration)])
    states, command = advertise(source, MOTOR_STATES), advertise(source, motor_command(1))
    foreign = source.create_publisher(String, "/operator_note", 10)
    spin_until(
        executor,
        lambda: all(publisher.get_subscription_count() for publisher in (states, command, foreign, state)),
    )
    sent = [CODEC.encode(index, np.full(6, index), np.zeros(6), np.zeros(6)) for index in range(1, 31)]
    torque = JointStateCodec(["motor_1"], position=False, velocity=False)
    foreign.publish(String(data="begins"))
    for data in sent:
        states.publish(data)
        command.publish(torque.encode(7, effort=[1.5]))
        executor.spin_once(timeout_sec=0.005)

    def everything() -> bool:
        counts = recorder._writer.counts
        wanted = {"/motor_states": 30, "/motor_1/command": 30, "/operator_note": 1, "/robot_state": 1}
        return all(counts.get(topic, 0) >= number for topic, number in wanted.items())

    spin_until(executor, everything)
    spin_until(executor, lambda: recorder._writer.counts.get("/diagnostics", 0) >= 1)
    recorder.make_safe()

    with Bag(tmp_path / "bag") as bag:
        assert bag.complete
        assert [data for _, _, data in bag.messages("/motor_states")] == sent
        np.testing.assert_array_equal(bag.joint_states("/motor_1/command").effort, np.full((30, 1), 1.5))
        assert bag.topics["/operator_note"] == "std_msgs/msg/String"
        ((_, _, latched),) = bag.messages("/robot_state")
        message = deserialize_message(latched, message_class(ROBOT_STATE.type))
        assert from_diagnostic_status(message)[2] == "disabled"
        assert bag.attachments == {str(configuration): b"name: test\n"}
        assert {"software", "host", "kernel", "control_rate", "start_time"} <= bag.metadata[
            "recording"
        ].keys()
        offered = bag.metadata["rosbag2"]["serialized_metadata"]
        assert "transient_local" in offered
        assert "RIHS01_" in offered
        log_times = [log_time for log_time, _, _ in bag.messages("/motor_states")]
        assert abs(log_times[-1] - time.time_ns()) < 30e9


def test_an_existing_bag_is_refused(tmp_path: Path, start) -> None:
    with pytest.raises(BagError, match="exists already"):
        start(output=str(tmp_path))


def test_a_missing_attachment_is_refused(tmp_path: Path, start) -> None:
    with pytest.raises(BagError, match=r"cannot attach missing.yaml"):
        start(output=str(tmp_path / "bag"), attach=["missing.yaml"])


def test_an_unknown_compression_is_refused(tmp_path: Path, start) -> None:
    with pytest.raises(StartError, match="compression: 'rar' is none of zstd, lz4, none"):
        start(output=str(tmp_path / "bag"), compression="rar")


def test_a_full_disk_ends_the_recorder(tmp_path: Path, executor, start) -> None:
    recorder = start(output=str(tmp_path / "bag"))
    recorder._writer.error = BagError("writing bag_0.mcap ended early: No space left on device")
    with pytest.raises(BagError, match="No space left on device"):
        spin_until(executor, lambda: False)
    recorder.make_safe()  # has nothing left to do, and says nothing twice
    recorder._writer.error = None
    recorder._writer.close()


def test_the_executable_closes_its_bag_on_sigint(tmp_path: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "cspr_msgs_py.nodes.recorder", "--ros-args", "-p", "attach:=['x.yaml']"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    output, _ = process.communicate(timeout=30)
    assert (process.returncode, output) == (1, "recorder: cannot attach x.yaml: No such file or directory\n")

    process = subprocess.Popen(
        [sys.executable, "-m", "cspr_msgs_py.nodes.recorder"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    for line in process.stdout:
        if "recorder ready" in line:
            break
    time.sleep(0.3)
    process.send_signal(2)
    output, _ = process.communicate(timeout=30)
    assert process.returncode == 0, output
    assert "recorded" in output
    (directory,) = (tmp_path / "runs").glob("*/bag")
    with Bag(directory) as bag:
        assert bag.complete
