"""Each node alone in a context of its own: messages in, messages out."""

import itertools
import re
import threading
import time
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_msgs.msg import Header
from std_srvs.srv import Trigger
from tests.messages import (
    diagnostic_array,
    diagnostic_status,
    from_diagnostic_array,
    from_diagnostic_status,
    from_inertia_stamped,
    from_pose_stamped,
    inertia_stamped,
    pose_stamped,
)

from cspr_control.components.payload import PayloadComponent
from cspr_control.components.pose import PoseComponent
from cspr_control.components.supervision import SupervisionComponent
from cspr_control.errors import ControlError, SettingError, StabilityError
from cspr_control.motors.feedforward import Feedforward, FeedforwardSettings, Margins
from cspr_control.nodes.control import create_control_nodes, guard_gains, loop_of
from cspr_control.nodes.control_nodes import (
    FeedforwardNode,
    MassEstimatorNode,
    PoseEstimatorNode,
    SupervisorNode,
    TrajectoryPublisher,
)
from cspr_control.nodes.motor_control_gains import MotorControlGains
from cspr_control.nodes.motor_controller import MotorControllerNode
from cspr_control.reference.paper import paper_19
from cspr_control.stability.kept_results import KeptResult, keep_result
from cspr_control.stability.safe_gains import SafeGains
from cspr_control.stability.scan import Margin, Place, StabilityReport
from cspr_control.supervision.checks import MonitoredInput
from cspr_kinematics import Motion, Payload, Pose, holding_tensions, inverse_kinematics
from cspr_msgs_py import topics
from cspr_msgs_py.errors import StartError
from cspr_msgs_py.runtime.process import advertise, subscribe, subscribe_raw
from cspr_msgs_py.vocabulary import DriverState, Level, PayloadSource, RobotState
from cspr_msgs_py.wire.joint_state import JointStateCodec, JointStateSample
from cspr_msgs_py.wire.reference import ReferenceCodec, ReferenceSample

COUNT = 8
MOTORS = JointStateCodec(topics.motor_names(COUNT))
CABLES = JointStateCodec(topics.cable_names(COUNT), position=False, velocity=False)
REFERENCE = ReferenceCodec()
SIGN = Header()  # of life of the supervisor
PATIENT = {"supervision_timeout": 10.0}
STAMP = 1_700_000_000_000_000_000
CYCLE = 4_000_000
PATIENCE = 120.0
ZERO = np.zeros(COUNT)


class Bench:
    """A node under test, and another that plays the rest of the graph."""

    def __init__(self, context, robot_file):
        self._context = context
        self._robot_file = str(robot_file)
        self._executor = EventsExecutor(context=context)
        self.probe = Node("probe", context=context)
        self._executor.add_node(self.probe)
        self._publishers = {}
        self.received = {}
        self.nodes = [self.probe]

    def options(self, **parameters):
        parameters = {"robot_config": self._robot_file, **parameters}
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        return {"context": self._context, "parameter_overrides": overrides}

    def add(self, node):
        self.nodes.append(node)
        self._executor.add_node(node)
        return node

    def listen(self, topic, raw=False):
        messages = self.received.setdefault(topic.name, [])
        (subscribe_raw if raw else subscribe)(self.probe, topic, messages.append)
        return messages

    def publish(self, topic, message):
        publisher = self._publishers.get(topic.name)
        if publisher is None:
            publisher = self._publishers[topic.name] = advertise(self.probe, topic)
            self.until(lambda: publisher.get_subscription_count() > 0)
        publisher.publish(message)

    def spin(self, duration=0.1):
        self._executor.spin_until_future_complete(Future(), timeout_sec=duration)

    def until(self, condition, between=lambda: None):
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, "nothing came of it"
            between()
            self.spin(0.01)

    def call(self, service):
        client = self.probe.create_client(Trigger, service)
        self.until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self.until(future.done)
        return future.result()

    def is_discovered(self, node, service):
        return any(client.srv_name == service and client.service_is_ready() for client in node.clients)

    def remove(self, node):
        self.nodes.remove(node)
        self._executor.remove_node(node)

    def close(self):
        for node in self.nodes:
            self._executor.remove_node(node)
            node.destroy_node()
        self._executor.shutdown()


@pytest.fixture
def bench(robot_file):
    context = Context()
    rclpy.init(args=[], context=context)
    bench = Bench(context, robot_file)
    yield bench
    bench.close()
    rclpy.try_shutdown(context=context)


def set_parameter(node, name, value):
    return node.set_parameters([Parameter(name, value=value)])[0]


def reference_message(point, stamp=STAMP):
    return REFERENCE.encode(
        ReferenceSample(
            stamp,
            0.0,
            point.pose.position,
            point.pose.quaternion,
            point.twist.linear,
            point.twist.angular,
            point.acceleration.linear,
            point.acceleration.angular,
        )
    )


# --- motor controller


def test_motor_controller_answers_states_of_its_motor(bench):
    node = bench.add(MotorControllerNode(3, **bench.options(friction_compensation=0.0, kp=2.0)))
    assert node.get_name() == "motor_controller_3"
    topic = topics.motor_command(3)
    commands = bench.listen(topic, raw=True)
    codec = JointStateCodec(("motor_3",), position=False, velocity=False)
    angles = np.arange(COUNT, dtype=float)

    def cycle():
        bench.publish(topics.SETPOINT, MOTORS.encode(STAMP, angles, ZERO, 0.1 * angles))
        bench.spin(0.02)
        bench.publish(topics.MOTOR_STATES, MOTORS.encode(STAMP + 1, angles - 0.25, ZERO, ZERO))
        bench.spin(0.02)

    bench.until(lambda: commands, cycle)
    command = codec.decode(commands[-1])
    assert command.stamp_ns == STAMP + 1
    assert command.effort[0] == pytest.approx(2.0 * 0.25 + 0.2)
    assert set_parameter(node, "kp", 4.0).successful
    refused = set_parameter(node, "kd", 50.0)
    assert not refused.successful
    assert "must stay below" in refused.reason
    commands.clear()
    bench.until(lambda: commands, cycle)
    assert codec.decode(commands[-1]).effort[0] == pytest.approx(4.0 * 0.25 + 0.2)


def test_motor_controller_sends_nothing_for_a_setpoint_that_is_not_finite(bench):
    bench.add(MotorControllerNode(1, **bench.options()))
    commands = bench.listen(topics.motor_command(1), raw=True)
    diagnostics = bench.listen(topics.DIAGNOSTICS)

    def statuses():
        return [from_diagnostic_array(message)["motor_controller_1"] for message in diagnostics]

    def cycle(value):
        bench.publish(topics.SETPOINT, MOTORS.encode(STAMP, ZERO, ZERO, np.full(COUNT, value)))
        bench.publish(topics.MOTOR_STATES, MOTORS.encode(STAMP, ZERO, ZERO, ZERO))

    bench.until(lambda: commands, lambda: cycle(0.5))
    bench.spin(0.1)
    commands.clear()
    bench.until(
        lambda: any(int(values["refusals_not_finite"]) > 0 for _, _, values in statuses()),
        lambda: cycle(np.nan),
    )
    assert len(commands) <= 1  # a state may overtake the first of the two topics
    assert statuses()[-1][0] is Level.WARN


def test_motor_controller_of_a_motor_that_does_not_exist(bench):
    with pytest.raises(ControlError, match="motor: 9"):
        MotorControllerNode(9, **bench.options())


def test_shared_gains_reach_every_controller(bench):
    node = bench.add(MotorControlGains(**bench.options(friction_compensation=0.0)))
    for controller in node.controllers:
        bench.add(controller)
    assert [c.get_name() for c in node.controllers] == [f"motor_controller_{k}" for k in range(1, COUNT + 1)]
    commands = [bench.listen(topics.motor_command(k), raw=True) for k in (1, COUNT)]
    assert set_parameter(node, "kp", 7.0).successful
    assert not set_parameter(node, "kp", -1.0).successful

    def cycle():
        bench.publish(topics.SETPOINT, MOTORS.encode(STAMP, ZERO, ZERO, ZERO))
        bench.spin(0.02)
        bench.publish(topics.MOTOR_STATES, MOTORS.encode(STAMP, np.full(COUNT, -0.1), ZERO, ZERO))

    bench.until(lambda: all(commands), cycle)
    for k, messages in zip((1, COUNT), commands, strict=True):
        codec = JointStateCodec((f"motor_{k}",), position=False, velocity=False)
        assert codec.decode(messages[-1]).effort[0] == pytest.approx(0.7)


# --- feed-forward


def angles_along(robot, tensions):
    """Return the motor angles at a time of the trajectory at which stretched cables have its lengths."""
    trajectory = paper_19(robot.trajectory_center)
    return lambda time: robot.motor_angles(
        inverse_kinematics(robot, trajectory.sample(time).pose).lengths, tensions
    )


def test_feedforward_answers_a_reference_with_a_setpoint(bench, robot):
    node = bench.add(FeedforwardNode(**bench.options(payload_source="nominal", nominal_payload_mass=50.0)))
    setpoints = bench.listen(topics.SETPOINT, raw=True)
    point = paper_19(robot.trajectory_center).sample(1.0)
    bench.until(lambda: setpoints, lambda: bench.publish(topics.REFERENCE, reference_message(point)))
    setpoint = MOTORS.decode(setpoints[-1])
    settings = FeedforwardSettings(
        payload_source=PayloadSource.NOMINAL, nominal_payload=Payload(50.0, np.zeros(3))
    )
    assert setpoint.stamp_ns == STAMP
    angles = angles_along(robot, robot.home_tensions)  # none were measured, and the motors do not follow yet
    np.testing.assert_allclose(setpoint.position, angles(1.0), atol=1e-9)
    np.testing.assert_allclose(setpoint.velocity, (angles(1.001) - angles(0.999)) / 0.002, atol=1e-3)
    expected = Feedforward(robot, settings).compute(0.0, point)
    np.testing.assert_allclose(setpoint.effort, expected.torque, atol=1e-9)
    measured = np.linspace(200.0, 900.0, COUNT)

    def cycle():
        bench.publish(topics.CABLE_TENSIONS, CABLES.encode(STAMP, effort=measured))
        bench.publish(topics.REFERENCE, reference_message(point))

    there = pytest.approx(angles_along(robot, measured)(1.0), abs=1e-9)
    bench.until(lambda: MOTORS.decode(setpoints[-1]).position == there, cycle)
    assert set_parameter(node, "model", "static").successful
    assert not set_parameter(node, "model", "clairvoyant").successful
    assert "magic" in set_parameter(node, "payload_source", "magic").reason
    assert not set_parameter(node, "robot_config", "other.yaml").successful


def test_feedforward_reports_its_margins_and_changes_the_tension_method(bench, robot):
    node = bench.add(FeedforwardNode(**bench.options(payload_source="nominal", switch_slew=1000.0)))
    diagnostics = bench.listen(topics.DIAGNOSTICS)
    at_rest = Motion.at_rest(robot.home)

    def reported(method):
        bench.until(
            lambda: any(
                from_diagnostic_array(m)["feedforward"][2].get("tension_method") == method
                and "wrench_margin" in from_diagnostic_array(m)["feedforward"][2]
                for m in diagnostics
            ),
            lambda: bench.publish(topics.REFERENCE, reference_message(at_rest)),
        )
        values = from_diagnostic_array(diagnostics[-1])["feedforward"][2]
        diagnostics.clear()
        return float(values["tension_margin"]), float(values["wrench_margin"])

    def expected(method):
        settings = FeedforwardSettings(payload_source=PayloadSource.NOMINAL, tension_method=method)
        margins = Margins.of(Feedforward(robot, settings).compute(0.0, at_rest), robot)
        return pytest.approx((margins.tension, margins.wrench), abs=0.06)

    assert reported("closest") == expected("closest")
    assert set_parameter(node, "tension_method", "centroid").successful
    bench.until(lambda: reported("centroid") == expected("centroid"))  # once the change is over
    refused = set_parameter(node, "tension_method", "minimum_norm")
    assert not refused.successful
    assert "analytic_center" in refused.reason


def test_feedforward_has_no_centroid_for_many_cables(bench):
    twelve = Path(__file__).parents[2] / "kinematics" / "robot" / "twelve_cables.yaml"
    with pytest.raises(ControlError, match="centroid"):
        FeedforwardNode(**bench.options(robot_config=str(twelve), tension_method="centroid"))


def test_feedforward_refuses_a_reference_that_is_not_finite(bench, robot):
    bench.add(FeedforwardNode(**bench.options()))
    setpoints = bench.listen(topics.SETPOINT, raw=True)
    diagnostics = bench.listen(topics.DIAGNOSTICS)
    point = paper_19(robot.trajectory_center).sample(1.0)
    good = REFERENCE.decode(reference_message(point))
    bad = REFERENCE.encode(
        ReferenceSample(
            **{name: getattr(good, name) for name in ReferenceSample._fields if name != "linear_velocity"},
            linear_velocity=np.array([0.0, np.nan, 0.0]),
        )
    )
    bench.until(
        lambda: any(
            int(from_diagnostic_array(m)["feedforward"][2]["refused_references"]) > 0 for m in diagnostics
        ),
        lambda: bench.publish(topics.REFERENCE, bad),
    )
    assert setpoints == []


def test_feedforward_uses_the_estimate_and_says_when_it_is_stale(bench, robot):
    options = bench.options(
        payload_timeout=0.3, switch_slew=1000.0, rope_weight=False
    )  # all torque by the mass
    bench.add(FeedforwardNode(**options))
    setpoints = bench.listen(topics.SETPOINT, raw=True)
    diagnostics = bench.listen(topics.DIAGNOSTICS)
    at_rest = reference_message(paper_19(robot.trajectory_center).sample(2.5))

    def lifted():
        return MOTORS.decode(setpoints[-1]).effort.sum() if setpoints else 0.0

    bench.until(lambda: setpoints, lambda: bench.publish(topics.REFERENCE, at_rest))
    empty = lifted()
    masses = itertools.cycle([153.0, -1.0])

    def cycle():
        mass = next(masses)  # of several at once the newest alone is heard
        bench.publish(topics.PAYLOAD, inertia_stamped(STAMP, mass, np.zeros(3)))
        bench.publish(topics.REFERENCE, at_rest)

    bench.until(lambda: lifted() < 1.99 * empty, cycle)
    bench.until(
        lambda: any("stale" in from_diagnostic_array(m)["feedforward"][1] for m in diagnostics),
        lambda: bench.publish(topics.REFERENCE, at_rest),
    )
    assert lifted() == pytest.approx(2.0 * empty, rel=0.01)
    status = from_diagnostic_array(diagnostics[-1])["feedforward"]
    assert status[2]["payload_status"] == "held"
    assert int(status[2]["refused_payloads"]) > 0


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({"nominal_payload_mass": -5.0}, "nominal_payload_mass"),
        ({"nominal_payload_mass": 301.0}, "max_payload"),
        ({"nominal_payload_center": [0.0, 0.0]}, "center_of_mass"),
        ({"model": "oracle"}, "oracle"),
    ],
)
def test_feedforward_does_not_start_with_wrong_parameters(bench, parameters, complaint):
    with pytest.raises((ControlError, StartError), match=complaint):
        FeedforwardNode(**bench.options(**parameters))


def test_negative_mass_is_refused_while_running(bench):
    node = bench.add(FeedforwardNode(**bench.options()))
    answer = set_parameter(node, "nominal_payload_mass", -5.0)
    assert not answer.successful
    assert "nominal_payload_mass" in answer.reason
    assert node.get_parameter("nominal_payload_mass").value == 0.0


# --- estimators


def test_pose_estimator_publishes_every_fifth_state(bench, robot):
    bench.add(PoseEstimatorNode(**bench.options()))
    poses = bench.listen(topics.PLATFORM_POSE)
    target = Pose.from_euler(np.add(robot.home.position, [0.05, -0.02, 0.04]), 0.02, 0.01, -0.03)
    angles = robot.motor_angles(inverse_kinematics(robot, target).lengths)
    sent = [0]

    def cycle():
        jitter = (-200_000, 300_000, 0)[sent[0] % 3]
        stamp = STAMP + sent[0] * CYCLE + jitter
        bench.publish(topics.MOTOR_STATES, MOTORS.encode(stamp, angles, ZERO, ZERO))
        sent[0] += 1
        bench.spin(0.004)

    bench.until(lambda: len(poses) >= 6, cycle)
    stamps = np.array([from_pose_stamped(message)[0] for message in poses])
    np.testing.assert_allclose(np.diff(stamps)[1:], 5 * CYCLE, atol=600_000)
    _, position, quaternion = from_pose_stamped(poses[-1])
    np.testing.assert_allclose(position, target.position, atol=1e-7)
    np.testing.assert_allclose(quaternion, target.quaternion, atol=1e-7)


def test_mass_estimator_publishes_and_says_at_once_when_it_is_not_valid(bench, robot):
    bench.add(MassEstimatorNode(**bench.options(mass_rate_limit=5000.0)))
    payloads = bench.listen(topics.PAYLOAD)
    diagnostics = bench.listen(topics.DIAGNOSTICS)
    tensions = holding_tensions(robot, robot.home, Payload(90.0, np.zeros(3))).tensions
    angles = robot.motor_angles(inverse_kinematics(robot, robot.home).lengths, tensions)
    noise = np.random.default_rng(0)  # without it cells are found to be stuck
    stamp = [STAMP]

    def cycle(tensions=tensions):
        stamp[0] += CYCLE
        shown = tensions + noise.normal(0.0, 1e-3, COUNT)
        bench.publish(topics.MOTOR_STATES, MOTORS.encode(stamp[0], angles, ZERO, ZERO))
        bench.publish(topics.CABLE_TENSIONS, CABLES.encode(stamp[0], effort=shown))

    def mass():
        return from_inertia_stamped(payloads[-1])[1] if payloads else 0.0

    bench.until(lambda: mass() == pytest.approx(90.0, abs=0.01), cycle)  # at a limited rate
    assert STAMP < from_inertia_stamped(payloads[-1])[0] <= stamp[0]
    slack = np.array(tensions)
    slack[4] = 0.0
    diagnostics.clear()
    bench.until(lambda: diagnostics, cycle)  # the next regular ones are a second away

    def held_by():
        newest = [from_diagnostic_array(m)["mass_estimator"] for m in diagnostics]
        return newest[-1][2]["held_by"] if newest else ""

    begin = time.monotonic()
    bench.until(lambda: held_by() == "slack_cable", lambda: cycle(slack))
    assert time.monotonic() - begin < 0.9
    assert mass() == pytest.approx(90.0, abs=0.01)


# --- trajectory


def robot_state(name):
    return diagnostic_status("supervisor", Level.OK, name)


def test_trajectory_publisher_holds_approaches_and_stops(bench, robot):
    hurried = {"speed": 0.7, "acceleration": 10.0}
    bench.add(TrajectoryPublisher(**bench.options(trajectory="paper-19", dwell=0.0, **hurried, **PATIENT)))
    references = bench.listen(topics.REFERENCE, raw=True)
    states = bench.listen(topics.TRAJECTORY_STATE)
    stamp = [STAMP]

    def phase():
        return from_diagnostic_status(states[-1])[2] if states else ""

    def cycle():
        stamp[0] += CYCLE
        bench.publish(topics.MOTOR_STATES, MOTORS.encode(stamp[0], ZERO, ZERO, ZERO))

    bench.until(lambda: phase() == "idle", cycle)
    assert references == []
    position = np.add(robot.home.position, [0.1, 0.0, 0.05])
    message = pose_stamped(STAMP, position, robot.home.quaternion)
    bench.until(lambda: references, lambda: (bench.publish(topics.PLATFORM_POSE, message), cycle()))
    assert phase() == "hold"
    sample = REFERENCE.decode(references[-1])
    np.testing.assert_allclose(sample.position, position)
    assert (sample.stamp_ns - STAMP) % CYCLE == 0

    answer = bench.call("/trajectory_publisher/start")
    assert not answer.success
    assert "enable it first" in answer.message
    bench.publish(topics.ROBOT_STATE, robot_state("enabled"))
    bench.spin(0.1)
    assert "no sign of life of the supervisor" in bench.call("/trajectory_publisher/start").message
    bench.publish(topics.SUPERVISOR_ALIVE, SIGN)
    bench.spin(0.1)
    answer = bench.call("/trajectory_publisher/start")
    assert answer.success
    bench.until(lambda: phase() == "approach", cycle)
    _, _, _, values = from_diagnostic_status(states[-1])
    assert values["trajectory"] == "paper-19"
    start = int(values["start_time"])
    assert int(values["end_time"]) - start == 10_000_000_000
    assert start > stamp[0]
    bench.until(lambda: phase() == "running", cycle)
    bench.spin(0.05)
    sample = REFERENCE.decode(references[-1])
    assert sample.time_from_start == pytest.approx((sample.stamp_ns - start) * 1e-9)
    np.testing.assert_allclose(sample.linear_velocity[1:], [-0.12, 0.04])
    assert bench.call("/trajectory_publisher/stop").success
    assert phase() == "stopping"
    bench.until(lambda: phase() == "hold", cycle)


def test_motions_faster_than_the_motors_are_refused_while_it_runs(bench):
    node = bench.add(TrajectoryPublisher(**bench.options(trajectory="hold")))
    assert set_parameter(node, "speed", 0.7).successful
    refused = set_parameter(node, "speed", 10.0)
    assert not refused.successful
    assert "speed is 10; it must be at most 0.75: speed_limit = 450 rad/s" in refused.reason
    assert not set_parameter(node, "acceleration", 100.0).successful
    assert node.component.player.limits.speed == 0.7


def test_trajectory_publisher_stops_when_the_robot_is_no_longer_enabled(bench, robot):
    bench.add(TrajectoryPublisher(**bench.options(trajectory="smooth-19-tilt", **PATIENT)))
    states = bench.listen(topics.TRAJECTORY_STATE)
    stamp = [STAMP]

    def phase():
        return from_diagnostic_status(states[-1])[2] if states else ""

    def cycle():
        stamp[0] += CYCLE
        bench.publish(topics.MOTOR_STATES, MOTORS.encode(stamp[0], ZERO, ZERO, ZERO))

    message = pose_stamped(STAMP, robot.home.position, robot.home.quaternion)
    bench.until(lambda: phase() == "hold", lambda: (bench.publish(topics.PLATFORM_POSE, message), cycle()))
    bench.publish(topics.ROBOT_STATE, robot_state("enabled"))
    bench.publish(topics.SUPERVISOR_ALIVE, SIGN)
    bench.spin(0.1)
    assert bench.call("/trajectory_publisher/start").success
    bench.until(lambda: phase() == "approach", cycle)
    bench.publish(topics.ROBOT_STATE, robot_state("fault"))
    bench.until(lambda: phase() == "stopping", cycle)
    bench.publish(topics.PLATFORM_POSE, message)
    bench.until(lambda: phase() == "hold", cycle)


def test_trajectory_parameters_are_validated(bench, robot):
    node = bench.add(TrajectoryPublisher(**bench.options()))
    assert set_parameter(node, "trajectory", "move").successful
    assert "paper-20" in set_parameter(node, "trajectory", "paper-20").reason
    assert "outside" in set_parameter(node, "move_position", [0.0, 0.0, 9.0]).reason
    assert "3 are needed" in set_parameter(node, "move_position", [0.0]).reason
    assert set_parameter(node, "move_position", [0.1, 0.1, 1.2]).successful
    assert set_parameter(node, "trajectory", "smooth-19").successful
    assert "blend time" in set_parameter(node, "blend_time", 6.0).reason


# --- supervisor


def test_supervisor_enables_stops_and_latches_a_fault(bench, robot):
    bench.add(SupervisorNode(**bench.options(verification_required=False)))
    states = bench.listen(topics.ROBOT_STATE)
    called = []

    def serve(name):
        def answer(request, response):
            called.append(name)
            response.success = True
            return response

        bench.probe.create_service(Trigger, name, answer)

    for name in (
        "/can_drives/enable",
        "/can_drives/disable",
        "/can_drives/quick_stop",
        "/can_drives/fault_reset",
        "/trajectory_publisher/stop",
    ):
        serve(name)
    drives = ["disabled"]
    tensions = [robot.home_tensions]  # they hold the platform
    torques = robot.winch.motor_torque(robot.home_tensions)
    begin = time.monotonic()

    def state():
        return from_diagnostic_status(states[-1])[2] if states else ""

    def cycle():
        stamp = STAMP + round((time.monotonic() - begin) * 1e9)
        bench.publish(topics.MOTOR_STATES, MOTORS.encode(stamp, ZERO, ZERO, torques))
        bench.publish(topics.REFERENCE, reference_message(Motion.at_rest(robot.home), stamp))
        bench.publish(topics.SETPOINT, MOTORS.encode(stamp, ZERO, ZERO, ZERO))
        bench.publish(topics.CABLE_TENSIONS, CABLES.encode(stamp, effort=tensions[0]))
        bench.publish(topics.PLATFORM_POSE, pose_stamped(stamp, robot.home.position, robot.home.quaternion))

    def report():
        bench.publish(
            topics.DRIVE_STATES,
            diagnostic_array(STAMP, [diagnostic_status("can_drives", Level.OK, drives[0])]),
        )

    def command(name):
        client = bench.probe.create_client(Trigger, f"/supervisor/{name}")
        bench.until(client.service_is_ready, cycle)
        future = client.call_async(Trigger.Request())
        bench.until(future.done, cycle)
        return future.result()

    bench.until(lambda: state() == "disabled")
    refused = bench.call("/supervisor/enable")
    assert not refused.success
    assert "has not been received" in refused.message
    report()
    bench.publish(topics.TRAJECTORY_STATE, diagnostic_status("trajectory_publisher", Level.OK, "hold"))
    for _ in range(20):
        cycle()
        bench.spin(0.01)
    assert called == []
    assert command("enable").success
    bench.until(lambda: called == ["/can_drives/enable"] and state() == "enabling", cycle)
    drives[0] = "enabled"
    report()
    bench.until(lambda: state() == "enabled", cycle)

    assert command("stop").success
    bench.until(lambda: called[-1] == "/can_drives/disable", cycle)
    assert called[-2] == "/trajectory_publisher/stop"
    drives[0] = "disabled"
    report()
    bench.until(lambda: state() == "disabled", cycle)

    assert command("enable").success
    drives[0] = "enabled"
    bench.until(lambda: state() == "enabling", cycle)
    report()
    bench.until(lambda: state() == "enabled", cycle)
    tensions[0] = np.full(COUNT, 3500.0)
    bench.until(lambda: state() == "fault", cycle)
    bench.until(lambda: "/can_drives/quick_stop" in called, cycle)
    _, level, _, values = from_diagnostic_status(states[-1])
    assert level is Level.ERROR
    assert "cable_1" in values["cause"]
    tensions[0] = np.full(COUNT, 400.0)
    drives[0] = "disabled"
    report()
    bench.spin(0.1)
    assert not command("enable").success
    assert command("reset").success
    bench.until(lambda: state() == "disabled", cycle)
    assert called[-1] == "/can_drives/fault_reset"
    enables = called.count("/can_drives/enable")
    bench.spin(0.3)
    assert called.count("/can_drives/enable") == enables == 2


def test_supervisor_names_both_end_points_of_a_topic_with_two_publishers(bench):
    """Before anything has been published: end points are enough."""
    bench.add(SupervisorNode(**bench.options(verification_required=False)))
    assert "/setpoint has" not in bench.call("/supervisor/enable").message
    own = bench.add(Node("feedforward", context=bench.probe.context))
    other = bench.add(Node("feedforward", namespace="lab", context=bench.probe.context))
    for node in (own, other):
        advertise(node, topics.SETPOINT)
    states = bench.listen(topics.ROBOT_STATE)
    bench.until(lambda: "/setpoint has" in bench.call("/supervisor/enable").message)
    refused = bench.call("/supervisor/enable")
    assert not refused.success
    assert (
        "two publishers: /setpoint has 2 publishers, /feedforward and /lab/feedforward: end all but one"
        in refused.message
    )
    bench.until(lambda: states)
    assert from_diagnostic_status(states[-1])[2] == "disabled"


def test_supervisor_repeats_that_a_recording_failed(bench):
    bench.add(SupervisorNode(**bench.options(verification_required=False)))
    diagnostics = bench.listen(topics.DIAGNOSTICS)
    cause = "recording ended early, bag_0.mcap cannot be written: No space left on device"
    failed = diagnostic_status("recorder", Level.ERROR, "failed", {"bag": "bag", "cause": cause})
    bench.publish(topics.RECORDER_STATE, failed)

    def texts():
        return [
            (status.message, status.level)
            for message in diagnostics
            for status in message.status
            if status.name == "supervisor"
        ]

    bench.until(lambda: (f"disabled; recorder: {cause}", bytes([Level.WARN])) in texts())


def test_supervisor_that_goes_closes_the_brakes(bench):
    node = bench.add(SupervisorNode(**bench.options(verification_required=False)))
    called = threading.Event()

    def answer(request, response):
        called.set()
        return response

    bench.probe.create_service(Trigger, "/can_drives/quick_stop", answer)
    bench.until(lambda: bench.is_discovered(node, "/can_drives/quick_stop"))
    node.component.supervisor.state = RobotState.ENABLED
    bench.remove(node)
    leaving = threading.Thread(target=node.make_safe)
    leaving.start()
    bench.until(called.is_set)
    leaving.join()
    node.destroy_node()


def test_supervisor_says_that_nobody_answers(bench, robot):
    node = bench.add(SupervisorNode(**bench.options(verification_required=False)))
    states = bench.listen(topics.ROBOT_STATE)
    now = time.monotonic()
    checks = node.component.supervisor.checks
    checks.observe_motors(now, JointStateSample(STAMP, ZERO, ZERO, ZERO))
    checks.observe_setpoint(now, JointStateSample(STAMP, ZERO, ZERO, ZERO))
    checks.observe_tensions(now, np.full(COUNT, 400.0))
    checks.observe_pose(now, robot.home.position, robot.home.quaternion)
    checks.observe_arrival(MonitoredInput.REFERENCE, now)
    node.component.supervisor.observe_drives(now, DriverState.DISABLED)
    decision, outputs = node.component.services()["/supervisor/enable"](now)
    assert decision.accepted
    node.wiring._send(outputs)
    bench.until(lambda: states)
    newest = from_diagnostic_status(states[-1])
    assert newest[2] == "disabled"
    assert "service /can_drives/enable is not available" in newest[3]["remark"]


# --- control


def test_nodes_of_one_process_hear_each_topic_once_and_motor_controllers_first(bench):
    nodes = [bench.add(node) for node in create_control_nodes(**bench.options())]
    heard = [subscription.topic_name for node in nodes for subscription in node.subscriptions]
    heard = [name for name in heard if name not in ("/parameter_events", "/clock")]
    assert len(heard) == len(set(heard))
    graph = nodes[1].wiring.graph
    assert set(heard) == set(graph.inputs)
    first = [route.component.name for route in graph.routes(topics.MOTOR_STATES)][:COUNT]
    assert first == [f"motor_controller_{k}" for k in range(1, COUNT + 1)]


def test_nodes_of_one_process_that_expect_different_rates_are_refused(bench, tmp_path):
    file = tmp_path / "control.yaml"
    file.write_text("pose_estimator: {ros__parameters: {control_rate: 100.0}}")
    with pytest.raises(
        SettingError, match=r"control_rate of pose_estimator is 100\.0, of motor_control_gains 250"
    ):
        create_control_nodes(**bench.options(), cli_args=["--ros-args", "--params-file", str(file)])


@pytest.fixture
def control_of_known_stability(bench, tmp_path, monkeypatch):
    """Return the control nodes, and what keeps margins and a map of gains for their loop."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    nodes = [bench.add(node) for node in create_control_nodes(**bench.options())]
    loop = loop_of(nodes)
    enough = Margin(5.0, Place((0.0, 0.0, 2.0), 300.0))

    def keep(**margins):
        report = StabilityReport(**{item.name: enough for item in fields(StabilityReport)} | margins)
        safe = SafeGains((1.0, 2.0, 4.0), (0.05, 0.1, 0.2), ((True,) * 3, (True, True, False), (False,) * 3))
        keep_result(KeptResult(loop.fingerprint, report, safe))

    return nodes, keep


def test_gains_that_are_not_known_to_be_stable_are_refused_while_running(bench, control_of_known_stability):
    nodes, keep = control_of_known_stability
    keep()
    assert guard_gains(nodes) is nodes
    gains = nodes[0]
    diagnostics = bench.listen(topics.DIAGNOSTICS)
    assert set_parameter(gains, "kp", 1.5).successful
    refused = set_parameter(gains, "kp", 3.0)
    assert not refused.successful
    assert "kp = 3 N m/rad with kd = 0.1 N m s/rad is not known to be stable" in refused.reason
    assert not set_parameter(gains, "kd", 0.3).successful
    assert (
        set_parameter(gains, "kd", 0.15).successful is False
    )  # with kp = 1.5 a corner of the cell is not safe
    assert set_parameter(gains, "friction_compensation", 0.5).successful
    assert (gains.gains.kp, gains.gains.kd) == (1.5, 0.1)

    def shown():
        statuses = [status for message in diagnostics for status in message.status]
        return [from_diagnostic_status(status) for status in statuses if status.name == "stability"]

    bench.until(shown)
    _, level, _, values = shown()[0]
    assert (level, values["gain_margin"], values["safe_gains"]) == (Level.OK, "5", "known")


def test_control_does_not_start_without_margins(control_of_known_stability):
    nodes, keep = control_of_known_stability
    keep(late_cycles=Margin(1, Place((0.0, 0.0, 2.0), 300.0)))
    with pytest.raises(StabilityError, match=r"kd is 0\.1 N m s/rad.* 1 cycle late, worst at .*lower kd"):
        guard_gains(nodes)


@pytest.mark.parametrize(
    ("component", "method", "name"),
    [
        (PoseComponent, "on_motor_states", "pose_estimator"),
        (PayloadComponent, "report", "mass_estimator"),
        (SupervisionComponent, "status", "supervisor"),
    ],
)
def test_what_goes_wrong_in_a_component_is_named_and_ends_nothing(
    bench, monkeypatch, component, method, name
):
    def fail(*_):
        raise ValueError("no such thing")

    monkeypatch.setattr(component, method, fail)
    for node in create_control_nodes(**bench.options()):
        bench.add(node)
    heard = bench.listen(topics.DIAGNOSTICS)

    def failures():
        return [each for array in heard for each in array.status if each.message.startswith("failed: ")]

    bench.until(failures, lambda: bench.publish(topics.MOTOR_STATES, MOTORS.encode(STAMP, ZERO, ZERO, ZERO)))
    values = {each.key: each.value for each in failures()[0].values}
    assert failures()[0].name == name
    assert re.match(r"ValueError: no such thing \(test_nodes\.py, line \d+\)", values["failure"])
