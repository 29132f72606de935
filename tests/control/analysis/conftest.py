"""Recordings whose every number is known beforehand: an ideal robot with errors that are put in on purpose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from rcl_interfaces.msg import Log
from rclpy.serialization import serialize_message
from std_msgs.msg import String
from tests.messages import diagnostic_array, diagnostic_status, inertia_stamped, pose_stamped

from cspr_control.analysis.run_analysis import RunAnalysis, analyse_bags
from cspr_kinematics import (
    Acceleration,
    Payload,
    Pose,
    Robot,
    Twist,
    cable_lengths,
    distribute_tensions,
    inverse_kinematics,
    required_wrench,
    rope_wrench,
)
from cspr_msgs_py import topics
from cspr_msgs_py.bag.bag_file import Attachment, BagFile
from cspr_msgs_py.bag.metadata import RecordedTopic
from cspr_msgs_py.message_definitions import message_definition
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.reference import ReferenceCodec, ReferenceSample

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / "config"
START = 1_790_000_000_000_000_000  # ROS time of the trajectory's start, ns
PERIOD = 4_000_000  # ns
POSITION_ERROR = np.radians(np.arange(1.0, 9.0))  # of motor 1 to 8, at all times
VELOCITY_ERROR = np.radians(10.0)
PLATFORM_ERROR = np.array([0.002, 0.0, -0.001])  # m, of the true position at all times
PLATFORM_TURN = np.radians(0.5)  # of the true orientation about z
TENSION_ERROR = np.array([5.0, -5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 20.0])  # N


@dataclass
class Scenario:
    """What is recorded: a platform that swings smoothly, from one second before its trajectory to half after it.

    Attributes
    ----------
    masses
        Payload by the time from which on it hangs there, kg by s.
    omitted
        Topics that are not recorded.
    robot_text
        robot.yaml that is attached; None for no attachment. The recorded motion is always the shipped robot's.
    slowness
        Seconds on the recorder's clock for one of the robot's.
    silent_cells
        How long the load cells say nothing at the start and at the end of the recording, s.
    tracker
        Frame in which an instrument measures the platform 50 times a second, 5 mm aside; None for no instrument.
    finished
        False to leave the bag as a power failure would.
    """

    duration: float = 4.0
    masses: dict[float, float] = field(default_factory=lambda: {-10.0: 50.0, 2.0: 100.0})
    omitted: tuple[str, ...] = ()
    robot_text: str | None = (CONFIG / "robot.yaml").read_text(encoding="utf-8")
    control_text: str = (CONFIG / "control.yaml").read_text(encoding="utf-8")
    model: str = "dynamic"
    slowness: float = 1.0
    silent_cells: float = 0.0
    tracker: str | None = None
    finished: bool = True
    fault: bool = False

    def mass(self, time: float) -> float:
        return [mass for since, mass in sorted(self.masses.items()) if since <= time][-1]

    def estimate(self, time: float) -> float:
        """Lag of first order, 0.25 s, behind the true mass, and 0.5 kg too much."""
        value, previous = self.mass(-10.0), None
        for since, mass in sorted(self.masses.items()):
            if previous is not None and time >= since:
                value = mass + (value - mass) * np.exp(-(time - since) / 0.25)
            previous = mass
        return float(value) + 0.5


class Motion:
    """The motion in closed form: there and back along x and z, twice along y, at rest at both ends; s, m."""

    def __init__(self, robot: Robot, duration: float) -> None:
        self.center, self.duration = robot.trajectory_center, duration

    def at(self, time: np.ndarray) -> tuple[Pose, Twist, Acceleration]:
        t = np.clip(time, 0.0, self.duration)
        rate = 2.0 * np.pi / self.duration
        size, rates = np.array([0.3, 0.05, 0.15]), rate * np.array([1.0, 2.0, 1.0])
        phase, zero = t[:, None] * rates, np.zeros((len(t), 3))
        moving = ((time >= 0.0) & (time <= self.duration))[:, None]
        return (
            Pose(self.center + size * (1.0 - np.cos(phase)) / 2.0, np.eye(3)),
            Twist(np.where(moving, size * rates * np.sin(phase) / 2.0, 0.0), zero),
            Acceleration(np.where(moving, size * rates**2 * np.cos(phase) / 2.0, 0.0), zero),
        )


def write_bag(directory: Path, scenario: Scenario) -> Path:
    """Record a scenario."""
    robot = Robot.from_yaml(CONFIG / "robot.yaml")
    attachments = [Attachment("somewhere/control.yaml", scenario.control_text.encode())]
    if scenario.robot_text is not None:
        attachments.append(Attachment("somewhere/robot.yaml", scenario.robot_text.encode()))
    bag = BagFile(directory, {"host": "here", "control_rate": "250.0"}, attachments)
    known = {topic.name: topic.type for topic in topics.graph_topics(8)}
    known["/rosout"] = "rcl_interfaces/msg/Log"
    if scenario.tracker is not None:
        known["/tracker/pose"] = topics.POSE_STAMPED
    channels = {
        name: bag.add_topic(RecordedTopic(name, kind, message_definition(kind)))
        for name, kind in known.items()
        if name not in scenario.omitted
    }

    def put(topic: str, stamp: int, data: bytes) -> None:
        if topic in channels:
            log = START + round((stamp - START) * scenario.slowness) + 300_000
            bag.add_message(channels[topic], log, log, data)

    def say(topic: topics.Topic, time: float, text: str, **values: object) -> None:
        status = diagnostic_status("node", Level.OK, text, values)
        put(topic.name, START + round(time * 1e9), serialize_message(status))

    end = START + round(scenario.duration * 1e9)
    say(topics.ROBOT_STATE, -0.99, "enabled")
    times = {"trajectory": "swing", "start_time": START, "end_time": end}
    say(topics.TRAJECTORY_STATE, -0.98, "hold", trajectory="", start_time=0, end_time=0)
    say(topics.TRAJECTORY_STATE, -0.5, "approach", **times)
    say(topics.TRAJECTORY_STATE, 0.001, "running", **times)

    stamps = START + PERIOD * np.arange(-250, round(scenario.duration * 250) + 125)
    seconds = (stamps - START) * 1e-9
    pose, twist, acceleration = Motion(robot, scenario.duration).at(seconds)
    cables = inverse_kinematics(robot, pose)
    angles = robot.motor_angles(cable_lengths(robot, pose))
    rates = (cables.jacobian @ twist.vector[..., None])[..., 0]
    speeds = robot.winch.motor_speed(rates)
    masses = np.array([scenario.mass(t) for t in seconds])
    tensions, ropes = np.empty_like(angles), rope_wrench(robot, cables)
    for mass in np.unique(masses):  # the slow way, not the one that the analysis goes
        part = masses == mass
        wrench = required_wrench(
            robot,
            Pose(pose.position[part], pose.rotation[part]),
            Twist(twist.linear[part], twist.angular[part]),
            Acceleration(acceleration.linear[part], acceleration.angular[part]),
            Payload(mass, [0.0, 0.0, 0.0]),
        )
        tensions[part] = distribute_tensions(
            cables.wrench_matrix[part], wrench + ropes[part], robot.tension_min, robot.tension_max
        ).tensions
    torques = robot.winch.motor_torque(tensions)

    states = JointStateCodec(topics.motor_names(8))
    command = [JointStateCodec((name,), position=False, velocity=False) for name in topics.motor_names(8)]
    cells = JointStateCodec(topics.cable_names(8), position=False, velocity=False)
    reference = ReferenceCodec()
    silent = round(scenario.silent_cells * 250)
    for k, stamp in enumerate(stamps.tolist()):
        put(topics.SETPOINT.name, stamp, states.encode(stamp, angles[k], speeds[k], torques[k]))
        data = states.encode(stamp, angles[k] - POSITION_ERROR, speeds[k] - VELOCITY_ERROR, torques[k])
        put(topics.MOTOR_STATES.name, stamp, data)
        for motor in range(8):
            saturated = motor == 2 and k % 10 == 0  # motor 3, every tenth command
            torque = -robot.motor.torque_limit if saturated else torques[k, motor]
            data = command[motor].encode(stamp, effort=[torque])
            if not (motor == 4 and k == 400):  # motor 5 leaves one state unanswered
                put(topics.motor_command(motor + 1).name, stamp, data)
        if silent <= k < len(stamps) - silent:
            data = cells.encode(stamp, effort=tensions[k] + TENSION_ERROR)
            put(topics.CABLE_TENSIONS.name, stamp, data)
        sample = ReferenceSample(
            stamp, float(seconds[k]), pose.position[k], np.array([0.0, 0.0, 0.0, 1.0]), twist.linear[k],
            twist.angular[k], acceleration.linear[k], acceleration.angular[k],
        )  # fmt: skip
        put(topics.REFERENCE.name, stamp, reference.encode(sample))
        turned = [0.0, 0.0, np.sin(PLATFORM_TURN / 2.0), np.cos(PLATFORM_TURN / 2.0)]
        true = pose_stamped(stamp, pose.position[k] + PLATFORM_ERROR, turned)
        put(topics.TRUE_POSE.name, stamp, serialize_message(true))
        if k % 5 == 0:
            put_pose = pose_stamped(stamp, pose.position[k], [0.0, 0.0, 0.0, 1.0])
            put(topics.PLATFORM_POSE.name, stamp, serialize_message(put_pose))
            aside = pose.position[k] + [0.005, 0.0, 0.0]
            frame = scenario.tracker or ""
            seen = serialize_message(pose_stamped(stamp, aside, [0.0, 0.0, 0.0, 1.0], frame))
            put("/tracker/pose", stamp, seen)
            for topic, mass in (
                (topics.PAYLOAD, scenario.estimate(seconds[k])),
                (topics.SIMULATED_PAYLOAD, masses[k]),
            ):
                put(topic.name, stamp, serialize_message(inertia_stamped(stamp, mass, [0.0, 0.0, 0.0])))
        if k % 250 == 0:
            counters = {
                "cycles": k, "missed_cycles": k // 125, "skipped_sync": 0, "command_latency_p50_us": 400,
                "command_latency_p99_us": 900, "command_latency_max_us": 2100,
            }  # fmt: skip
            drives = diagnostic_status("can_drives", Level.OK, "enabled", counters)
            values = {"model": scenario.model, "payload_source": "estimated"}
            feedforward = diagnostic_status("feedforward", Level.OK, "answering", values)
            both = serialize_message(diagnostic_array(stamp, [drives, feedforward]))
            put(topics.DIAGNOSTICS.name, stamp, both)
    lift = serialize_message(String(data="second </script> lift"))
    put(topics.EVENTS.name, START + 1_500_000_000, lift)
    slack = serialize_message(Log(level=30, name="simulated_robot", msg="cable_5 is slack"))
    put("/rosout", START + 1_000_000_000, slack)
    if scenario.fault:
        say(topics.ROBOT_STATE, 2.5, "fault", cause="cable 5 is slack")
        say(topics.TRAJECTORY_STATE, 2.52, "stopping", **times)
    else:
        say(topics.TRAJECTORY_STATE, scenario.duration + 0.001, "finished", **times)
    bag.sync()
    if scenario.finished:
        bag.close()
    else:
        bag.abandon()
    return directory


@pytest.fixture(scope="session")
def recorded_bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The plain scenario, recorded once; not to be changed."""
    return write_bag(tmp_path_factory.mktemp("run") / "bag", Scenario())


@pytest.fixture(scope="session")
def run(recorded_bag: Path) -> RunAnalysis:
    """The plain scenario, analysed once."""
    (analysis,) = analyse_bags([recorded_bag], configuration_directory=CONFIG)
    return analysis


@pytest.fixture
def record(tmp_path: Path) -> Callable[..., Path]:
    """Record a scenario that differs from the plain one."""

    def make(name: str = "bag", **changes: object) -> Path:
        return write_bag(tmp_path / name, Scenario(**{"duration": 1.0, **changes}))  # type: ignore[arg-type]

    return make
