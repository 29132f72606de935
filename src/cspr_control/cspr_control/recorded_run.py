"""The summary of a run from its bag."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from cspr_control.errors import ControlError
from cspr_control.run_summary import (
    CycleStatistics,
    MassTrace,
    MotorTrace,
    RunSummary,
    position_errors,
    settling_time,
)
from cspr_msgs_py.bag_reader import Bag, Inertias, JointStates
from cspr_msgs_py.errors import BagError
from cspr_msgs_py.topics import MOTOR_STATES, PAYLOAD, SETPOINT, SIMULATED_PAYLOAD


def summarise_run(
    bag_path: Path,
    *,
    window_ns: tuple[int, int],
    controller: str,
    exact_mass: bool,
    trajectory: str,
    driver: Mapping[str, str],
) -> RunSummary:
    """Read a recorded run and summarise what happened between two times.

    Parameters
    ----------
    bag_path
        Directory of the bag.
    window_ns
        ROS times at which the trajectory began and ended, ns.
    controller, exact_mass, trajectory
        What was run.
    driver
        Last diagnostics of can_drives in the run: what it counted while the drives were enabled.

    Raises
    ------
    ControlError
        If the bag cannot be read or lacks what the summary needs.
    """
    try:
        with Bag(bag_path) as bag:
            recorded_states = bag.joint_states(MOTOR_STATES.name)
            states = _motor_trace(recorded_states)
            setpoints = _motor_trace(bag.joint_states(SETPOINT.name))
            estimate = _mass_trace(bag.inertias(PAYLOAD.name), recorded_states, window_ns)
            truth = _mass_trace(bag.inertias(SIMULATED_PAYLOAD.name), recorded_states, window_ns)
    except BagError as problem:
        raise ControlError(f"the recording cannot be summarised: {problem}") from problem
    _, error = position_errors(states, setpoints, window_ns)
    degrees = np.degrees(error)
    return RunSummary(
        controller=controller,
        exact_mass=exact_mass,
        trajectory=trajectory,
        rms_position_error_deg=tuple(np.sqrt((degrees**2).mean(axis=0)).tolist()),
        max_position_error_deg=tuple(np.abs(degrees).max(axis=0).tolist()),
        mass_true_final_kg=float(truth.mass[-1]),
        mass_estimate_final_kg=float(estimate.mass[-1]),
        mass_settling_time_s=settling_time(estimate, truth),
        cycle=_cycle_statistics(states, window_ns, driver),
        bag=str(bag_path),
    )


def _motor_trace(states: JointStates) -> MotorTrace:
    order = np.argsort(states.time_ns, kind="stable")
    return MotorTrace(states.time_ns[order], states.position[order], states.velocity[order])


def _mass_trace(inertias: Inertias, states: JointStates, window_ns: tuple[int, int]) -> MassTrace:
    # The estimate keeps the stamp of its newest measurement while it is held: what counts is when it was there, on
    # the clock of the machine, which may be slower than the recorder's.
    arrivals = np.interp(inertias.log_time_ns, states.log_time_ns, states.time_ns).astype(np.int64)
    inside = (arrivals >= window_ns[0]) & (arrivals <= window_ns[1])
    if not inside.any():
        raise ControlError("the recording holds no payload between the start and the end of the trajectory")
    return MassTrace(arrivals[inside], inertias.mass[inside])


def _cycle_statistics(
    states: MotorTrace, window_ns: tuple[int, int], driver: Mapping[str, str]
) -> CycleStatistics:
    stamps = states.stamp_ns[(states.stamp_ns >= window_ns[0]) & (states.stamp_ns <= window_ns[1])]
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
