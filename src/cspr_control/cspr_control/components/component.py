"""What all components of the control graph have in common: topics in, publications out, time as an argument."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from typing import Any, ClassVar, NamedTuple, TypeVar

from cspr_control.supervision.supervisor import Decision
from cspr_msgs_py.errors import failure_text
from cspr_msgs_py.topics import DIAGNOSTICS, Topic
from cspr_msgs_py.vocabulary import HealthKey, Level
from cspr_msgs_py.wire.samples import Status, StatusArray

Word = TypeVar("Word", bound=StrEnum)

REPORT_PERIOD = 1.0
"""Between two diagnostics of a component, s."""


class Publication(NamedTuple):
    """A sample to be published on a topic; see `cspr_msgs_py.wire.topic_codecs` for which topic carries which."""

    topic: Topic
    sample: Any


class Call(NamedTuple):
    """A service to be called; its answer goes to ``answered(now, call, accepted, message)`` of the component."""

    component: str
    service: str


class Remark(NamedTuple):
    """A line for the log."""

    component: str
    level: Level
    text: str


Output = Publication | Call | Remark
Outputs = Sequence[Output]

NOTHING: Outputs = ()


class Timer(NamedTuple):
    """Something that a component does regularly: its period in s, and what it does at monotonic time ``now``, s."""

    period: float
    run: Callable[[float], Outputs]


class Component:
    """One component of the control graph. Pure: it reads no clock, and all that it does is what it returns.

    What topic T of `inputs` brings goes to the method ``on_T(now, sample)``, slashes in its name as underscores.
    ``now`` is monotonic time in s, never before that of the call before.

    Parameters
    ----------
    name
        Of its node, and in diagnostics.
    *outputs
        Topics on which it publishes besides ``/diagnostics``.

    Attributes
    ----------
    inputs
        Topics that it hears.
    outputs
        Topics on which it publishes.
    calls
        Services that it calls.
    unusable
        Number of messages that could not be used.
    problem
        What was wrong with the last of them.
    """

    inputs: ClassVar[tuple[Topic, ...]] = ()
    calls: ClassVar[tuple[str, ...]] = ()

    def __init__(self, name: str, *outputs: Topic) -> None:
        self.name = name
        self.outputs = (*outputs, DIAGNOSTICS)
        self.unusable = 0
        self.problem = ""
        self._failure = ""  # not yet reported
        self._failure_reported = -math.inf

    def handler(self, topic: Topic) -> Callable[[float, Any], Outputs]:
        """Return the method that takes the samples of a topic."""
        method: Callable[[float, Any], Outputs] = getattr(self, "on_" + topic.name[1:].replace("/", "_"))
        return method

    def refuse(self, topic: Topic, problem: str) -> None:
        """Count a message of a topic that cannot be used: its bytes were unreadable, or its numbers make no sense."""
        self.unusable += 1
        self.problem = problem

    def read_word(self, topic: Topic, kind: type[Word], text: str) -> Word | None:
        """Return the state that a message of a topic names; None, and refused, if there is none of that name."""
        try:
            return kind(text)
        except ValueError:
            self.refuse(topic, f"{topic.name} carries an unknown state, {text!r}")
            return None

    def begin(self) -> Outputs:
        """Return what is published before anything has arrived: the states of latched topics."""
        return NOTHING

    def timers(self) -> tuple[Timer, ...]:
        """Return what it does regularly; the first time one period after the start."""
        return (Timer(REPORT_PERIOD, self.report),)

    def make_safe(self) -> Outputs:
        """Return what is still to be done when the component is about to end."""
        return NOTHING

    def services(self) -> Mapping[str, Callable[[float], tuple[Decision, Outputs]]]:
        """Return the commands that it takes, by the name of the service."""
        return {}

    def answered(self, now: float, call: Call, accepted: bool, message: str) -> Outputs:
        """Process the answer to a call that it has returned; no answer counts as refused."""
        raise NotImplementedError(f"{self.name} calls no services")

    def failed(self, now: float, error: Exception) -> Outputs:
        """Return the word that something went wrong in it which must not: a defect. It goes on with what comes next.

        The first time at once, then no more often than its report, however often it fails.
        """
        self._failure = failure_text(error)
        if now - self._failure_reported < REPORT_PERIOD:
            return NOTHING
        return (Remark(self.name, Level.ERROR, f"failed: {self._failure}"), *self._report_failure(now))

    def _report_failure(self, now: float) -> Outputs:
        status = self._status(Level.ERROR, f"failed: {self._failure}", {HealthKey.FAILURE: self._failure})
        self._failure, self._failure_reported = "", now
        return (Publication(DIAGNOSTICS, StatusArray(0, (status,))),)

    def report(self, now: float) -> Outputs:
        """Return its health, for ``/diagnostics``; its sender stamps it."""
        if self._failure:
            return self._report_failure(now)
        return (Publication(DIAGNOSTICS, StatusArray(0, (self.status(now),))),)

    def status(self, now: float) -> Status:
        """Return its health."""
        raise NotImplementedError

    def _status(self, level: Level, text: str, values: Mapping[str, Any]) -> Status:
        return Status.of(self.name, level, text, values)
