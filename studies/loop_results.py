"""The runs of figures 11 and 12 with one geometry, and what is asked of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_control.analysis.numbers.error_statistics import ErrorStatistics
from cspr_control.closed_loop.record import LoopRecord
from cspr_control.parameters.settings import trajectory_settings
from cspr_control.reference.catalogue import make_trajectory
from cspr_kinematics import Pose, inverse_kinematics
from cspr_msgs_py.parameters.table import defaults
from cspr_msgs_py.vocabulary import TrajectoryName
from studies.experiment import LOADS, Case
from studies.geometries import Geometry

SAMPLING = 0.5  # s, of the paper's experiment

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LoopResults:
    """The runs with one geometry, all controllers with all of these loads, kg."""

    geometry: Geometry
    records: dict[Case, LoopRecord]
    loads: tuple[float, ...] = LOADS

    def record(self, name: str, trajectory: TrajectoryName, load: float, added: float = 0.0) -> LoopRecord:
        """Return a run."""
        return self.records[Case(name, trajectory, load, added, self.geometry)]

    def rms(self, name: str, trajectory: TrajectoryName, load: float) -> float:
        """Return the RMS position error, mean of the motors, degrees."""
        return float(self.record(name, trajectory, load).rms_deg.mean())

    def platform_by_motors(self, record: LoopRecord) -> Floats:
        """Return the platform's position error as the motors' errors tell it (n, 3), m: without stretch or survey."""
        robot = self.geometry.robot
        settings = trajectory_settings(robot, defaults("trajectory_publisher"))
        trajectory = make_trajectory(record.scenario.trajectory, robot, robot.home, settings)
        points = [trajectory.sample(t).pose for t in record.time.tolist()]
        poses = Pose([point.position for point in points], [point.rotation for point in points])
        jacobian = -inverse_kinematics(robot, poses).wrench_matrix.swapaxes(-1, -2)
        lengths = robot.winch.transmission_ratio * record.position_error
        return np.asarray((np.linalg.pinv(jacobian) @ lengths[..., None])[..., :3, 0])


def size_mm(error: Floats) -> float:
    """Return the RMS of the length of an error (n, 3), m, in mm."""
    return float(1e3 * np.sqrt((error**2).sum(axis=1).mean()))


def speed_errors(record: LoopRecord) -> Floats:
    """Return the RMS of the velocity error of each motor (m,), rad/s."""
    return ErrorStatistics.of(record.velocity_error).rms


def sampled_rms(record: LoopRecord) -> tuple[float, float]:
    """Return the least and the largest RMS error, mean of the motors, degrees, of one sample every `SAMPLING`.

    They differ by when the first sample is taken.
    """
    every = round(SAMPLING / float(np.median(np.diff(record.time))))
    errors = np.degrees(record.position_error)
    means = [float(ErrorStatistics.of(errors[first::every]).rms.mean()) for first in range(every)]
    return min(means), max(means)
