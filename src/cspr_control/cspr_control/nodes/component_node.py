"""Nodes of the control graph: they decode, call their component, encode, and hold nothing else."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import rclpy
from rclpy.client import Client
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from cspr_control.components.component import Call, Component, Outputs, Publication, Remark, Timer
from cspr_control.graph import ControlGraph, Route
from cspr_control.nodes.parameters import Settings, changeable_settings, declare_robot
from cspr_control.supervision.supervisor import Decision
from cspr_kinematics import Robot
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.runtime.process import advertise, run_nodes, steady_timer, subscribe_raw
from cspr_msgs_py.topics import DIAGNOSTICS, Topic
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.cdr import Bytes
from cspr_msgs_py.wire.conversion import decoder
from cspr_msgs_py.wire.topic_codecs import topic_codec

_LAST_WORD = 0.5
"""How long a node that ends waits for the answer to what makes the robot safe, s."""


class Wiring:
    """The part of the control graph that lives in one process.

    Each topic is subscribed to once and each message decoded once, however many components hear it: taking a message
    from the middleware costs more than most of them do with it. They hear it in the order in which they were added.
    What they publish for one another goes over the topics all the same.

    Parameters
    ----------
    monotonic, system_ns
        Clocks: monotonic time, s, and ROS time, ns.
    """

    def __init__(
        self,
        monotonic: Callable[[], float] = time.monotonic,
        system_ns: Callable[[], int] = time.time_ns,
    ) -> None:
        self.graph = ControlGraph()
        self._monotonic, self._system_ns = monotonic, system_ns
        self._nodes: dict[str, Node] = {}
        self._senders: dict[str, tuple[Callable[[bytes], None], Callable[[Any], bytes]]] = {}
        self._clients: dict[str, Client] = {}

    def add(self, node: Node, component: Component, number_of_motors: int) -> None:
        """Connect a component to topics, services and timers, by way of its node."""
        self._nodes[component.name] = node
        for topic in component.outputs:
            if topic.name not in self._senders:
                publish = advertise(node, topic).publish
                self._senders[topic.name] = (publish, topic_codec(topic, number_of_motors).encode)
        for service in component.calls:
            self._clients[service] = node.create_client(Trigger, service)
        for topic in self.graph.add(component):
            decode, routes = decoder(topic, number_of_motors), self.graph.routes(topic)
            subscribe_raw(node, topic, partial(self._on_message, topic, decode, routes))
        for service, command in component.services().items():
            node.create_service(Trigger, service, partial(self._on_command, component.name, command))
        for timer in component.timers():
            steady_timer(node, timer.period, partial(self._on_timer, component.name, timer))
        self._send(component.begin())

    def _on_message(
        self, topic: Topic, decode: Callable[[Bytes], Any], routes: Sequence[Route], message: bytes
    ) -> None:
        now = self._monotonic()
        try:
            sample = decode(message)
        except MessageError as error:
            self.graph.refuse(topic, str(error))
            return
        for component, _, handle in routes:
            self._run(component.name, handle, now, sample)

    def _on_timer(self, name: str, timer: Timer) -> None:
        self._run(name, timer.run, self._monotonic())

    def _on_command(
        self,
        name: str,
        command: Callable[[float], tuple[Decision, Outputs]],
        request: Trigger.Request,
        response: Trigger.Response,
    ) -> Trigger.Response:
        response.message = f"{name} has failed; its log says where"

        def decide() -> Outputs:
            decision, outputs = command(self._monotonic())
            response.success, response.message = decision.accepted, decision.message
            return outputs

        self._run(name, decide)
        return response

    def _run(self, name: str, step: Callable[..., Outputs], *arguments: Any) -> None:
        """Send what a step of a component returns; what goes wrong meanwhile is a failure of the component."""
        try:
            self._send(step(*arguments))
        except Exception as error:
            self.failed(name, error)

    def failed(self, name: str, error: Exception) -> None:
        """Let a component say what went wrong in it, or in its node."""
        self._send(self.graph.components[name].failed(self._monotonic(), error))

    def _send(self, outputs: Outputs) -> None:
        unheard: list[Call] = []
        for output in outputs:
            if isinstance(output, Publication):
                topic, sample = output
                publish, encode = self._senders[topic.name]
                if topic is DIAGNOSTICS:
                    sample = sample._replace(stamp_ns=self._system_ns())
                publish(encode(sample))
            elif isinstance(output, Remark):
                self._log(output)
            elif (client := self._clients[output.service]).service_is_ready():
                client.call_async(Trigger.Request()).add_done_callback(partial(self._on_answer, output))
            else:
                unheard.append(output)
        for call in unheard:
            self._answer(call, False, f"service {call.service} is not available")

    def _log(self, remark: Remark) -> None:
        logger = self._nodes[remark.component].get_logger()
        if remark.level is Level.OK:  # a line of rclpy's logger has one severity for ever
            logger.info(remark.text)
        elif remark.level is Level.WARN:
            logger.warning(remark.text)
        else:
            logger.error(remark.text)

    def _on_answer(self, call: Call, future: Future) -> None:
        try:
            answer = future.result()
        except Exception as error:  # the service ended meanwhile
            answer = Trigger.Response(message=str(error))
        self._answer(call, answer.success, answer.message)

    def _answer(self, call: Call, accepted: bool, message: str) -> None:
        component = self.graph.components[call.component]
        self._run(component.name, component.answered, self._monotonic(), call, accepted, message)

    def make_safe(self, component: Component) -> None:
        """Call what a component that is about to end still asks for, and wait for the answer a little."""
        node = self._nodes[component.name]
        for output in component.make_safe():
            client = self._clients[output.service] if isinstance(output, Call) else None
            if client is not None and client.service_is_ready():
                future = client.call_async(Trigger.Request())
                executor = SingleThreadedExecutor(context=node.context)
                rclpy.spin_until_future_complete(node, future, executor, timeout_sec=_LAST_WORD)
                executor.shutdown()


class ComponentNode(Node):
    """A node of one component of the control graph.

    Parameters
    ----------
    name
        Of the node.
    wiring
        Of the process that the node shares with others; one of its own by default.
    robot
        The robot; read from the file that the parameter ``robot_config`` names by default.
    **options
        Further keyword arguments of `rclpy.node.Node`.

    Attributes
    ----------
    robot
        The robot.
    wiring
        What connects the component.
    component
        Set by `connect`.
    """

    component: Any

    def __init__(
        self, name: str, wiring: Wiring | None = None, robot: Robot | None = None, **options: Any
    ) -> None:
        super().__init__(name, **options)
        self.robot = declare_robot(self) if robot is None else robot
        self.wiring = Wiring() if wiring is None else wiring

    def changeable(self, build: Callable[[dict[str, Any]], Settings]) -> Settings:
        """Return the settings that the declared parameters make; changed ones go to the component's ``configure``."""
        return changeable_settings(self, build, lambda settings: self.component.configure(settings))

    def connect(self, component: Component) -> None:
        """Take up work with a component."""
        self.component = component
        self.wiring.add(self, component, self.robot.number_of_cables)

    def failed(self, error: Exception) -> None:
        """Say what went wrong in a callback of the node."""
        self.wiring.failed(self.component.name, error)

    def make_safe(self) -> None:
        """Do what is left to be done before the node ends."""
        self.wiring.make_safe(self.component)


def executable(create: Callable[[], Node]) -> Callable[[], int]:
    """Return the ``main`` that runs one node until SIGINT or SIGTERM."""
    return lambda: run_nodes(lambda: [create()])
