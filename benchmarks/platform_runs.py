"""The closed loops behind the table of the platform; each returns its rows."""

from __future__ import annotations

import math
import re
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from studies.experiment import BARE

from benchmarks.platform_rows import Row
from cspr_control.analysis.numbers.platform_error import PoseDeviation, platform_error, platform_metrics
from cspr_control.analysis.recording import Recording, recording_of
from cspr_control.calibration.pulley_radius import identify_pulley_radius
from cspr_control.calibration.samples import calibration_samples
from cspr_control.closed_loop.record import LoopRecord
from cspr_control.closed_loop.run import run
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.parameters.control_settings import control_settings, robot_file
from cspr_control.stability.loop_configuration import LoopConfiguration
from cspr_control.stability.scan import LARGEST_GAIN, MOST_LATE, REFUSED_LATE, TIME_CONSTANTS, LoopScan
from cspr_control.stability.verdict import WARNED_GAIN_MARGIN
from cspr_kinematics import Pulleys, Robot
from cspr_msgs_py.parameters.table import defaults
from cspr_msgs_py.topics import CABLE_TENSIONS, DIAGNOSTICS, PAYLOAD
from cspr_msgs_py.vocabulary import Controller, Level, TrajectoryName

SMOOTH = replace(BARE, trajectory=TrajectoryName.SMOOTH_19)
PAPER = replace(BARE, trajectory=TrajectoryName.PAPER_19)
_ESTIMATOR = defaults("mass_estimator")
_RADIUS = 0.05  # m, of pulleys that nobody configured
_CHANGE = 3.0  # s after the start of the trajectory, when the payload changes


def _exact(scenario: Scenario) -> Scenario:
    """Return the scenario with the true mass in the feed-forward."""
    return replace(scenario, controller=Controller.PDFF, exact_mass=True)


def _analysed(scenario: Scenario) -> tuple[LoopRecord, Recording]:
    record = run(scenario, keep=True)
    assert record.published is not None
    return record, recording_of(record.published)


def _error(recording: Recording) -> PoseDeviation:
    """Return how far the true pose is from the reference."""
    metrics = platform_metrics(recording, platform_error(recording))
    assert metrics is not None
    assert metrics.error is not None  # the plant tells its true pose
    return metrics.error


def stretch(name: str, believed: float, aim: float) -> list[Row]:
    """Follow smooth-19 with 200 kg while the cables' stiffness is believed to be a multiple of the true one."""
    with tempfile.TemporaryDirectory() as directory:
        config = Path(directory) / "config"
        shutil.copytree(BARE.config, config)
        file = config / "robot.yaml"
        text, found = re.subn(
            r"(axial_stiffness: )([\d.e+]+)",
            lambda match: f"{match[1]}{believed * float(match[2]):.6e}",
            file.read_text(encoding="utf-8"),
        )
        assert found == 1, f"{file} does not have one axial_stiffness"
        file.write_text(text, encoding="utf-8")
        _, recording = _analysed(replace(SMOOTH, config=config, payload=200.0, added=()))
    error = _error(recording)
    note = f"at most {error.max_mm:.2f} mm, {error.rotation_rms_deg:.3f} deg RMS"
    return [Row(name, "platform, true error RMS", error.rms_mm, aim, "mm", note=note)]


def smooth_step(name: str) -> list[Row]:
    """Follow smooth-19 with the estimated mass, and with the true one."""
    estimated, exact = run(SMOOTH), run(_exact(SMOOTH))
    return [
        Row(name, "motors, mean RMS, estimated mass", _motors(estimated), 0.85, "deg"),
        Row(name, "motors, mean RMS, exact mass", _motors(exact), 0.70, "deg"),
        Row(name, "mass settles to 2 % for good after", estimated.settling_time, 0.2, "s"),
    ]


def strokes(name: str) -> list[Row]:
    """Go up and down all the time."""
    record = run(replace(BARE, trajectory=TrajectoryName.STROKES_Z))
    before = record.time < _CHANGE
    error = float(np.abs(record.mass_estimate - record.mass_true)[before].max())
    return [
        Row(name, "mass settles to 2 % for good after", record.settling_time, 0.2, "s"),
        Row(name, "largest mass error before the change", error, 1.5, "kg"),
    ]


def growing_load(name: str) -> list[Row]:
    """Let the payload come aboard as one that is lifted off a table does."""
    duration = 0.5
    record = run(replace(SMOOTH, growth=duration))
    outside = np.abs(record.mass_estimate - record.mass_true[-1]) > 0.02 * record.mass_true[-1]
    settled = float(record.time[np.flatnonzero(outside)[-1] + 1]) if not outside[-1] else math.inf
    late = max(0.0, settled - _CHANGE - duration)
    return [Row(name, "mass settles to 2 % for good, from its end", late, 0.1, "s")]


def jumps(name: str) -> list[Row]:
    """Follow the printed trajectory, whose jumps of velocity slacken cables."""
    estimated, recording = _analysed(PAPER)
    ratio = _motors(estimated) / _motors(run(_exact(PAPER)))
    assert estimated.published is not None
    tensions = estimated.published.joint_states(CABLE_TENSIONS.name)
    payload = estimated.published.inertias(PAYLOAD.name)
    time, now = recording.seconds(tensions.log_time_ns), recording.seconds(payload.log_time_ns)
    slack = time[(tensions.effort < _ESTIMATOR["slack_tension"]).any(axis=1) & (time > 0.0) & (time < 12.0)]
    held = np.zeros(now.shape, dtype=bool)
    changed = 0.0
    for moment in slack:
        since = (now >= moment - 1e-6) & (now < moment + _ESTIMATOR["slack_hold"] - 1e-6)
        held |= since
        changed = max(changed, float(np.ptp(payload.mass[since])))
    largest = float(np.abs(payload.mass[held] - estimated.mass_true[-1]).max()) if slack.size else math.nan
    note = f"{slack.size} cycles with slack cables; error at most {largest:.2g} kg meanwhile"
    return [
        Row(name, "motors, RMS with estimated over exact mass", ratio, 1.002),
        Row(
            name, "mass changes up to 0.3 s after slack by", changed if slack.size else math.nan, 0.0, "kg",
            note=note,
        ),
    ]  # fmt: skip


def noise_at_rest(name: str) -> list[Row]:
    """Hold still."""
    held = {"trajectory_publisher": {"hold_duration": 5.0}}
    record = run(replace(BARE, trajectory=TrajectoryName.HOLD, payload=200.0, added=(), parameters=held))
    bias = f"mean {record.mass_estimate.mean() - 200.0:+.2f} kg"
    return [Row(name, "noise of the mass", float(record.mass_estimate.std()), 0.1, "kg", note=bias)]


def unknown_pulleys(name: str) -> list[Row]:
    """Follow smooth-19 over pulleys, first described in robot.yaml's place, then not."""
    robot = {"/**": {"robot_config": "robot_pulleys.yaml"}}
    radius = Pulleys(_RADIUS)
    _, known = _analysed(replace(SMOOTH, true_pulleys=radius, parameters=robot))
    uncalibrated = {"supervisor": {"length_misfit": 1e-3}}
    record, unknown = _analysed(replace(SMOOTH, true_pulleys=radius, parameters=uncalibrated))
    misfit = []
    for recording in (known, unknown):
        believed = recording.configuration.robot
        found = identify_pulley_radius(believed, calibration_samples(recording, believed), 0.005)
        misfit.append(1e3 * found.misfit_before)
    assert record.published is not None
    warned = [
        f"{status.name}: {status.message}"
        for message in record.published.read(DIAGNOSTICS.name).messages
        for status in message.status
        if status.level >= Level.WARN and "length" in status.message
    ]
    off = 1e3 * abs(found.radius - _RADIUS)
    note = f"{1e3 * found.radius:.2f} mm, standard deviation {1e3 * found.deviation:.2g} mm"
    return [
        Row(name, "misfit of the lengths RMS, known", misfit[0], 0.1, "mm"),
        Row(name, "misfit of the lengths RMS, unknown", misfit[1], 0.5, "mm", True),
        Row(name, "named in diagnostics within the run", len(warned), 1, "", True, "".join(warned[-1:])),
        Row(name, "radius that cspr identify finds, error", off, 2.0, "mm", note=note),
    ]


def stability(name: str) -> list[Row]:
    """Compute the margins of the shipped configuration; nothing is simulated."""
    parameters = BARE.read_parameters()
    robot = Robot.from_yaml(BARE.config / robot_file(parameters))
    loop = LoopConfiguration.of(robot, control_settings(robot, parameters))
    report = LoopScan(loop).report()

    def where(place: object) -> str:
        return f"at {place}" if place is not None else ""

    late, gain, constant = report.late_cycles, report.gain_margin, report.smallest_time_constant
    return [
        Row(name, "decay of the slowest mode", report.decay.value, 0.0, "1/s", True, where(report.decay.place)),
        Row(name, "late cycles until unstable", late.value, REFUSED_LATE + 1, "", True,
            where(late.place) or f"stable with {MOST_LATE}"),
        Row(name, "unstable time constant of the estimate", constant.value, loop.time_constant, "s", False,
            where(constant.place) or f"stable with {TIME_CONSTANTS[-1]:g} s"),
        Row(name, "gain margin through the estimate", gain.value, WARNED_GAIN_MARGIN, "", True,
            where(gain.place) or f"stable with {LARGEST_GAIN:g}"),
    ]  # fmt: skip


def _motors(record: LoopRecord) -> float:
    return float(record.rms_deg.mean())
