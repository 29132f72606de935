"""The summary of a run of the demo from its recording."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.analysis.numbers.mass import mass_trace
from cspr_control.analysis.numbers.motor_errors import motor_errors
from cspr_control.analysis.numbers.run_summary import CycleStatistics, MassTrace, RunSummary, settling_time
from cspr_control.analysis.recording import Recording
from cspr_control.errors import ControlError
from cspr_msgs_py.bag.reader import Inertias
from cspr_msgs_py.topics import PAYLOAD, SETPOINT, SIMULATED_PAYLOAD


def summarise_run(
    recording: Recording, *, controller: str, exact_mass: bool, trajectory: str, driver: Mapping[str, str]
) -> RunSummary:
    """Summarise what happened while the trajectory was followed.

    Parameters
    ----------
    recording
        The run.
    controller, exact_mass, trajectory
        What was run.
    driver
        Last diagnostics of can_drives in the run: what it counted while the drives were enabled.

    Raises
    ------
    ControlError
        If the recording lacks what the summary needs.
    """
    if not recording.trajectories:
        raise ControlError(
            f"{recording.path} has no trajectory that was followed: there is nothing to summarise"
        )
    if recording.setpoints is None:
        raise ControlError(
            f"{recording.path} has no messages on {SETPOINT.name}: there is nothing to summarise"
        )
    errors = motor_errors(recording.states, recording.setpoints)
    judged = errors.part(recording.judged(errors.time_ns))
    if judged.time_ns.size == 0:
        raise ControlError(
            f"{recording.path} has no set-points on the trajectory: there is nothing to summarise"
        )
    position = ErrorStatistics.of(np.degrees(judged.position))
    estimate = _mass(recording, recording.estimate, PAYLOAD.name)
    truth = _mass(recording, recording.truth, SIMULATED_PAYLOAD.name)
    return RunSummary(
        controller=controller,
        exact_mass=exact_mass,
        trajectory=trajectory,
        rms_position_error_deg=tuple(position.rms.tolist()),
        max_position_error_deg=tuple(position.maximum.tolist()),
        mass_true_final_kg=float(truth.mass[-1]),
        mass_estimate_final_kg=float(estimate.mass[-1]),
        mass_settling_time_s=settling_time(estimate, truth),
        cycle=_cycle_statistics(recording, driver),
        bag=str(recording.path),
    )


def _mass(recording: Recording, payload: Inertias | None, topic: str) -> MassTrace:
    trace = None if payload is None else mass_trace(recording, payload)
    if trace is None or trace.mass.size == 0:
        raise ControlError(
            f"{recording.path} has no messages on {topic} between the start and the end of the trajectory"
        )
    return trace


def _cycle_statistics(recording: Recording, driver: Mapping[str, str]) -> CycleStatistics:
    stamps = recording.states.time_ns[recording.judged(recording.states.time_ns)]
    try:
        return CycleStatistics(
            rate_hz=float((stamps.size - 1) / ((stamps[-1] - stamps[0]) * 1e-9)),
            # a SYNC that was left out is a cycle that was missed as well
            cycles=int(driver["cycles"]) + int(driver["skipped_sync"]),
            missed_cycles=int(driver["missed_cycles"]) + int(driver["skipped_sync"]),
            latency_p50_us=float(driver["command_latency_p50_us"]),
            latency_p99_us=float(driver["command_latency_p99_us"]),
            latency_max_us=float(driver["command_latency_max_us"]),
        )
    except (KeyError, ValueError) as error:
        raise ControlError(f"the diagnostics of can_drives lack a count of cycles: {error}") from error
