import os
import pty
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from tests.messages import diagnostic_status, from_diagnostic_status, nanoseconds

from cspr_msgs_py.bag.bag_file import BagFile
from cspr_msgs_py.bag.metadata import OfferedQos, RecordedTopic
from cspr_msgs_py.message_definitions import message_definition
from cspr_msgs_py.nodes.replay import node_names
from cspr_msgs_py.runtime.process import advertise, subscribe
from cspr_msgs_py.topics import MOTOR_STATES, ROBOT_STATE, motor_command, motor_names
from cspr_msgs_py.wire.joint_state import JointStateCodec

START = 1_700_000_000_000_000_000
PERIOD = 10_000_000  # ns
NUMBER = 100

CODEC = JointStateCodec(motor_names(6))
COMMAND = JointStateCodec(["motor_1"], position=False, velocity=False)


def state(index: int) -> bytes:
    return CODEC.encode(START + index, np.full(6, index), np.zeros(6), np.zeros(6))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """One second of states and commands; the robot's state changes in the middle."""
    bag = BagFile(tmp_path / "bag", {})
    hot = (OfferedQos(reliability="best_effort", durability="volatile"),)
    latched = (OfferedQos(reliability="reliable", durability="transient_local"),)
    states, commands, robot = (
        bag.add_topic(RecordedTopic(topic.name, topic.type, message_definition(topic.type), qos))
        for topic, qos in ((MOTOR_STATES, hot), (motor_command(1), hot), (ROBOT_STATE, latched))
    )
    for index in range(NUMBER):
        time_ns = START + index * PERIOD
        if index in (0, NUMBER // 2):
            text = "enabled" if index else "disabled"
            bag.add_message(robot, time_ns, time_ns, serialize_message(diagnostic_status("s", 0, text)))
        bag.add_message(states, time_ns, time_ns, state(index))
        bag.add_message(commands, time_ns + 1000, time_ns + 1000, COMMAND.encode(index, effort=[index]))
    bag.close()
    return bag.directory


class Listener:
    """What arrives of a replay."""

    def __init__(self, context: Context, executor) -> None:
        self.node = Node("listener", context=context)
        self.executor = executor
        executor.add_node(self.node)
        self.states: list[bytes] = []
        self.arrivals: list[float] = []
        self.clock: list[int] = []
        self.robot: list[str] = []
        best_effort = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.node.create_subscription(JointState, MOTOR_STATES.name, self._on_state, best_effort, raw=True)
        self.node.create_subscription(
            Clock,
            "/clock",
            lambda message: self.clock.append(nanoseconds(message.clock)),
            qos_profile_sensor_data,
        )
        subscribe(
            self.node, ROBOT_STATE, lambda message: self.robot.append(from_diagnostic_status(message)[2])
        )

    def _on_state(self, data: bytes) -> None:
        self.states.append(data)
        self.arrivals.append(time.monotonic())

    def until(self, condition: Callable[[], object], timeout: float = 60.0) -> None:
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, "it took too long"
            self.executor.spin_once(timeout_sec=0.01)


@pytest.fixture
def listener(context: Context, executor) -> Listener:
    return Listener(context, executor)


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "cspr_msgs_py.nodes.replay", *map(str, arguments)]


class Running:
    """A replay that has a terminal, and has begun with a pause."""

    def __init__(self, *arguments: object) -> None:
        self._terminal, self._its_end = pty.openpty()
        self.process = subprocess.Popen(
            command(*arguments, "--paused"),
            stdin=self._its_end,
            stdout=subprocess.DEVNULL,
            stderr=self._its_end,
        )
        self.output = b""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        """Take what the terminal shows: one that nobody reads fills up, and its writer waits."""
        while True:
            try:
                self.output += os.read(self._terminal, 4096)
            except OSError:  # it was closed
                return

    def press(self, key: bytes) -> None:
        os.write(self._terminal, key)

    @property
    def ended(self) -> bool:
        return self.process.poll() is not None

    def close(self) -> None:
        if not self.ended:
            self.process.kill()
        self.process.wait()
        os.close(self._its_end)  # which ends the thread
        self._reader.join()
        os.close(self._terminal)


@pytest.fixture
def replay(bag: Path, listener: Listener) -> Iterator[Callable[..., Running]]:
    """Start a replay that waits for a key and is known to the listener."""
    started: list[Running] = []

    def replay(*arguments: object) -> Running:
        started.append(Running(bag, *arguments))
        listener.until(
            lambda: listener.clock and listener.node.get_publishers_info_by_topic(MOTOR_STATES.name)
        )
        return started[-1]

    yield replay
    for running in started:
        running.close()


def refused(*arguments: object) -> str:
    done = subprocess.run(
        command(*arguments), stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1, done.stdout + done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr


def test_the_same_bytes_in_the_same_order_at_their_time(listener: Listener, replay) -> None:
    running = replay("--rate", 2)
    running.press(b" ")
    listener.until(lambda: running.ended)
    assert running.process.returncode == 0
    listener.until(lambda: len(listener.states) >= NUMBER)
    assert listener.states == [state(index) for index in range(NUMBER)]
    assert listener.robot == ["disabled", "enabled"]
    took = listener.arrivals[-1] - listener.arrivals[0]
    assert took > 0.8 * NUMBER * PERIOD * 1e-9 / 2
    assert listener.clock == sorted(listener.clock)
    assert listener.clock[0] == START
    assert START + (NUMBER - 10) * PERIOD < listener.clock[-1] <= START + NUMBER * PERIOD


def test_from_a_later_start_latched_topics_say_what_they_had_said(listener: Listener, replay) -> None:
    running = replay("--start", 0.3, "--topics", "/motor_states", "/robot_state")
    running.press(b" ")
    listener.until(lambda: len(listener.states) >= NUMBER - 30)
    assert listener.states == [state(index) for index in range(30, NUMBER)]
    listener.until(lambda: listener.robot == ["disabled", "enabled"])


def test_it_loops_until_it_is_stopped(listener: Listener, replay) -> None:
    running = replay("--loop", "--topics", "/motor_states")
    running.press(b" ")
    listener.until(lambda: len(listener.states) > NUMBER + 10)
    running.process.send_signal(2)
    listener.until(lambda: running.ended)
    assert running.process.returncode == 0
    assert listener.states[NUMBER : NUMBER + 10] == listener.states[:10]


def test_pause_and_steps_from_the_keyboard(listener: Listener, replay) -> None:
    running = replay()
    assert set(listener.clock) == {START}  # time stands still, and is published
    assert listener.states == []
    running.press(b"s")  # the robot's state, which comes first
    listener.until(lambda: listener.robot)
    running.press(b"\x1b[C")
    listener.until(lambda: listener.states)
    for cycle in (2, 3):
        running.press(b"c")
        listener.until(lambda cycle=cycle: len(listener.states) >= cycle)
    assert listener.states == [state(index) for index in range(3)]
    assert max(listener.clock) <= START + 2 * PERIOD
    running.press(b" ")
    listener.until(lambda: len(listener.states) > 5)
    running.press(b" ")
    listener.until(lambda: b"paused" in running.output.rpartition(b"1x")[2])
    running.press(b"q")
    listener.until(lambda: running.ended)
    assert running.process.returncode == 0


def test_publishers_offer_what_the_recorded_ones_did(listener: Listener, replay) -> None:
    replay()
    listener.until(lambda: listener.node.get_publishers_info_by_topic(ROBOT_STATE.name))
    (latched,) = listener.node.get_publishers_info_by_topic(ROBOT_STATE.name)
    (hot,) = listener.node.get_publishers_info_by_topic(MOTOR_STATES.name)
    assert latched.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert hot.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT


class TestRefusals:
    def test_a_topic_that_somebody_publishes(self, bag: Path, listener: Listener) -> None:
        advertise(listener.node, MOTOR_STATES)
        assert "/motor_states is published by listener already: leave it out with --topics" in refused(
            bag, "--paused"
        )

    def test_commands_to_drives(self, bag: Path, context: Context) -> None:
        driver = Node("can_drives", context=context)
        subscribe(driver, motor_command(1), lambda message: None)
        assert "/motor_1/command goes to the drives of a running can_drives" in refused(bag, "--paused")
        driver.destroy_node()

    def test_a_topic_that_is_not_there(self, bag: Path) -> None:
        text = refused(bag, "--topics", "/nothing")
        assert "--topics /nothing: the bag has /motor_1/command, /motor_states, /robot_state" in text

    def test_a_start_behind_the_end(self, bag: Path) -> None:
        assert "--start 5: the bag is 0.99 s long" in refused(bag, "--start", 5)

    def test_no_bag(self, tmp_path: Path) -> None:
        assert "there is no bag" in refused(tmp_path / "none")

    def test_an_empty_bag(self, tmp_path: Path) -> None:
        BagFile(tmp_path / "empty", {}).close()
        assert "has no message: there is nothing to replay" in refused(tmp_path / "empty")

    def test_an_unknown_type(self, tmp_path: Path) -> None:
        bag = BagFile(tmp_path / "foreign", {})
        bag.add_message(bag.add_topic(RecordedTopic("/x", "no_such_msgs/msg/X", "")), 1, 1, b"")
        bag.close()
        text = refused(bag.directory)
        assert "/x is left out: message type no_such_msgs/msg/X is not installed" in text
        assert "no topic of" in text


def test_nodes_are_asked_for_until_they_have_names() -> None:
    """A driver whose name comes late must not be taken for somebody who may be given commands."""
    answers = iter([["_NODE_NAME_UNKNOWN_"], ["_NODE_NAME_UNKNOWN_", "rviz"], ["can_drives", "rviz"]])

    def ask(topic: str) -> list[SimpleNamespace]:
        assert topic == "/motor_1/command"
        return [SimpleNamespace(node_name=name) for name in next(answers)]

    assert node_names(ask, "/motor_1/command") == {"can_drives", "rviz"}
