"""Records of the graph's topics in memory, read as those of a bag are: an analysis needs no file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from cspr_msgs_py.bag.bag_file import Attachment
from cspr_msgs_py.bag.columns import Inertias, JointStates, Messages, Poses, References
from cspr_msgs_py.topics import CABLE_TENSIONS, REFERENCE, Topic, cable_names, motor_command, motor_names
from cspr_msgs_py.wire.log import SEVERITY
from cspr_msgs_py.wire.samples import Status, StatusArray


class SampleMemory:
    """Takes what a `SampleBag` takes, and gives what a `Bag` of it would give to an analysis.

    Parameters
    ----------
    path
        What it is called: that of its bag, if there is one as well.
    number_of_motors
        Of the robot.
    information, attachments
        As of `BagFile`.
    """

    def __init__(
        self,
        path: Path,
        number_of_motors: int,
        information: Mapping[str, str],
        attachments: Iterable[Attachment],
    ) -> None:
        self.path = path
        self.metadata = {"recording": dict(information)}
        self.attachments = {file.name: file.data for file in attachments}
        motors = motor_names(number_of_motors)
        self._names: dict[str, tuple[str, ...]] = {
            motor_command(k).name: (motor,) for k, motor in enumerate(motors, start=1)
        }
        self._names[CABLE_TENSIONS.name] = cable_names(number_of_motors)
        self._motors = motors
        self._samples: dict[str, list[tuple[int, Any]]] = {}

    @property
    def counts(self) -> dict[str, int]:
        """Number of samples of each topic."""
        return {name: len(samples) for name, samples in self._samples.items()}

    def write(self, topic: Topic, time_ns: int, sample: Any) -> None:
        """Keep a record, published and received at a time."""
        self._samples.setdefault(topic.name, []).append((time_ns, sample))

    def read(self, topic: str) -> Messages:
        """Return statuses or lines of the log as the messages that they are."""
        times = np.array([time for time, _ in self._samples[topic]])
        return Messages(self._start, times, times, [_message(sample) for _, sample in self._samples[topic]])

    def joint_states(self, topic: str) -> JointStates:
        """Return a JointState topic as columns."""
        stamps, times, *fields = self._columns(topic)
        columns = [field.reshape(len(times), -1) for field in fields]
        return JointStates(self._start, stamps, times, self._names.get(topic, self._motors), *columns)

    def references(self, topic: str = REFERENCE.name) -> References:
        """Return the reference as columns."""
        return References(self._start, *self._columns(topic))

    def poses(self, topic: str) -> Poses:
        """Return a PoseStamped topic as columns."""
        return Poses(self._start, *self._columns(topic))

    def inertias(self, topic: str) -> Inertias:
        """Return an InertiaStamped topic as columns."""
        return Inertias(self._start, *self._columns(topic))

    @property
    def _start(self) -> int:
        return min(samples[0][0] for samples in self._samples.values())

    def _columns(self, topic: str) -> list[Any]:
        """Return stamps, times, and the other fields of the samples, which have the order of the columns."""
        times, samples = zip(*self._samples[topic], strict=True)
        stamps, *fields = (np.array(field) for field in zip(*samples, strict=True))
        return [stamps, np.array(times), *fields]


def _message(sample: Any) -> Any:
    """Return an object with the fields of the message that a sample is."""
    if isinstance(sample, StatusArray):
        return SimpleNamespace(status=[_message(status) for status in sample.statuses])
    if isinstance(sample, Status):
        values = [SimpleNamespace(key=key, value=value) for key, value in sample.values.items()]
        return SimpleNamespace(name=sample.name, level=sample.level, message=sample.message, values=values)
    return SimpleNamespace(name=sample.name, level=SEVERITY[sample.level], msg=sample.text)
