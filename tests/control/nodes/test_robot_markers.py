"""The node robot_markers alone: what it shows, and what it does not show any more."""

import time

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future
from tests.messages import diagnostic_status, inertia_stamped, pose_stamped

from cspr_control.nodes.robot_markers import RobotMarkers
from cspr_kinematics import Pose
from cspr_msgs_py import topics
from cspr_msgs_py.runtime.process import advertise, subscribe
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.joint_state import JointStateCodec

PATIENCE = 120.0
STAMP = 1_700_000_000_000_000_000
CABLES = JointStateCodec(topics.cable_names(8), position=False, velocity=False)
POSE = Pose.from_euler([0.1, 0.2, 1.1], 0.1, 0.0, 0.0)


@pytest.fixture
def graph(robot_file):
    context = Context()
    rclpy.init(args=[], context=context)
    executor = EventsExecutor(context=context)
    override = [Parameter("robot_config", value=str(robot_file))]
    nodes = [RobotMarkers(context=context, parameter_overrides=override), Node("probe", context=context)]
    for node in nodes:
        executor.add_node(node)

    def until(condition, between=lambda: None):
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, "nothing came of it"
            between()
            executor.spin_until_future_complete(Future(), timeout_sec=0.02)

    yield nodes[1], until
    for node in nodes:
        executor.remove_node(node)
        node.destroy_node()
    executor.shutdown()
    rclpy.try_shutdown(context=context)


def by_name(message):
    assert all(marker.header.frame_id == "base" for marker in message.markers)
    return {marker.ns: marker for marker in message.markers}


def test_what_is_known_is_shown_and_what_is_stale_is_not(graph):
    probe, until = graph
    received = []
    subscribe(probe, topics.ROBOT_MARKERS, received.append)
    until(lambda: received)
    assert set(by_name(received[-1])) == {"frame", "exit_points"}  # nothing has been heard of the robot

    publishers = {
        topic.name: advertise(probe, topic)
        for topic in (topics.PLATFORM_POSE, topics.CABLE_TENSIONS, topics.PAYLOAD, topics.TRAJECTORY_STATE)
    }
    publishers["/trajectory_state"].publish(
        diagnostic_status("trajectory_publisher", Level.OK, "running", {"trajectory": "paper-19"})
    )
    tensions = np.linspace(100.0, 2000.0, 8)

    def play():
        publishers["/platform_pose"].publish(pose_stamped(STAMP, POSE.position, POSE.quaternion))
        publishers["/cable_tensions"].publish(CABLES.encode(STAMP, effort=tensions))
        publishers["/payload"].publish(inertia_stamped(STAMP, 120.0, (0.0, 0.0, 0.0)))

    wanted = {"platform", "cables", "payload", "payload_mass", "trajectory", "path"}

    def all_shown():
        shown = by_name(received[-1])
        return wanted <= set(shown) and len({(c.r, c.g, c.b) for c in shown["cables"].colors}) == 8

    until(all_shown, play)
    shown = by_name(received[-1])
    position = shown["platform"].pose.position
    np.testing.assert_allclose([position.x, position.y, position.z], POSE.position)
    assert shown["payload_mass"].text == "120.0 kg"
    assert len(shown["cables"].points) == 32
    assert shown["cables"].lifetime.sec == 1
    assert shown["platform"].header.stamp.sec == STAMP // 1_000_000_000

    # silence: the platform is not shown where it was long ago
    until(lambda: set(by_name(received[-1])) == {"frame", "exit_points", "trajectory"})
