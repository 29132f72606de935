"""What the drivers' nodes say about themselves, as diagnostic statuses."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from cspr_drivers.bus.can_bus import CanPort
from cspr_drivers.canopen.emergency import ActiveErrors
from cspr_drivers.cycle.cycle_watch import AnswerCounts
from cspr_drivers.devices.device import in_words
from cspr_drivers.drives.report import DriveReport
from cspr_drivers.drives.status import DriveStatus
from cspr_drivers.load_cells.master import NO_SYNC, LoadCellReport
from cspr_msgs_py.vocabulary import DriverState, Level
from cspr_msgs_py.wire.samples import Status

_LEVELS = {
    DriverState.FAULT: Level.ERROR,
    DriverState.HELD_BY_DRIVES: Level.ERROR,
    DriverState.NOT_READY: Level.WARN,
}


def drive_states(report: DriveReport) -> list[Status]:
    """Return the statuses of /drive_states: the drives as a whole, then each one."""
    overall = {
        "cause": report.cause,
        "enabled": ", ".join(report.members),
        "configuration": report.configuration,
    }
    level = _LEVELS.get(report.state, Level.OK)
    statuses = [Status.of("can_drives", level, report.state.value, overall)]
    for drive, age in zip(report.drives, report.feedback_ages, strict=True):
        level = _level(drive)
        values = {
            "brake": "unknown" if drive.state is None else "open" if drive.brake_open else "closed",
            "error_code": f"0x{drive.error_code:04X}",
            "errors": "; ".join(error.text for error in drive.errors),
            "remedy": drive.errors[-1].remedy if drive.errors else "",
            "statusword": f"0x{drive.status_word:04X}",
            "emergency_stop": "active" if drive.emergency_stop else "",
            "slipped_rad": f"{drive.slipped:+.1f}" if drive.slipped else "",
            "feedback_age_ms": _milliseconds(age),
            "unavailable": drive.unavailable,
        }
        statuses.append(Status.of(drive.name, level, drive.state_name, values))
    return statuses


def _level(drive: DriveStatus) -> Level:
    if drive.unavailable or drive.slipped:
        return Level.ERROR
    return Level.WARN if drive.errors else Level.OK


def _milliseconds(age: float) -> str:
    """Return an age as text for diagnostics; empty before the first frame."""
    return f"{1e3 * age:.1f}" if math.isfinite(age) else ""


def drive_diagnostics(report: DriveReport) -> list[Status]:
    """Return the health of the driver of the drives, then that of each drive."""
    statuses = [_driver_diagnostics(report)]
    for place, (drive, facts) in enumerate(zip(report.drives, report.facts, strict=True)):
        values = {
            **_answers_and_errors(report.statistics.answers[place], drive.errors),
            "feedback_age_ms": _milliseconds(report.feedback_ages[place]),
            "heartbeat_age_ms": _milliseconds(report.heartbeat_ages[place]),
            "nmt_state": report.nmt_states[place],
        }
        if facts is not None:
            values["written_settings"] = facts.written
            if facts.rated_current is not None:
                values["rated_current_a"] = f"{facts.rated_current:g}"
        level = _level(drive)
        message = drive.unavailable or drive.state_name
        statuses.append(Status.of(f"can_drives: {drive.name}", level, message, values))
    return statuses


def _answers_and_errors(counts: AnswerCounts, errors: ActiveErrors) -> dict[str, object]:
    return {
        "answered": counts.answered,
        "late": counts.late,
        "missing": counts.missing,
        "errors": "; ".join(map(str, errors)),
        "remedy": "; ".join(error.remedy for error in errors),
    }


def _driver_diagnostics(report: DriveReport) -> Status:
    """Return the health of the driver of the drives."""
    statistics = report.statistics
    values = {
        "cause": report.cause,
        "not_configured": "; ".join(f"{name}: {why}" for name, why in report.not_configured.items()),
        "cycles": statistics.cycles,
        "missed_cycles": statistics.missed_cycles,
        "incomplete_cycles": statistics.incomplete_cycles,
        "late_commands": statistics.late_commands,
        "repeated_feedback": statistics.repeated_feedback,
        "late_feedback": statistics.late_feedback,
        "command_latency_p50_us": round(1e6 * statistics.latency.p50),
        "command_latency_p99_us": round(1e6 * statistics.latency.p99),
        "command_latency_max_us": round(1e6 * statistics.latency.maximum),
        "rejected_commands": report.rejected_commands,
        "last_rejection": report.last_rejection,
        "skipped_sync": report.skipped_cycles,
        "worst_sync_lateness_us": round(1e6 * report.worst_lateness),
        "time_set_by_s": round(report.time_set_by, 3),
        "last_winding": report.last_winding,
        "brake_proof": report.brake_proof,
    }
    if not report.clock_running:
        return Status.of("can_drives", Level.ERROR, "no SYNC is sent", values)
    message = report.state.value + (f": {report.cause}" if report.cause else "")
    return Status.of("can_drives", _LEVELS.get(report.state, Level.OK), message, values)


def load_cell_states(names: Sequence[str], problems: Mapping[str, str]) -> list[Status]:
    """Return the statuses of /load_cell_states: the load cells as a whole, then each one."""
    cause = in_words(problems)
    level = Level.ERROR if problems else Level.OK
    return [
        Status.of("load_cells", level, "fault" if problems else "ok", {"cause": cause}),
        *(
            Status.of(name, Level.ERROR if name in problems else Level.OK, problems.get(name, "ok"), {})
            for name in names
        ),
    ]


def load_cell_diagnostics(names: Sequence[str], report: LoadCellReport) -> list[Status]:
    """Return the health of the driver of the load cells, then that of each cell."""
    statistics = report.statistics
    values = {
        "not_configured": "; ".join(f"{name}: {why}" for name, why in report.not_configured.items()),
        "cycles": statistics.cycles,
        "incomplete_cycles": statistics.incomplete_cycles,
        "tare": report.tare_result,
        **{f"missing_{name}": count for name, count in statistics.missing.items()},
    }
    if report.not_configured:
        problem = "not configured: " + ", ".join(report.not_configured)
    elif report.sync_age is None or report.sync_age > NO_SYNC:
        problem = "no SYNC on the bus: is can_drives running?"
    else:
        problem = "; ".join(f"{name} {why}" for name, why in (statistics.problems | report.problems).items())
    statuses = [Status.of("load_cells", Level.ERROR if problem else Level.OK, problem or "ok", values)]
    for name, counts, errors in zip(names, statistics.answers, report.errors, strict=True):
        words = report.problems.get(name, "")
        level = Level.ERROR if words else Level.OK
        values = _answers_and_errors(counts, errors)
        statuses.append(Status.of(f"load_cells: {name}", level, words or "ok", values))
    return statuses


def bus_status(node: str, port: CanPort) -> Status:
    """Return the health of a bus as one node sees it."""
    counts = {
        "unknown_frames": port.unknown_frames,
        "malformed_frames": port.malformed_frames,
        "send_errors": port.send_errors,
        "send_retries": port.send_retries,
        "dropped_frames": port.dropped_frames,
        "bus_errors": port.bus_errors,
    }
    level = Level.WARN if any(counts.values()) else Level.OK
    if port.receive_buffer is not None:
        counts["receive_buffer_bytes"] = port.receive_buffer
    return Status.of(f"{node}: bus {port.name}", level, port.last_problem or "ok", counts)
