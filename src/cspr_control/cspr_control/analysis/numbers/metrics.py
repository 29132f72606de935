"""The numbers of a recorded run."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_control.analysis.numbers.cycles import CycleMetrics, cycle_metrics
from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.analysis.numbers.mass import MassMetrics, recorded_mass
from cspr_control.analysis.numbers.motor_errors import MotorErrors
from cspr_control.analysis.numbers.platform_error import PlatformMetrics, platform_metrics
from cspr_control.analysis.numbers.predicted_tensions import PredictedTensions
from cspr_control.analysis.pose_track import PoseDifference
from cspr_control.analysis.recording import Recording, Window
from cspr_msgs_py.json_file import plain

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Margin:
    """How near a quantity came to its limit, and where.

    Attributes
    ----------
    margin
        Least distance to the limit in the unit of the quantity; negative beyond it.
    limit
        The limit.
    index
        Number of the motor or cable, counted from 1; 0 where it is neither.
    time
        When, s.
    """

    margin: float
    limit: float
    index: int
    time: float


@dataclass(frozen=True, eq=False)
class Saturation:
    """How often each motor's command was at its torque limit: number of commands (m,), and their share (m,)."""

    count: NDArray[np.int64]
    share: Floats


@dataclass(frozen=True, eq=False)
class EnergyMetrics:
    """Mechanical energy at the motor shafts, each (m,), J; and what the cables gave to the platform.

    Attributes
    ----------
    supplied, returned
        By the motors while they drive, and to them while they brake (both positive).
    cables
        Work of all measured tensions on the platform, J; NaN without tensions.
    """

    supplied: Floats
    returned: Floats
    cables: float


@dataclass(frozen=True, eq=False)
class RunMetrics:
    """The numbers of one run; None for what its bag cannot tell.

    Attributes
    ----------
    controller, trajectory, bag, robot
        What was run, and where it is recorded.
    time_zero
        From which all times count: the start of the first trajectory, or of the recording without one; ROS time, s.
    window
        The window of all numbers but those that the driver counts (`CycleMetrics.counted`).
    duration
        Time on the trajectories, or of the whole recording if there was none, s.
    platform
        Where the platform was, by its true or measured pose.
    position_error
        Of each motor, degrees.
    velocity_error
        Of each motor, degrees/s.
    tension_error
        Measured minus predicted by the dynamic model, of each cable, N.
    tension_bias
        Mean of the same (m,), N.
    """

    controller: str
    trajectory: str
    bag: str
    robot: str
    time_zero: float
    window: Window
    duration: float
    platform: PlatformMetrics | None
    position_error: ErrorStatistics | None
    velocity_error: ErrorStatistics | None
    tension_error: ErrorStatistics | None
    tension_bias: Floats | None
    mass: MassMetrics | None
    saturation: Saturation | None
    margins: dict[str, Margin]
    cycle: CycleMetrics
    energy: EnergyMetrics

    def as_mapping(self) -> dict[str, Any]:
        """Return the metrics as they are stored in metrics.json, units in the keys."""
        units = {
            "duration": "duration_s",
            "position_error": "position_error_deg",
            "velocity_error": "velocity_error_deg_per_s",
            "tension_error": "tension_error_n",
            "tension_bias": "tension_bias_n",
            "energy": "energy_j",
        }
        return {units.get(item.name, item.name): plain(getattr(self, item.name)) for item in fields(self)}


def run_metrics(
    recording: Recording,
    platform: PoseDifference | None,
    errors: MotorErrors | None,
    predicted: PredictedTensions | None,
) -> RunMetrics:
    """Compute the numbers of a run.

    Parameters
    ----------
    recording
        The run.
    platform, errors, predicted
        Its platform error, motor errors and predicted tensions, as far as there are any.
    """
    states = recording.states
    inside = recording.in_window(states.time_ns)
    times = states.time_ns[inside]
    position = velocity = None
    if errors is not None:
        counted = errors.part(recording.in_window(errors.time_ns))
        position = ErrorStatistics.of(np.degrees(counted.position))
        velocity = ErrorStatistics.of(np.degrees(counted.velocity))
    deviation = tension_deviation(recording, predicted)
    return RunMetrics(
        recording.controller,
        recording.trajectory,
        str(recording.path),
        recording.robot.name,
        recording.origin_ns * 1e-9,
        recording.window,
        sum(run.end_ns - run.start_ns for run in recording.trajectories) * 1e-9
        or float(np.ptp(times)) * 1e-9,
        platform_metrics(recording, platform),
        position,
        velocity,
        None if deviation is None else ErrorStatistics.of(deviation),
        None if deviation is None else deviation.mean(axis=0),
        recorded_mass(recording),
        _saturation(recording, inside),
        _margins(recording, inside),
        cycle_metrics(recording),
        _energy(recording, inside),
    )


def tension_deviation(recording: Recording, predicted: PredictedTensions | None) -> Floats | None:
    """Return measured minus predicted tensions (n, m) at the measurements that count, N; None without either."""
    tensions = recording.tensions
    if tensions is None or predicted is None:
        return None
    counted = recording.in_window(tensions.time_ns)
    counted &= (tensions.time_ns >= predicted.time_ns[0]) & (tensions.time_ns <= predicted.time_ns[-1])
    if not counted.any():
        return None
    return np.asarray(tensions.effort[counted] - predicted.dynamic_at(tensions.time_ns[counted]))


def _saturation(recording: Recording, inside: NDArray[np.bool_]) -> Saturation | None:
    if recording.command_torque is None:
        return None
    torque = np.abs(recording.command_torque[inside])
    answered = np.maximum(np.isfinite(torque).sum(axis=0), 1)
    count = (torque >= recording.robot.motor.torque_limit * (1.0 - 1e-9)).sum(axis=0)
    return Saturation(count, count / answered)


def _margins(recording: Recording, inside: NDArray[np.bool_]) -> dict[str, Margin]:
    robot, states = recording.robot, recording.states
    motor = robot.motor
    time = recording.seconds(states.time_ns[inside])
    margins: dict[str, Margin] = {}

    def add(name: str, distance: Floats, limit: ArrayLike, time: Floats) -> None:
        if np.isfinite(distance).any():
            row, column = np.unravel_index(int(np.nanargmin(distance)), distance.shape)
            limits = np.broadcast_to(np.asarray(limit, dtype=float), distance.shape[1])
            margins[name] = Margin(
                float(distance[row, column]), float(limits[column]), int(column) + 1, float(time[row])
            )

    if recording.tensions is not None:
        tensions = recording.tensions
        counted = recording.in_window(tensions.time_ns)
        measured, at = tensions.effort[counted], recording.seconds(tensions.time_ns[counted])
        add("tension_min_n", measured - robot.tension_min, robot.tension_min, at)
        add("tension_max_n", robot.tension_max - measured, robot.tension_max, at)
    if recording.command_torque is not None:
        torque = np.abs(recording.command_torque[inside])
        add("torque_nm", motor.torque_limit - torque, motor.torque_limit, time)
    add("speed_rad_per_s", motor.speed_limit - np.abs(states.velocity[inside]), motor.speed_limit, time)
    if recording.poses is not None:
        poses = recording.poses
        counted = recording.in_window(poses.time_ns)
        position, at = poses.position[counted], recording.seconds(poses.time_ns[counted])
        inside = np.minimum(position - robot.workspace_min, robot.workspace_max - position)
        if inside.size:
            place = nearest, axis = np.unravel_index(int(inside.argmin()), inside.shape)
            low = position[place] - robot.workspace_min[axis] <= inside[place]
            bound = (robot.workspace_min if low else robot.workspace_max)[axis]
            margins["workspace_m"] = Margin(float(inside[place]), float(bound), 0, float(at[nearest]))
    return margins


def _energy(recording: Recording, inside: NDArray[np.bool_]) -> EnergyMetrics:
    states = recording.states
    m = recording.robot.number_of_cables
    if not states.effort.shape[1] or not states.velocity.shape[1]:
        nothing = np.full(m, np.nan)
        return EnergyMetrics(nothing, nothing, math.nan)
    time = recording.seconds(states.time_ns)
    speed = states.velocity
    power = states.effort * speed
    supplied = _integral(time, np.maximum(power, 0.0), inside)
    returned = _integral(time, np.maximum(-power, 0.0), inside)
    cables = math.nan
    if recording.tensions is not None:
        at = recording.seconds(recording.tensions.time_ns)
        tensions = np.stack([np.interp(time, at, column) for column in recording.tensions.effort.T], axis=-1)
        work = -tensions * recording.robot.winch.cable_speed(np.nan_to_num(speed))
        cables = float(_integral(time, work, inside).sum())
    return EnergyMetrics(supplied, returned, cables)


def _integral(time: Floats, power: Floats, inside: NDArray[np.bool_]) -> Floats:
    """Integrate (n, m) by the trapezoidal rule over the intervals between two times that both count."""
    both = (inside[1:] & inside[:-1])[:, None]
    mean = 0.5 * (power[1:] + power[:-1])
    return np.asarray((np.where(both, mean, 0.0) * np.diff(time)[:, None]).sum(axis=0))
