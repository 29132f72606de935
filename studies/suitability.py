"""Whether a robot can follow the paper's trajectories with the paper's loads, and without its cables touching."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cspr_control.reference.paper import paper_18, paper_19, paper_19_tilt
from cspr_control.reference.trajectory import Trajectory
from cspr_kinematics import Pose, Robot, inverse_kinematics
from cspr_kinematics.workspace.interference import cable_interference
from studies.tension_deviation import PAYLOAD, along, sample_times, third_simulation


@dataclass(frozen=True)
class Suitability:
    """The worst along (18), and along (19) level and turning by 5 degrees.

    Attributes
    ----------
    least_tension, largest_tension
        That either model asks of a cable, N: empty, with 200 kg, and with 100 kg more from 3 s on.
    condition_number
        Of the wrench matrix, moments in N m.
    between_cables, to_platform
        Least distance between two cables, and of a cable to the platform's box, m.
    """

    least_tension: float
    largest_tension: float
    condition_number: float
    between_cables: float
    to_platform: float

    @staticmethod
    def of(robot: Robot) -> Suitability:
        """Compute them."""
        trajectories = [make(robot.trajectory_center) for make in (paper_18, paper_19, paper_19_tilt)]
        tensions = [third_simulation(robot)]
        for trajectory in trajectories:
            tensions.append(along(robot, trajectory, lambda t: 0.0, "empty"))
            tensions.append(along(robot, trajectory, lambda t: PAYLOAD, "loaded"))
        matrices = [inverse_kinematics(robot, _poses(one)).wrench_matrix for one in trajectories]
        return Suitability(
            min(float(min(one.dynamic.min(), one.static.min())) for one in tensions),
            max(float(max(one.dynamic.max(), one.static.max())) for one in tensions),
            max(float(np.linalg.cond(matrix).max()) for matrix in matrices),
            *clearances(robot),
        )


def clearances(robot: Robot) -> tuple[float, float]:
    """Return the least distance between two cables and of a cable to the platform along (18) and (19), m."""
    center = robot.trajectory_center  # (18) and (19) have one path
    near = [cable_interference(robot, _poses(make(center))) for make in (paper_19, paper_19_tilt)]
    between = min(float(one.between_cables.min()) for one in near)
    return between, min(float(one.to_platform.min()) for one in near)


def _poses(trajectory: Trajectory) -> Pose:
    points = [trajectory.sample(t).pose for t in sample_times(trajectory).tolist()]
    return Pose([point.position for point in points], [point.rotation for point in points])
