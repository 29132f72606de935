"""Limits in time that the drivers and the devices watch over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

_Time = Annotated[float, Meta(ge=0.001)]
_CountedTime = Annotated[float, Meta(ge=0.001, le=65.535)]  # CANopen counts it in milliseconds in 16 bits


@dataclass(frozen=True)
class Timeouts:
    """Limits in time, s.

    Attributes
    ----------
    command
        Age of a torque command at which the driver stops the drives.
    feedback
        Silence of a drive at which the driver stops the others.
    rpdo
        Silence of the driver at which a drive stops by itself (event timer of its RPDO).
    heartbeat_producer, heartbeat_consumer
        Period of every node's heartbeat, and its absence that counts as loss of the node.
    sdo
        Longest wait for the answer to one SDO request.
    transition
        Longest duration of a transition of one drive that moves no brake.
    enable, stop
        Longest duration of releasing, and of closing, all brakes; and those of one drive.
    """

    command: _Time
    feedback: _Time
    rpdo: _CountedTime
    heartbeat_producer: _CountedTime
    heartbeat_consumer: _CountedTime
    sdo: _Time
    transition: _Time
    enable: _Time
    stop: _Time
