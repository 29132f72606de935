"""Limits in time that the drivers and the devices watch over."""

from __future__ import annotations

from dataclasses import dataclass

from cspr_drivers.config.config_section import ConfigSection


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

    command: float
    feedback: float
    rpdo: float
    heartbeat_producer: float
    heartbeat_consumer: float
    sdo: float
    transition: float
    enable: float
    stop: float


def read_timeouts(section: ConfigSection) -> Timeouts:
    """Return the section ``timeouts``.

    Raises
    ------
    ConfigurationError
        If a time is missing, not positive, or longer than CANopen can count.
    """
    # CANopen counts these times in milliseconds in 16 bits.
    timeouts = Timeouts(
        command=section.number("command", minimum=0.001),
        feedback=section.number("feedback", minimum=0.001),
        rpdo=section.number("rpdo", minimum=0.001),
        heartbeat_producer=section.number("heartbeat_producer", minimum=0.001),
        heartbeat_consumer=section.number("heartbeat_consumer", minimum=0.001),
        sdo=section.number("sdo", minimum=0.001),
        transition=section.number("transition", minimum=0.001),
        enable=section.number("enable", minimum=0.001),
        stop=section.number("stop", minimum=0.001),
    )
    for name in ("rpdo", "heartbeat_producer", "heartbeat_consumer"):
        if getattr(timeouts, name) > 65.535:
            raise section.error(name, "must be at most 65.535")
    if timeouts.heartbeat_consumer <= timeouts.heartbeat_producer:
        raise section.error("heartbeat_consumer", "must be greater than heartbeat_producer")
    section.finish()
    return timeouts
