"""What becomes of a load cell that is wrong."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from studies.experiment import BARE

from benchmarks.platform_rows import Row
from cspr_control.analysis.numbers.platform_error import platform_error
from cspr_control.analysis.recording import recording_of
from cspr_control.closed_loop.run import run
from cspr_control.closed_loop.scenario import PlannedFault
from cspr_msgs_py.topics import LOAD_CELL_CHECK, PAYLOAD, ROBOT_STATE
from cspr_msgs_py.vocabulary import CellCheck, RobotState, TrajectoryName

CELLS = (1, 4, 6)
_FAULT = 4.5  # s after the start of the trajectory
_LAST = 7.0  # s of the trajectory that are run
_ON_PATH = 5e-3  # m; a quick stop leaves the path by centimetres


class _Outcome(NamedTuple):
    """What became of a fault: times in s after it, errors in kg and m."""

    found: float
    cell: str
    mass_error: float
    controlled: bool
    off_path: float


def cell_fault(name: str, fault: str, limit: float) -> list[Row]:
    """Let one load cell fail in the middle of smooth-19, each of `CELLS` in turn; found within a limit, s."""
    outcomes = [_outcome(fault, cell) for cell in CELLS]
    named = [outcome.cell == f"cable_{cell}" for outcome, cell in zip(outcomes, CELLS, strict=True)]
    at_rest = [outcome.controlled and outcome.off_path <= _ON_PATH for outcome in outcomes]

    def each(numbers: list[float], unit: str) -> str:
        return "; ".join(
            f"cell {cell} {number:.3g} {unit}" for cell, number in zip(CELLS, numbers, strict=True)
        )

    found, errors = [outcome.found for outcome in outcomes], [outcome.mass_error for outcome in outcomes]
    off_path = [1e3 * outcome.off_path for outcome in outcomes]
    blamed = ", ".join(outcome.cell or "none" for outcome in outcomes)
    return [
        Row(name, "found after, the latest", max(found), limit, "s", note=each(found, "s")),
        Row(name, f"right cell, of {len(CELLS)}", sum(named), len(CELLS), "", True, blamed),
        Row(name, "mass error with seven cells", float(np.max(errors)), 1.0, "kg", note=each(errors, "kg")),
        Row(
            name, "at rest along the path", sum(at_rest), len(CELLS), "", True, f"off: {each(off_path, 'mm')}"
        ),
    ]


def _outcome(fault: str, cell: int) -> _Outcome:
    planned = (PlannedFault(f"{fault} cable_{cell}", _FAULT),)
    scenario = replace(BARE, trajectory=TrajectoryName.SMOOTH_19, faults=planned, duration=_LAST)
    record = run(scenario, keep=True)
    assert record.published is not None
    recording = recording_of(record.published)
    checks = record.published.read(LOAD_CELL_CHECK.name)
    excluded = [
        (float(time), message.values)
        for time, message in zip(recording.seconds(checks.log_time_ns), checks.messages, strict=True)
        if message.message == CellCheck.EXCLUDED
    ]
    found, values = excluded[0] if excluded else (math.inf, [])
    estimate = record.published.inertias(PAYLOAD.name)
    after = (
        recording.seconds(estimate.time_ns) > found
    )  # until then it is held: what is published is that of before
    true = record.mass_true[-1]
    mass_error = float(np.abs(estimate.mass[after] - true).max()) if after.any() else math.nan

    states = record.published.read(ROBOT_STATE.name)
    followed = [message.message for message in states.messages]
    controlled = bool(record.cause) and RobotState.STOPPING in followed
    controlled = controlled and followed[-1] == RobotState.FAULT
    error = platform_error(recording)
    assert error is not None  # the plant tells its true pose
    late = recording.seconds(error.time_ns) > _FAULT
    named = "".join(value.value for value in values if value.key == "cell")
    return _Outcome(found - _FAULT, named, mass_error, controlled, float(error.distance[late].max()))
