"""One analysed run: what figures, report and tables are made of."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.configuration import require_one_robot
from cspr_control.analysis.measured_pose import MeasuredPose, judged_by
from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.analysis.numbers.mass import change_indices
from cspr_control.analysis.numbers.metrics import RunMetrics, run_metrics
from cspr_control.analysis.numbers.motor_errors import MotorErrors, motor_errors
from cspr_control.analysis.numbers.platform_error import platform_error
from cspr_control.analysis.numbers.predicted_tensions import PredictedTensions, predict_tensions
from cspr_control.analysis.pose_track import PoseDifference
from cspr_control.analysis.recording import CONFIGURATION_DIRECTORY, Recording, read_recording
from cspr_control.errors import ControlError
from cspr_kinematics import KinematicsError
from cspr_msgs_py.topics import TRUE_POSE

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RunAnalysis:
    """A recording and what follows from it.

    Attributes
    ----------
    name
        What it is called beside other runs: its controller, if no other run has the same.
    recording : Recording
    platform : PoseDifference or None
        Where the platform was less where it should have been.
    errors : MotorErrors or None
    predicted : PredictedTensions or None
    metrics : RunMetrics
    remarks
        What is missing, odd, or could not be computed.
    """

    name: str
    recording: Recording
    platform: PoseDifference | None
    errors: MotorErrors | None
    predicted: PredictedTensions | None
    metrics: RunMetrics
    remarks: tuple[str, ...]

    @property
    def slug(self) -> str:
        """The name as part of a file's name."""
        return re.sub(r"[^a-z0-9]+", "-", self.name.lower()).strip("-") or "run"

    def load_changes(self) -> dict[float, str]:
        """Return when the true payload changed on a trajectory, s, and how, such as ``+100 kg``."""
        loads = self.loads()
        return {time: f"{mass - before:+g} kg" for (_, before), (time, mass) in pairwise(loads)}

    def loads(self) -> tuple[tuple[float, float], ...]:
        """Return the payloads on the trajectories: since when, s, and how much, kg.

        The true ones; without them the estimate at the end, if there is one.
        """
        recording = self.recording
        payload = recording.truth if recording.truth is not None else recording.estimate
        if payload is None:
            return ()
        counted = recording.in_window(payload.log_time_ns)
        time, mass = recording.seconds(payload.log_time_ns[counted]), payload.mass[counted]
        if mass.size == 0:
            return ()
        if recording.truth is None:
            return ((float(time[0]), float(np.round(mass[-1]))),)
        places = [0, *change_indices(mass).tolist()]
        return tuple((float(time[k]), float(mass[k])) for k in places)

    def load_text(self) -> str:
        """Return the payloads in words, such as ``100, then 200 kg``."""
        loads = [f"{mass:g}" for _, mass in self.loads()]
        return f"{', then '.join(loads)} kg" if loads else "unknown payload"

    def model_deviation(self) -> ErrorStatistics | None:
        """Return the size of the models' deviation on the trajectories, N; None if they predict nothing there."""
        if self.predicted is None:
            return None
        counted = self.recording.in_window(self.predicted.time_ns)
        return ErrorStatistics.of(self.predicted.deviation[counted]) if counted.any() else None

    def errors_by_load(self) -> dict[float, Floats]:
        """Return the RMS position error (m,) of the motors, degrees, for each payload in kg."""
        loads = self.loads()
        if self.errors is None or not loads:
            return {}
        counted = self.errors.part(self.recording.in_window(self.errors.time_ns))
        time = self.recording.seconds(counted.time_ns)
        ends = [*(since for since, _ in loads[1:]), np.inf]
        parts: dict[float, list[NDArray[np.bool_]]] = {}
        for index, ((since, mass), end) in enumerate(zip(loads, ends, strict=True)):
            begin = -np.inf if index == 0 else since
            parts.setdefault(mass, []).append((time >= begin) & (time < end))
        result = {}
        for mass, masks in parts.items():
            chosen = np.logical_or.reduce(masks)
            if chosen.any():
                result[mass] = ErrorStatistics.of(np.degrees(counted.position[chosen])).rms
        return result


def analyse_recording(recording: Recording, name: str | None = None) -> RunAnalysis:
    """Compute what follows from a recording; what cannot be computed becomes a remark."""
    remarks = list(recording.remarks)
    if recording.actual is None:
        remarks.append(
            f"{recording.path} has no messages on {TRUE_POSE.name}: how far the platform was from where it should be "
            "is not known (analyze --measured-pose names what measured it)"
        )
    platform = platform_error(recording)
    errors = predicted = None
    if recording.setpoints is not None:
        try:
            errors = motor_errors(recording.states, recording.setpoints)
        except ControlError as problem:
            remarks.append(f"{recording.path}: {problem}")
    if recording.references is not None:
        payload = recording.truth if recording.truth is not None else recording.estimate
        try:
            predicted = predict_tensions(recording.robot, recording.references, payload)
        except KinematicsError as problem:
            remarks.append(f"{recording.path}: no tensions of the model: {problem}")
    if not recording.trajectories:
        remarks.append(f"{recording.path} has no trajectory: the numbers cover the whole recording")
    metrics = run_metrics(recording, platform, errors, predicted)
    return RunAnalysis(
        name or recording.controller, recording, platform, errors, predicted, metrics, tuple(remarks)
    )


def analyse_bags(
    paths: Sequence[Path],
    labels: Sequence[str] = (),
    robot_file: Path | None = None,
    configuration_directory: Path = CONFIGURATION_DIRECTORY,
    measured: MeasuredPose | None = None,
) -> tuple[RunAnalysis, ...]:
    """Read and analyse bags of one robot.

    Parameters
    ----------
    paths
        Bags, or directories of runs.
    labels
        Names of the runs; by default their controllers, with the run's directory where these are not different.
    robot_file, configuration_directory
        As for `read_recording`.
    measured
        What measured the platform's pose, in place of the true one.

    Raises
    ------
    ControlError
        If a bag cannot be analysed, or the bags are of different robots.
    """
    recordings = [read_recording(path, robot_file, configuration_directory) for path in paths]
    if measured is not None:
        recordings = [judged_by(recording, measured) for recording in recordings]
    names = list(labels) or _names(recordings)
    if len(set(names)) != len(names):
        raise ControlError(f"two runs have the same label: {', '.join(names)}; give each its own")
    remarks = require_one_robot({f"{r.path}": r.configuration for r in recordings})
    first, *others = map(analyse_recording, recordings, names)
    return replace(first, remarks=(*first.remarks, *remarks)), *others


def _names(recordings: Sequence[Recording]) -> list[str]:
    controllers = [recording.controller for recording in recordings]
    names = []
    for recording, controller in zip(recordings, controllers, strict=True):
        directory = recording.path.resolve()
        run = directory.parent.name if directory.name == "bag" else directory.stem
        names.append(controller if controllers.count(controller) == 1 else f"{controller} {run}")
    for index, name in enumerate(names):  # the same bag twice
        if names.index(name) != index:
            names[index] = f"{name} ({index + 1})"
    return names
