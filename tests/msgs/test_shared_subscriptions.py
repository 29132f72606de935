"""One raw subscription a topic for nodes that share a process."""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np
import pytest
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from cspr_msgs_py.runtime.process import advertise, shared_subscriptions, subscribe_raw
from cspr_msgs_py.topics import CABLE_TENSIONS, MOTOR_STATES, motor_names
from cspr_msgs_py.wire.joint_state import JointStateCodec


@pytest.fixture
def context() -> Iterator[Context]:
    context = Context()
    rclpy.init(context=context)
    yield context
    rclpy.try_shutdown(context=context)


def deliver(context: Context, nodes: list[Node], heard: list[str], wanted: int) -> None:
    """Publish motor states until as many callbacks have run as are wanted."""
    source = Node("source", context=context)
    publisher = advertise(source, MOTOR_STATES)
    message = JointStateCodec(motor_names(8)).encode(1, *np.zeros((3, 8)))
    executor = SingleThreadedExecutor(context=context)
    for node in nodes:
        executor.add_node(node)
    deadline = time.monotonic() + 20.0
    while len(heard) < wanted:
        assert time.monotonic() < deadline, heard
        publisher.publish(message)
        executor.spin_once(timeout_sec=0.05)
    executor.shutdown()
    source.destroy_node()


def test_every_node_hears_in_the_order_of_subscription(context: Context) -> None:
    heard: list[str] = []
    nodes = [Node(name, context=context) for name in ("a", "b", "c")]
    with shared_subscriptions():
        subscriptions = [
            subscribe_raw(n, MOTOR_STATES, lambda _, n=n: heard.append(n.get_name())) for n in nodes
        ]
        other = subscribe_raw(nodes[1], CABLE_TENSIONS, lambda _: heard.append("tensions"))
    assert subscriptions[0] is subscriptions[1] is subscriptions[2] is not other
    deliver(context, nodes, heard, 6)
    assert heard[:6] == ["a", "b", "c"] * 2
    for node in nodes:
        node.destroy_node()


def test_outside_the_block_each_node_has_its_own(context: Context) -> None:
    heard: list[str] = []
    first, second = (Node(name, context=context) for name in ("a", "b"))
    with shared_subscriptions():
        shared = subscribe_raw(first, MOTOR_STATES, lambda _: heard.append("a"))
    assert subscribe_raw(second, MOTOR_STATES, lambda _: heard.append("b")) is not shared
    first.destroy_node()
    second.destroy_node()
