"""One script of messages gives the same bytes, whoever drives the control graph."""

from __future__ import annotations

from collections import deque
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from std_srvs.srv import Trigger

from cspr_control.closed_loop.loop import SERVICE_TIME, ClosedLoop
from cspr_control.closed_loop.simulated_time import SimulatedTime
from cspr_control.graph import control_graph
from cspr_control.nodes import component_node
from cspr_control.nodes.component_node import Wiring
from cspr_control.nodes.control import create_control_nodes
from cspr_control.nodes.control_nodes import NODES
from cspr_control.nodes.motor_controller import MotorControllerNode
from cspr_control.parameters.control_settings import control_settings
from cspr_control.supervision.supervisor import Decision
from cspr_control.supervision.verified_configuration import VerifiedConfiguration
from cspr_kinematics import Payload, Robot, distribute_tensions, inverse_kinematics, static_wrench
from cspr_msgs_py import topics
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.parameters.file import ParameterFile
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import Status, StatusArray
from cspr_msgs_py.wire.topic_codecs import topic_codec

ROOT = Path(__file__).parents[2]
ROBOT = Robot.from_yaml(ROOT / "config" / "robot.yaml")
COUNT = ROBOT.number_of_cables
CYCLES = 900
OUTPUTS = {
    topic.name: topic_codec(topic, COUNT)
    for topic in (
        topics.REFERENCE,
        topics.SETPOINT,
        topics.PLATFORM_POSE,
        topics.PAYLOAD,
        topics.PAYLOAD_IN_USE,
        topics.EXTERNAL_WRENCH,
        topics.LOAD_CELL_CHECK,
        topics.ROBOT_STATE,
        topics.SUPERVISOR_ALIVE,
        topics.TRAJECTORY_STATE,
        topics.DIAGNOSTICS,
        *(topics.motor_command(k + 1) for k in range(COUNT)),
    )
}


def script(begin_ns):
    """Return what comes from outside: time (s), topic, bytes; and commands: time, name of a service, nothing."""
    rng = np.random.default_rng(5)
    none = np.empty(0)
    A = inverse_kinematics(ROBOT, ROBOT.home).wrench_matrix
    wrench = static_wrench(ROBOT, ROBOT.home, Payload(80.0, np.zeros(3)))
    taut = distribute_tensions(A, wrench, ROBOT.tension_min, ROBOT.tension_max).tensions
    events = []

    def add(time, topic, sample):
        events.append((time, topic, topic_codec(topic, COUNT).encode(sample)))

    def report(time, drives):
        statuses = (Status("can_drives", Level.OK, drives), Status("motor_1", Level.OK, "switched on"))
        add(time, topics.DRIVE_STATES, StatusArray(begin_ns, statuses))

    for cycle in range(CYCLES):
        time = 0.0013 + 0.004 * cycle
        stamp = begin_ns + 4_000_000 * cycle + int(rng.integers(0, 200_000))
        angles, speeds = 0.02 * rng.standard_normal((2, COUNT))
        torques = -ROBOT.winch.transmission_ratio * taut
        if cycle > 820:  # one motor runs away
            angles = angles + 20.0 * np.eye(COUNT)[2]
        add(time, topics.MOTOR_STATES, JointStateSample(stamp, angles, speeds, torques))
        tensions = taut + rng.standard_normal(COUNT)
        tensions = np.full(COUNT, np.nan) if cycle == 100 else tensions
        add(time + 0.0002, topics.CABLE_TENSIONS, JointStateSample(stamp, none, none, tensions))
    for second in range(4):
        report(0.0007 + second, "disabled" if second == 0 else "enabled")
        cells = StatusArray(begin_ns, (Status("load_cells", Level.OK, "ok", {"cause": ""}),))
        add(0.0008 + second, topics.LOAD_CELL_STATES, cells)
    events.append((0.0009, topics.DRIVE_STATES, b"no message"))
    add(0.1, topics.RECORDER_STATE, Status("recorder", Level.OK, "recording"))
    events += [
        (0.2505, "/supervisor/reset", None),
        (0.3005, "/trajectory_publisher/start", None),
        (0.3505, "/supervisor/enable", None),
        (0.6505, "/trajectory_publisher/start", None),
        (2.5005, "/trajectory_publisher/stop", None),
        (3.1005, "/trajectory_publisher/start", None),
    ]
    report(0.4007, "enabling")
    report(0.5007, "enabled")
    return sorted(events, key=lambda event: event[0])


class DrivenNodes:
    """Nodes whose callbacks are called one after the other, without an executor and without a middleware."""

    def __init__(self, monkeypatch, create):
        self.time = SimulatedTime()
        self.published = []
        self._waiting = deque()
        monkeypatch.setattr(component_node, "advertise", lambda node, topic: SimpleNamespace(
            publish=partial(self._publish, topic.name)))  # fmt: skip
        monkeypatch.setattr(component_node.ComponentNode, "create_client", self._create_client)
        monkeypatch.setattr(VerifiedConfiguration, "problem", lambda record, drives: "")
        wiring = partial(Wiring, self.time.monotonic, self.time.system_ns)
        self.nodes = create(wiring)
        now = self.time.monotonic()
        periods = [(timer, timer.timer_period_ns * 1e-9) for node in self.nodes for timer in node.timers]
        self._due = [[now + period, period, timer] for timer, period in periods]
        self._services = {service.srv_name: service for node in self.nodes for service in node.services}
        self._hand_on()
        self.time.at(self._next[0], self._advance)

    @property
    def _next(self):
        return min(self._due, key=lambda due: due[0])

    def _publish(self, topic, data):
        self.published.append((topic, data))
        self._waiting.append((topic, data))

    def _create_client(self, kind, service):
        def call_async(request):
            future = SimpleNamespace()
            future.add_done_callback = lambda callback: self.time.at(
                self.time.monotonic() + SERVICE_TIME, partial(self._answer, service, callback)
            )
            return future

        return SimpleNamespace(srv_name=service, service_is_ready=lambda: True, call_async=call_async)

    def _answer(self, service, callback):
        answer = Trigger.Response(success=True)
        if service in self._services:
            answer = self.order(service)
        callback(SimpleNamespace(result=lambda: answer))
        self._hand_on()

    def _advance(self):
        while (due := self._next)[0] <= self.time.monotonic():
            due[2].callback()
            self._hand_on()
            due[0] += due[1]
        self.time.at(due[0], self._advance)

    def _hand_on(self):
        while self._waiting:
            self._deliver(*self._waiting.popleft())

    def _deliver(self, topic, data):
        for node in self.nodes:
            for subscription in node.subscriptions:
                if subscription.topic_name == topic:
                    subscription.callback(data)

    def order(self, service):
        answer = self._services[service].callback(Trigger.Request(), Trigger.Response())
        self._hand_on()
        return answer

    def receive(self, topic, data):
        self._deliver(topic.name, data)
        self._hand_on()

    def close(self):
        for node in self.nodes:
            node.destroy_node()


class DrivenLoop:
    """The closed loop with nothing at its other end."""

    def __init__(self, parameters):
        self.time = SimulatedTime()
        machine = SimpleNamespace(
            time=self.time,
            plant=SimpleNamespace(payload=Payload.none()),
            begin=lambda: None,
            command=lambda *command: None,
            supervised=lambda stamp_ns: None,
            faults=SimpleNamespace(),
            call=lambda service: Decision(True, ""),
        )
        self._loop = ClosedLoop(ROBOT, control_settings(ROBOT, parameters), machine, latency=0.0005)
        self.published = []
        self._loop.listeners.append(self._listen)
        self._codecs = {name: topic_codec(topic, COUNT) for name, topic in self._loop.graph.inputs.items()}
        self._loop.begin()
        self.order = self._loop.order

    def _listen(self, topic, sample):
        if topic.name in OUTPUTS:
            if topic is topics.DIAGNOSTICS:
                sample = sample._replace(stamp_ns=self.time.system_ns())
            self.published.append((topic.name, OUTPUTS[topic.name].encode(sample)))

    def receive(self, topic, data):
        try:
            sample = self._codecs[topic.name].decode(data)
        except MessageError as error:
            self._loop.graph.refuse(topic, str(error))
            return
        self._loop.publish(topic, sample)

    def close(self):
        pass


def alone(wiring):
    controllers = (MotorControllerNode(k + 1, wiring=wiring()) for k in range(COUNT))
    return [*controllers, *(kind(wiring=wiring()) for kind in NODES.values())]


def together(wiring):
    return [node for node in create_control_nodes(wiring()) if node.get_name() != "motor_control_gains"]


def play(driver):
    begin = driver.time.monotonic()
    for time, topic, data in script(driver.time.system_ns()):
        act = partial(driver.order, topic) if data is None else partial(driver.receive, topic, data)
        driver.time.at(begin + time, act)
    driver.time.wait(begin + 0.004 * CYCLES - driver.time.monotonic())
    driver.close()
    return driver.published


@pytest.fixture
def parameters(tmp_path, monkeypatch):
    """Parameters of control.yaml, for a trajectory that a script can follow; nodes declare them."""
    parameters = ParameterFile.from_yaml(ROOT / "config" / "control.yaml")
    parameters.change("trajectory_publisher", {"trajectory": "hold", "hold_duration": 1.0})
    file = tmp_path / "control.yaml"
    file.write_text(parameters.text(), encoding="utf-8")
    monkeypatch.chdir(ROOT)
    rclpy.init(args=["--ros-args", "--params-file", str(file)])
    yield parameters
    rclpy.try_shutdown()


def test_nodes_alone_nodes_together_and_the_closed_loop_publish_the_same_bytes(parameters, monkeypatch):
    in_loop = play(DrivenLoop(parameters))
    graph = control_graph(ROBOT, control_settings(ROBOT, parameters))
    declared = {topic.name for component in graph.components.values() for topic in component.outputs}
    assert {topic for topic, _ in in_loop} == set(OUTPUTS) == declared  # each declared output is published
    assert seen(in_loop, topics.ROBOT_STATE) == ["disabled", "enabling", "enabled", "fault"]
    phases = ["approach", "running", "stopping", "hold", "approach", "stopping", "hold"]
    assert seen(in_loop, topics.TRAJECTORY_STATE) == ["idle", "hold", *phases]
    for create in (together, alone):
        by_nodes = play(DrivenNodes(monkeypatch, create))
        for theirs, ours in zip(by_nodes, in_loop, strict=True):
            assert theirs == ours


def seen(published, topic):
    """Return the states that were published on a topic."""
    return [OUTPUTS[name].decode(data).message for name, data in published if name == topic.name]
