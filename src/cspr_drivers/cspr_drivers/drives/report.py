"""What the driver of the drives publishes: motor states each cycle, and its own state on request."""

from __future__ import annotations

from dataclasses import dataclass

from cspr_drivers.cycle.cycle_watch import CycleStatistics
from cspr_drivers.devices.setup import DriveFacts
from cspr_drivers.drives.status import DriveStatus
from cspr_msgs_py.vocabulary import DriverState


@dataclass(frozen=True)
class MotorStates:
    """What all drives reported in one cycle: stamp in ns of ROS time; rad, rad/s, N m, each (m,)."""

    stamp_ns: int
    angles: tuple[float, ...]
    speeds: tuple[float, ...]
    torques: tuple[float, ...]


@dataclass(frozen=True)
class DriveReport:
    """State of the driver at one moment.

    Attributes
    ----------
    state, cause, drives
        Of the group of drives.
    members
        Names of the drives that are in operation, or on the way there.
    feedback_ages
        Time since the last frame of each drive, s; infinite before the first.
    heartbeat_ages, nmt_states
        Of each drive: time since its last heartbeat, s, and the NMT state in it.
    facts
        What each drive has said about itself, `None` before it was set up.
    not_configured
        Devices that are not configured, with the reason.
    statistics
        Of the cycles since the drives were last enabled, while they are.
    rejected_commands, last_rejection
        Commands that were not passed on, and the newest of them in words.
    skipped_cycles, worst_lateness
        Of the clock, since the drives were last enabled: SYNC frames left out, and the largest delay of one, s.
    clock_running
        Whether SYNC frames are being sent.
    time_set_by
        How far somebody has set the computer's time of day since the process began, s.
    last_winding
        What came of the last winding of a single winch, in words.
    configuration
        Stands for the configuration of drives and load cells, the home pose included: another one has another.
    brake_proof
        What came of the last test of the brakes, or why there is none, in words.
    """

    state: DriverState
    cause: str
    drives: tuple[DriveStatus, ...]
    members: tuple[str, ...]
    feedback_ages: tuple[float, ...]
    heartbeat_ages: tuple[float, ...]
    nmt_states: tuple[str, ...]
    facts: tuple[DriveFacts | None, ...]
    not_configured: dict[str, str]
    statistics: CycleStatistics
    rejected_commands: int
    last_rejection: str
    skipped_cycles: int
    worst_lateness: float
    clock_running: bool
    time_set_by: float
    last_winding: str
    configuration: str
    brake_proof: str
