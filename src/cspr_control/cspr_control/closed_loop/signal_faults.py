"""Seven kinds of faults on every signal of the graph and of the buses, as scenarios.

What may come of one is open: the robot is held, brakes closed, with a cause, or it goes on along its path as it should.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from cspr_control.closed_loop.fault_scenarios import PLACE, FaultScenario, RobotLoop
from cspr_drivers.canopen.frame_table import FunctionCode, cob_id
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.simulation.disturbance import Disturbance, DisturbanceKind
from cspr_msgs_py import topics
from cspr_msgs_py.errors import MessageError
from cspr_msgs_py.topics import Topic
from cspr_msgs_py.wire.topic_codecs import topic_codec

_SEED = 4
_HEADER = (
    20  # bytes of a message that stay as they are when the others are random: encapsulation, stamp, frame
)
_LASTS = 2.5  # s for which a signal is disturbed
_AHEAD_NS = 1_000_000_000  # a wrong stamp, where a message holds nothing else


@dataclass(frozen=True)
class FrameSignal:
    """Frames of one device: function, whether a drive's, and what is added to which bytes when a value is wrong."""

    function: FunctionCode
    of_drive: bool
    begin: int
    end: int
    added: int

    def cob_id(self, config: CanConfig) -> tuple[str, int]:
        """Return bus and identifier of the frames."""
        device = (config.drives if self.of_drive else config.load_cells)[PLACE]
        return device.bus, cob_id(self.function, device.node_id)

    def falsified(self, data: bytes) -> bytes:
        """Return a frame with a wrong value."""
        field = data[self.begin : self.end]
        value = int.from_bytes(field, "little") + self.added & (1 << 8 * len(field)) - 1
        return data[: self.begin] + value.to_bytes(len(field), "little") + data[self.end :]


SIGNALS: dict[str, Topic | FrameSignal] = {
    "motor_states": topics.MOTOR_STATES,
    "cable_tensions": topics.CABLE_TENSIONS,
    "reference": topics.REFERENCE,
    "setpoint": topics.SETPOINT,
    "platform_pose": topics.PLATFORM_POSE,
    "payload": topics.PAYLOAD,
    "supervisor_alive": topics.SUPERVISOR_ALIVE,
    "motor_command": topics.motor_command(PLACE + 1),
    # 6041h, 6064h, 6077h: a sixteenth of a revolution more
    "drive_frames": FrameSignal(FunctionCode.TPDO1, True, 2, 6, 8192),
    # 9130h: 100 N more
    "load_cell_frames": FrameSignal(FunctionCode.TPDO1, False, 0, 4, 1000),
    # 6040h, 6071h: 1.5 N m more
    "torque_frames": FrameSignal(FunctionCode.RPDO1, True, 2, 4, 300),
}
"""What can be disturbed, by name: a topic for all that hear it, or the frames of one device."""

KINDS = tuple(kind.value for kind in DisturbanceKind)
"""What can happen to each."""


def signal_scenarios() -> Iterator[FaultScenario]:
    """Yield the seven kinds for each signal."""
    for name, signal in SIGNALS.items():
        for kind in DisturbanceKind:
            undo: list[Callable[[], None]] = []
            begin = (
                _of_frames(signal, kind, undo)
                if isinstance(signal, FrameSignal)
                else _of_topic(signal, kind, undo)
            )
            yield FaultScenario(
                f"{name}_{kind.value}",
                begin,
                "",
                end=_ending(undo),
                lasts=_LASTS,
                rest=2.0,
                harms_tension=True,
                tolerable=True,
            )


def _ending(undo: list[Callable[[], None]]) -> Callable[[RobotLoop], None]:
    def end(loop: RobotLoop) -> None:
        for act in undo:
            act()
        undo.clear()

    return end


def _of_frames(
    signal: FrameSignal, kind: DisturbanceKind, undo: list[Callable[[], None]]
) -> Callable[[RobotLoop], None]:
    def begin(loop: RobotLoop) -> None:
        disturbance: Disturbance[bytes] = Disturbance(
            kind,
            lambda data, generator: generator.bytes(len(data)),
            signal.falsified,
            lambda old, new: old,
            np.random.default_rng(_SEED),
        )
        undo.append(loop.machine.disturb(*signal.cob_id(loop.machine.config), disturbance))

    return begin


def _of_topic(
    topic: Topic, kind: DisturbanceKind, undo: list[Callable[[], None]]
) -> Callable[[RobotLoop], None]:
    def begin(loop: RobotLoop) -> None:
        codec = topic_codec(topic, loop.robot.number_of_cables)

        def garbled(sample: Any, generator: np.random.Generator) -> Any:
            message = codec.encode(sample)
            try:
                return codec.decode(message[:_HEADER] + generator.bytes(len(message) - _HEADER))
            except MessageError as error:
                loop.refuse(topic, str(error))
                return None

        def make() -> Disturbance[Any]:
            return Disturbance(
                kind,
                garbled,
                _falsified,
                lambda old, new: old._replace(stamp_ns=new.stamp_ns),
                np.random.default_rng(_SEED),
            )

        undo.append(loop.disturb(topic, make))

    return begin


def _falsified(sample: Any) -> Any:
    """Return a sample with a wrong value in each of its quantities, or a wrong stamp where it has none."""
    changed: dict[str, object] = {}
    for name, value in sample._asdict().items():
        if isinstance(value, np.ndarray) and value.size > PLACE and "quaternion" not in name:
            changed[name] = value.copy()
            changed[name][PLACE] = 1.1 * value[PLACE] + 0.1  # type: ignore[index]
        elif isinstance(value, float) and name != "time_from_start":
            changed[name] = 1.1 * value + 0.1
    return sample._replace(**changed or {"stamp_ns": sample.stamp_ns + _AHEAD_NS})
