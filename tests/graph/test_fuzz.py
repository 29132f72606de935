"""No message, command or answer ends the control graph: hostile ones, decoded as the nodes do, at any moment.

A round is a sample; `make soak` makes some hundred thousand calls.
"""

from __future__ import annotations

import math
import random
from functools import cache
from pathlib import Path

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import InertiaStamped, PoseStamped, Transform, Twist, WrenchStamped
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from cspr_control.components.component import Call, Publication
from cspr_control.graph import control_graph
from cspr_control.parameters.control_settings import control_settings
from cspr_kinematics import Robot
from cspr_msgs_py import topics
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.parameters.file import ParameterFile
from cspr_msgs_py.vocabulary import DriverState, Level, RobotState, TrajectoryPhase
from cspr_msgs_py.wire.conversion import decoder
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import Status, StatusArray
from cspr_msgs_py.wire.topic_codecs import topic_codec

CONFIG = Path(__file__).parents[2] / "config"
CALLS = 1500  # of one round
NOW_NS = 1_700_000_000_000_000_000

NUMBERS = (0.0, -0.0, 1.0, -1.0, 5.0, 1e3, -1e3, 1e9, 1e150, -1e150, 1e308, -1e308, 5e-324, 0.5, math.pi / 2,
           math.nan, math.inf, -math.inf)  # fmt: skip
SECONDS = (0, -1, 2**31 - 1, -(2**31))
TEXTS = ("", "ä", "x" * 10_000, "ENABLED", "boom")
_DRIVES_AFTER = {
    "/can_drives/enable": DriverState.ENABLED,
    "/can_drives/disable": DriverState.DISABLED,
    "/can_drives/quick_stop": DriverState.DISABLED,
    "/can_drives/fault_reset": DriverState.DISABLED,
}


@cache
def robot() -> Robot:
    return Robot.from_yaml(CONFIG / "robot.yaml")


class Hostile:
    """Draws messages that somebody could send: some calm, most not."""

    def __init__(self, seed: int) -> None:
        self.draw = random.Random(seed)
        self.now_ns = NOW_NS

    def number(self) -> float:
        draw = self.draw
        return (
            draw.choice(NUMBERS)
            if draw.random() < 0.5
            else draw.gauss(0, draw.choice((0.1, 1.0, 100.0, 1e6)))
        )

    def numbers(self, count: int) -> list[float]:
        """Return numbers, of which often all are harmless but one."""
        draw = self.draw
        kind = draw.random()
        if kind < 0.3:
            return [self.number() for _ in range(count)]
        calm = [draw.gauss(0, 1) for _ in range(count)]
        if kind < 0.6 and calm:
            calm[draw.randrange(count)] = self.number()
        return calm

    def stamp(self) -> Time:
        draw = self.draw
        if draw.random() < 0.7:
            seconds, rest = divmod(self.now_ns, 1_000_000_000)
            return Time(sec=seconds, nanosec=rest)
        seconds = draw.choice((*SECONDS, draw.randrange(-(2**31), 2**31)))
        return Time(sec=seconds, nanosec=draw.choice((0, 999_999_999, 2**32 - 1, draw.randrange(2**32))))

    def joints(self, names: tuple[str, ...], fields: tuple[str, ...]) -> JointState:
        draw = self.draw
        message = JointState(name=list(names))
        message.header.stamp = self.stamp()
        if draw.random() < 0.1:
            message.name = draw.choices([*names, "ä\u202e"], k=draw.choice((0, 1, 7, 8, 9, 100)))
        count = len(message.name)
        for field in ("position", "velocity", "effort"):
            if field in fields or draw.random() < 0.05:
                setattr(
                    message, field, self.numbers(count if draw.random() < 0.95 else draw.choice((0, 1, 9)))
                )
        if fields == ("effort",) and draw.random() < 0.5:
            message.effort = [abs(value) + 100.0 for value in message.effort]
        return message

    def quaternion(self) -> list[float]:
        draw = self.draw
        if draw.random() < 0.2:
            return self.numbers(4)
        if draw.random() < 0.3:
            angle, axis = draw.choice((math.pi / 2, math.pi, 0.1, math.pi / 2 + 1e-9)), draw.randrange(3)
            turned = [0.0, 0.0, 0.0, math.cos(angle / 2)]
            turned[axis] = math.sin(angle / 2)
            return turned
        drawn = np.array([draw.gauss(0, 1) for _ in range(4)])
        return (drawn / np.linalg.norm(drawn)).tolist()

    def pose(self) -> PoseStamped:
        message = PoseStamped()
        message.header.stamp = self.stamp()
        place, turn = message.pose.position, message.pose.orientation
        place.x, place.y, place.z = self.numbers(3)
        turn.x, turn.y, turn.z, turn.w = self.quaternion()
        return message

    def inertia(self) -> InertiaStamped:
        message = InertiaStamped()
        message.header.stamp = self.stamp()
        message.inertia.m = self.number()
        center = message.inertia.com
        center.x, center.y, center.z = self.numbers(3)
        return message

    def wrench(self) -> WrenchStamped:
        message = WrenchStamped()
        message.header.stamp = self.stamp()
        for vector in (message.wrench.force, message.wrench.torque):
            vector.x, vector.y, vector.z = self.numbers(3)
        return message

    def reference(self) -> MultiDOFJointTrajectory:
        draw = self.draw

        def few() -> range:
            return range(draw.choice((1, 1, 1, 1, 1, 1, 0, 2)))

        message = MultiDOFJointTrajectory(joint_names=["platform" for _ in few()])
        message.header.stamp, message.header.frame_id = (
            self.stamp(),
            draw.choice(("base", "base", "base", "x")),
        )
        for _ in few():
            point = MultiDOFJointTrajectoryPoint()
            for _ in few():
                transform = Transform()
                place, turn = transform.translation, transform.rotation
                place.x, place.y, place.z = self.numbers(3)
                turn.x, turn.y, turn.z, turn.w = self.quaternion()
                point.transforms.append(transform)
            for twists in (point.velocities, point.accelerations):
                for _ in few():
                    twist = Twist()
                    for vector in (twist.linear, twist.angular):
                        vector.x, vector.y, vector.z = self.numbers(3)
                    twists.append(twist)
            message.points.append(point)
        return message

    def status(self, names: tuple[str, ...], words: tuple[str, ...]) -> DiagnosticStatus:
        draw = self.draw
        values = [
            KeyValue(key=draw.choice(("cause", "cell", "enabled", "ä")), value=draw.choice(TEXTS))
            for _ in range(draw.randrange(3))
        ]
        name = draw.choice((*names, *names, *TEXTS))
        message = draw.choice((*words, *words, *TEXTS))
        return DiagnosticStatus(level=bytes([draw.randrange(256)]), name=name, message=message, values=values)

    def statuses(self, names: tuple[str, ...], words: tuple[str, ...]) -> DiagnosticArray:
        message = DiagnosticArray(status=[self.status(names, words) for _ in range(self.draw.randrange(4))])
        message.header.stamp = self.stamp()
        return message

    def message(self, topic: topics.Topic) -> bytes:
        """Return a message of a topic, sometimes garbled."""
        m, everything = robot().number_of_cables, ("position", "velocity", "effort")
        states = tuple(state.value for state in (*DriverState, *RobotState, *TrajectoryPhase))
        if topic == topics.CABLE_TENSIONS:
            made = self.joints(topics.cable_names(m), ("effort",))
        elif topic.type == topics.JOINT_STATE:
            made = self.joints(topics.motor_names(m), everything)
        elif topic.type == topics.DIAGNOSTIC_STATUS:
            made = self.status(("supervisor",), states)
        elif topic.type == topics.DIAGNOSTIC_ARRAY:
            made = self.statuses(("can_drives", "load_cells", "feedforward"), states)
        else:
            made = {
                topics.POSE_STAMPED: self.pose,
                topics.INERTIA_STAMPED: self.inertia,
                topics.WRENCH_STAMPED: self.wrench,
                topics.HEADER: lambda: Header(stamp=self.stamp()),
                topics.MULTI_DOF_TRAJECTORY: self.reference,
            }[topic.type]()
        return self.garbled(bytes(serialize_message(made)))

    def garbled(self, data: bytes) -> bytes:
        draw, kind = self.draw, self.draw.random()
        if kind < 0.03:
            return data[: draw.randrange(len(data) + 1)]
        if kind < 0.05:
            return data + draw.randbytes(draw.randrange(1, 64))
        if kind < 0.1:
            changed = bytearray(data)
            for _ in range(draw.randrange(1, 6)):
                changed[draw.randrange(len(changed))] = draw.randrange(256)
            return bytes(changed)
        return draw.randbytes(draw.randrange(400)) if kind < 0.11 else data


class Fuzz:
    """The control graph with all that may reach it; what it publishes must be fit to be sent."""

    def __init__(self, seed: int) -> None:
        self.hostile = Hostile(seed)
        parameters = ParameterFile.from_yaml(CONFIG / "control.yaml")
        self.graph = control_graph(robot(), control_settings(robot(), parameters))
        m = robot().number_of_cables
        self.decode = {name: decoder(topic, m) for name, topic in self.graph.inputs.items()}
        self.encode = {
            topic.name: topic_codec(topic, m).encode
            for component in self.graph.components.values()
            for topic in component.outputs
        }
        self.calls: list[Call] = []
        self.accepted: set[str] = set()  # commands that a sound robot took
        self.drives = DriverState.DISABLED
        self.now = 100.0
        self.take(self.graph.begin(self.now))

    def take(self, outputs) -> None:
        for output in outputs:
            if isinstance(output, Publication):
                self.encode[output.topic.name](output.sample)
                if output.topic.name.startswith("/motor_") and output.topic.name.endswith("/command"):
                    assert abs(output.sample.effort) <= robot().motor.torque_limit
            elif isinstance(output, Call):
                self.calls = [*self.calls[-10:], output]
                self.drives = _DRIVES_AFTER.get(output.service, self.drives)

    def pass_time(self, duration: float) -> None:
        self.now += duration
        self.hostile.now_ns = NOW_NS + round((self.now - 100.0) * 1e9)
        self.take(self.graph.advance(self.now))

    def sound_cycles(self) -> None:
        """Let a sound robot at rest be heard for some cycles, and an operator enable it and start a trajectory."""
        m, stamp, graph = robot().number_of_cables, self.hostile.now_ns, self.graph
        none, rest, tensions = np.empty(0), np.zeros(m), robot().home_tensions
        for service in (None, None, "/supervisor/reset", "/supervisor/enable", "/trajectory_publisher/start"):
            self.pass_time(0.004)
            stamp = self.hostile.now_ns
            torques = robot().winch.motor_torque(tensions)
            drives = Status("can_drives", Level.OK, self.drives.value)
            noisy = tensions + [self.hostile.draw.gauss(0, 1) for _ in range(m)]
            for topic, sample in (
                (topics.MOTOR_STATES, JointStateSample(stamp, rest, rest, torques)),
                (topics.CABLE_TENSIONS, JointStateSample(stamp, none, none, noisy)),
                (topics.DRIVE_STATES, StatusArray(stamp, (drives,))),
                (topics.LOAD_CELL_STATES, StatusArray(stamp, (Status("load_cells", Level.OK, "ok"),))),
            ):
                self.take(graph.on(topic, self.now, sample))
            if service is not None:
                decision, outputs = graph.call(self.now, service)
                self.accepted |= {service} if decision.accepted else set()
                self.take(outputs)

    def step(self) -> None:
        draw, graph = self.hostile.draw, self.graph
        if draw.random() < 0.3:
            self.pass_time(draw.choice((0.0, 0.004, 0.004, 0.02, 1.0)))
        kind = draw.random()
        if kind < 0.05:
            decision, outputs = graph.call(self.now, draw.choice(list(graph.services)))
            assert decision.message
            self.take(outputs)
        elif kind < 0.08 and self.calls:
            accepted, text = draw.random() < 0.7, draw.choice(TEXTS)
            self.take(graph.answered(self.now, draw.choice(self.calls), accepted, text))
        else:
            topic = draw.choice(list(graph.inputs.values()))
            try:
                sample = self.decode[topic.name](self.hostile.message(topic))
            except MessageError as error:
                graph.refuse(topic, str(error))
            else:
                self.take(graph.on(topic, self.now, sample))


def test_no_message_command_or_answer_raises(seed) -> None:
    fuzz = Fuzz(seed)
    with np.errstate(all="ignore"):
        for call in range(CALLS):
            if call % 15 == 0:
                fuzz.sound_cycles()
            fuzz.step()
    assert fuzz.accepted == {"/supervisor/reset", "/supervisor/enable", "/trajectory_publisher/start"}
