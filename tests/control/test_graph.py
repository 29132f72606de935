"""Routes, order, timers and services of the control graph."""

from __future__ import annotations

from typing import ClassVar

import pytest

from cspr_control.components.component import Call, Component, Publication, Timer
from cspr_control.graph import ControlGraph, control_graph
from cspr_control.parameters.control_settings import control_settings
from cspr_control.supervision.supervisor import Decision
from cspr_msgs_py import topics
from cspr_msgs_py.parameters.file import ParameterFile
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.samples import Status


class Echo(Component):
    """Publishes what it hears, and when, on another topic."""

    inputs: ClassVar = (topics.MOTOR_STATES, topics.PAYLOAD)

    def __init__(self, name, answer, log):
        super().__init__(name, answer)
        self.answer, self.log = answer, log

    def _hear(self, now, sample):
        self.log.append((self.name, now, sample))
        return (Publication(self.answer, f"{sample}>{self.name}"),)

    on_motor_states = _hear

    def on_payload(self, now, sample):
        self.log.append((self.name, now, sample))
        return ()

    def timers(self):
        return (Timer(0.3, lambda now: self._hear(now, "tick")), *super().timers())

    def services(self):
        return {f"/{self.name}/ask": lambda now: (Decision(True, self.name), [Call(self.name, "/other")])}

    def answered(self, now, call, accepted, message):
        return self._hear(now, f"{call.service} {accepted} {message}")

    def status(self, now):
        return Status(self.name, Level.OK, "")


@pytest.fixture
def log():
    return []


def test_all_answers_to_one_sample_come_before_the_answers_to_any_of_them(log):
    graph = ControlGraph([Echo("a", topics.PAYLOAD, log), Echo("b", topics.SETPOINT, log)])
    outputs = graph.on(topics.MOTOR_STATES, 1.0, "x")
    assert [(output.topic, output.sample) for output in outputs] == [
        (topics.PAYLOAD, "x>a"), (topics.SETPOINT, "x>b"),
    ]  # fmt: skip
    assert log == [("a", 1.0, "x"), ("b", 1.0, "x"), ("a", 1.0, "x>a"), ("b", 1.0, "x>a")]
    assert graph.on(topics.REFERENCE, 1.0, "nobody") == []


def test_one_hop_feeds_nothing_through(log):
    graph = ControlGraph([Echo("a", topics.PAYLOAD, log)])
    assert len(graph.deliver(topics.MOTOR_STATES, 1.0, "x")) == 1
    assert len(log) == 1


def test_a_component_may_hear_another_topic_instead(log):
    instead = {("b", topics.PAYLOAD.name): topics.SIMULATED_PAYLOAD}
    graph = ControlGraph([Echo("a", topics.SETPOINT, log), Echo("b", topics.SETPOINT, log)], instead)
    assert topics.SIMULATED_PAYLOAD.name in graph.inputs
    graph.on(topics.PAYLOAD, 1.0, "estimated")
    graph.on(topics.SIMULATED_PAYLOAD, 1.0, "true")
    assert log == [("a", 1.0, "estimated"), ("b", 1.0, "true")]
    graph.refuse(topics.SIMULATED_PAYLOAD, "no message")
    assert [component.unusable for component in graph.components.values()] == [0, 1]


def test_timers_run_at_the_time_at_which_they_were_due_in_that_order(log):
    graph = ControlGraph([Echo("a", topics.SETPOINT, log)])
    assert graph.begin(10.0) == []
    assert graph.next_due == pytest.approx(10.3)
    assert graph.advance(10.2) == []
    outputs = graph.advance(11.0)
    assert [round(now, 9) for _, now, _ in log] == [10.3, 10.6, 10.9]
    assert [output.topic for output in outputs] == [topics.SETPOINT] * 3 + [topics.DIAGNOSTICS]
    assert graph.next_due == pytest.approx(11.2)


def test_calls_are_answered_by_whoever_drives_the_graph(log):
    graph = ControlGraph([Echo("a", topics.PAYLOAD, log)])
    assert list(graph.services) == ["/a/ask"]
    decision, (call,) = graph.call(1.0, "/a/ask")
    assert decision.message == "a"
    (answer,) = graph.answered(1.5, call, False, "not now")
    assert answer.topic is topics.PAYLOAD
    assert log == [("a", 1.5, "/other False not now"), ("a", 1.5, answer.sample)]
    with pytest.raises(KeyError):
        graph.call(1.0, "/b/ask")


def test_the_whole_graph_has_the_topics_of_the_table(robot, robot_file):
    parameters = ParameterFile.from_yaml(robot_file.parent / "control.yaml")
    graph = control_graph(robot, control_settings(robot, parameters))
    written = {
        topic.name: component.name for component in graph.components.values() for topic in component.outputs
    }
    table = {topic.name: topic for topic in topics.graph_topics(robot.number_of_cables)}
    for name, component in written.items():
        assert table[name].writer in (component, "*")
    assert {name for name, topic in table.items() if topic.writer in graph.components} <= set(written)
    assert set(graph.inputs) <= set(table)
    called = {service for component in graph.components.values() for service in component.calls}
    assert called - set(graph.services) == {
        f"/can_drives/{name}" for name in ("enable", "disable", "quick_stop", "fault_reset")
    }
