import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from rclpy.serialization import deserialize_message
from rosbags.rosbag2 import Reader
from std_msgs.msg import String
from std_srvs.srv import Trigger
from tests.messages import diagnostic_status, from_diagnostic_status

from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.bag.recovery import recover
from cspr_msgs_py.errors import BagError, BagWarning, StartError
from cspr_msgs_py.message_definitions import message_class
from cspr_msgs_py.nodes.recorder import Recorder
from cspr_msgs_py.qos import qos_profile
from cspr_msgs_py.runtime.process import advertise
from cspr_msgs_py.runtime.recorder_intake import Source
from cspr_msgs_py.topics import EVENTS, MOTOR_STATES, RECORDER_STATE, ROBOT_STATE, motor_command, motor_names
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.joint_state import JointStateCodec

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
    with pytest.raises(StartError, match="compression is 'rar'; it must be one of zstd, lz4, none"):
        start(output=str(tmp_path / "bag"), compression="rar")


def test_several_publishers_leave_a_profile_each(tmp_path: Path, context: Context, executor, start) -> None:
    source = Node("source", context=context)
    executor.add_node(source)
    first = source.create_publisher(String, "/talk", QoSProfile(depth=3, deadline=Duration(seconds=2)))
    second = source.create_publisher(String, "/talk", qos_profile_sensor_data)
    recorder = start(output=str(tmp_path / "bag"))
    spin_until(executor, lambda: first.get_subscription_count() and second.get_subscription_count())
    first.publish(String(data="x"))
    spin_until(executor, lambda: recorder._writer.counts.get("/talk"))
    recorder.make_safe()
    with Bag(tmp_path / "bag") as bag:
        profiles = {profile.reliability: profile for profile in bag.offered_qos("/talk")}
    assert profiles.keys() == {"reliable", "best_effort"}
    assert profiles["reliable"].deadline == 2_000_000_000


class TestServices:
    @pytest.fixture
    def ask(self, context: Context, executor) -> Callable[[str], Trigger.Response]:
        operator = Node("operator", context=context)
        executor.add_node(operator)
        clients = []

        def ask(name: str) -> Trigger.Response:
            client = operator.create_client(Trigger, f"/recorder/{name}")
            clients.append(client)
            spin_until(executor, client.service_is_ready)
            future = client.call_async(Trigger.Request())
            spin_until(executor, future.done)
            return future.result()

        return ask

    def test_nothing_but_events_and_the_last_states_of_a_pause_are_recorded(
        self, tmp_path: Path, context: Context, executor, start, ask
    ) -> None:
        source = Node("source", context=context)
        executor.add_node(source)
        recorder = start(output=str(tmp_path / "bag"))
        states, state, events = (advertise(source, topic) for topic in (MOTOR_STATES, ROBOT_STATE, EVENTS))
        spin_until(executor, lambda: all(each.get_subscription_count() for each in (states, state, events)))

        def counted(name: str, number: int) -> None:
            spin_until(executor, lambda: recorder._writer.counts.get(name, 0) >= number)

        states.publish(CODEC.encode(1, np.zeros(6), np.zeros(6), np.zeros(6)))
        state.publish(diagnostic_status("supervisor", 0, "disabled"))
        counted("/motor_states", 1)
        counted("/robot_state", 1)
        assert ask("pause").message == "the recording is paused"
        assert ask("pause").message == "the recording is already paused"
        states.publish(CODEC.encode(2, np.zeros(6), np.zeros(6), np.zeros(6)))
        for name in ("enabling", "enabled"):
            state.publish(diagnostic_status("supervisor", 0, name))
        events.publish(String(data="gripper closed"))
        counted("/events", 2)
        assert ask("resume").message == "the recording continues"
        assert ask("resume").message == "the recording is not paused"
        states.publish(CODEC.encode(3, np.zeros(6), np.zeros(6), np.zeros(6)))
        assert ask("mark").message == "mark 1 is on /events"
        recorder.set_parameters(parameters(mark_text="load attached"))
        assert ask("mark").message == "mark 2 is on /events"
        assert ask("mark").message == "mark 3 is on /events"
        counted("/motor_states", 2)
        counted("/robot_state", 2)
        counted("/events", 6)
        recorder.make_safe()
        with Bag(tmp_path / "bag") as bag:
            np.testing.assert_array_equal(bag["/motor_states"].time_ns, [1, 3])
            assert [message.message for message in bag["/robot_state"].messages] == ["disabled", "enabled"]
            assert [message.data for message in bag["/events"].messages] == [
                "recording paused",
                "gripper closed",
                "recording resumed",
                "mark 1",
                "mark 2: load attached",
                "mark 3",
            ]
            recorded = [message.message for message in bag["/recorder_state"].messages]
        assert recorded[0] == "recording"
        assert recorded[-1] == "recording"

    def test_split(self, tmp_path: Path, executor, start, ask) -> None:
        recorder = start(output=str(tmp_path / "bag"))
        assert ask("split").success
        spin_until(executor, lambda: recorder._bag.files == 2)
        recorder.make_safe()
        with Bag(tmp_path / "bag") as bag:
            assert len(bag.files) == 2


def test_a_chosen_list(tmp_path: Path, context: Context, executor, start) -> None:
    source = Node("source", context=context)
    executor.add_node(source)
    recorder = start(output=str(tmp_path / "bag"), topics=["/motor_states", "later", "/never"])
    states, command = advertise(source, MOTOR_STATES), advertise(source, motor_command(1))
    later = source.create_publisher(String, "/later", 10)
    spin_until(executor, lambda: states.get_subscription_count() and later.get_subscription_count())
    states.publish(CODEC.encode(1, np.zeros(6), np.zeros(6), np.zeros(6)))
    later.publish(String(data="x"))
    counts = recorder._writer
    spin_until(executor, lambda: counts.counts.get("/motor_states") and counts.counts.get("/later"))
    # nor does it come to be; a recorder of the test before may be remembered for a moment
    spin_until(executor, lambda: command.get_subscription_count() == 0)
    (status,) = recorder._status()
    assert status.values["no message yet"] == "/never"
    recorder.make_safe()
    with Bag(tmp_path / "bag") as bag:
        assert bag.topics.keys() <= {"/motor_states", "/later", "/events"}


@pytest.mark.parametrize(
    ("numbers", "lost"),
    [
        ([5, 6, 7], 0),
        ([5, 6, 9, 10, 12], 3),
        ([5, 6, 1, 2, 4], 1),  # a publisher that was started anew
        ([5, 1, 6, 2, 9, 3], 0),  # two publishers: nothing can be said
        ([0, 0, 0], 0),  # a middleware that does not number
    ],
)
def test_lost_messages_are_counted_by_the_gaps_in_their_numbers(numbers: list[int], lost: int) -> None:
    source = Source("/x", "std_msgs/msg/String", False, None)
    for number in numbers:
        source.count(number)
    assert source.lost == lost


def recorder_process(directory: Path, *arguments: str, limit: int = 0) -> subprocess.Popen[str]:
    """Start the executable in `directory`; it may write files of `limit` bytes."""
    script = "import resource, sys; from cspr_msgs_py.nodes.recorder import main; "
    if limit:
        script += f"resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit})); "
    return subprocess.Popen(
        [sys.executable, "-c", script + "sys.exit(main())", "--ros-args", "-p", "output:=bag", *arguments],
        cwd=directory,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def test_a_full_disk_stops_the_recording_and_is_reported(tmp_path: Path, context: Context, executor) -> None:
    """The process stays, to say so to everyone who asks; its bag is whole."""
    node = Node("source", context=context)
    executor.add_node(node)
    states: list[tuple] = []
    node.create_subscription(
        message_class(RECORDER_STATE.type),
        RECORDER_STATE.name,
        lambda message: states.append(from_diagnostic_status(message)),
        qos_profile(RECORDER_STATE),
    )
    publisher = node.create_publisher(String, "/large", 100)
    process = recorder_process(tmp_path, "-p", "compression:=none", limit=5_000_000)
    try:
        spin_until(executor, publisher.get_subscription_count, timeout=60.0)
        deadline = time.monotonic() + 120.0
        while not states or states[-1][2] != "failed":
            assert time.monotonic() < deadline
            publisher.publish(String(data="x" * 100_000))
            executor.spin_once(timeout_sec=0.02)
        assert process.poll() is None
        _, level, _, values = states[-1]
        assert level == Level.ERROR
        assert values["cause"] == "recording ended early, bag/bag_0.mcap cannot be written: File too large"
    finally:
        process.send_signal(2)
        output, _ = process.communicate(timeout=60)
    assert process.returncode == 1, output
    assert "recorder: recording ended early, bag/bag_0.mcap cannot be written: File too large" in output
    with Bag(tmp_path / "bag") as bag:
        assert bag.complete
        assert bag.counts["/large"] >= 30


def test_what_a_killed_recorder_leaves(tmp_path: Path, context: Context, executor) -> None:
    """All but the last second is there, on a machine that is not busy, and can be made a whole bag."""
    node = Node("source", context=context)
    executor.add_node(node)
    states = advertise(node, MOTOR_STATES)
    process = recorder_process(tmp_path)
    try:
        spin_until(executor, states.get_subscription_count, timeout=60.0)
        (file,) = (tmp_path / "bag").glob("*.mcap")
        sizes = {file.stat().st_size}
        deadline = time.monotonic() + 120.0
        while len(sizes) < 5:  # what comes meanwhile reaches the disk bit by bit
            assert time.monotonic() < deadline
            sizes.add(file.stat().st_size)
            stamp = time.time_ns()
            states.publish(CODEC.encode(stamp, np.zeros(6), np.zeros(6), np.zeros(6)))
            time.sleep(0.005)
    finally:
        process.kill()
        killed = time.time_ns()
        process.communicate()
    with pytest.warns(BagWarning, match="was cut off"), Bag(tmp_path / "bag") as bag:
        recorded = bag["/motor_states"]
    assert (killed - recorded.time_ns[-1]) * 1e-9 < 5.0
    assert (tmp_path / "bag" / "metadata.yaml").exists()
    result = recover(tmp_path / "bag", tmp_path / "whole")
    assert "was cut off" in result.losses[0]
    with Reader(tmp_path / "whole") as reader:
        assert {each.topic: each.msgcount for each in reader.connections}["/motor_states"] == len(recorded)


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
