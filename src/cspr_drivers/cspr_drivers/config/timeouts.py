"""Limits in time that the drivers and the devices watch over."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from msgspec import Meta

_Time = Annotated[float, Meta(ge=0.001)]
_Wait = Annotated[float, Meta(ge=0.001, le=60.0)]  # nothing moves meanwhile, but a person waits to be told
_CountedTime = Annotated[float, Meta(ge=0.001, le=65.535)]  # CANopen counts it in milliseconds in 16 bits


@dataclass(frozen=True)
class Timeouts:
    """Limits in time, s. What the first five may be at most follows from the height that they cost: `height_cost`.

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
    supervisor
        Absence of the supervisor's sign of life at which the driver stops drives that are enabled together.
    enable, stop
        Longest duration of releasing, and of closing, all brakes; and those of one drive.
    """

    command: _Time
    feedback: _Time
    rpdo: _CountedTime
    heartbeat_producer: _CountedTime
    heartbeat_consumer: _CountedTime
    sdo: _Wait
    transition: _Wait
    enable: _Wait
    stop: _Wait
    supervisor: Annotated[float, Meta(ge=0.04, le=1.0)] = 0.15
