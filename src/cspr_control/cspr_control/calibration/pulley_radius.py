"""The common radius of pulleys, from the lengths of the cables along a run (docs/calibration.md)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cspr_control.analysis.recording import Floats
from cspr_control.calibration.samples import CalibrationSamples
from cspr_control.errors import ControlError
from cspr_kinematics import (
    Cables,
    KinematicsError,
    Pose,
    Pulleys,
    Robot,
    inverse_kinematics,
    solve_forward_kinematics,
)

# Lengths as shares of the cables' mean length at home.
_START = 0.01
_STEP = 1e-4  # of the radius, for its derivative
_CONVERGED = 1e-8
_LARGEST_RADIUS = 0.1  # none is larger
_ITERATIONS = 30


@dataclass(frozen=True)
class PulleyRadius:
    """A radius that was identified, and how well.

    Attributes
    ----------
    radius, deviation : float
        Of all pulleys, and its standard deviation, m.
    misfit_before, misfit_after : float
        Root mean square over the samples of |e|, the errors of the lengths at the pose that fits them best, with the
        pulleys of the robot's file and with these, m.
    samples : int
    """

    radius: float
    deviation: float
    misfit_before: float
    misfit_after: float
    samples: int


def identify_pulley_radius(robot: Robot, samples: CalibrationSamples, limit: float) -> PulleyRadius:
    """Return the radius with which the lengths fit poses best.

    More lengths than six fit a pose only if the geometry is right. The poses are eliminated: of each sample counts what
    forward kinematics leaves (variable projection; Golub and Pereyra, "Separable nonlinear least squares", Inverse
    Problems 19, 2003); Gauss-Newton finds the radius. What is left at the end is taken for errors of exit and
    anchor points, which are the same in all samples, and for noise, which is not; both make the radius uncertain.

    Parameters
    ----------
    robot
        As its file describes it; the swivel axes are those of its pulleys.
    samples
        n places.
    limit
        Standard deviation above which a run does not tell the radius, m.

    Raises
    ------
    ControlError
        If the robot has six cables, the run does not tell the radius, or no radius explains the lengths.
    """
    m, n = robot.number_of_cables, len(samples.motor_angles)
    if m < 7:
        raise ControlError(
            "six lengths fit a pose whatever the pulleys are: the radius needs seven cables or more"
        )
    size = float(robot.winch.home_lengths.mean())
    radius, step = _START * size, _STEP * size
    for _ in range(_ITERATIONS):
        fit = _fit(robot, samples, radius)
        lower, upper = max(radius - step, 0.0), radius + step
        slope = (_fit(robot, samples, upper).error - _fit(robot, samples, lower).error) / (upper - lower)
        curvature = float(np.sum(slope * slope))
        if not curvature > 0.0:
            raise ControlError(_too_little(n, math.inf, limit))
        better = min(max(radius - float(np.sum(slope * fit.error)) / curvature, 0.0), _LARGEST_RADIUS * size)
        if abs(better - radius) <= _CONVERGED * size:
            break
        radius = better
    deviation = _deviation(robot, fit, slope, curvature)
    if not deviation <= limit:
        raise ControlError(_too_little(n, deviation, limit))
    before, after = _misfit(_fit(robot, samples, None).error), _misfit(fit.error)
    explained = robot.length_deviation * math.sqrt(m - 6)
    if after > explained:
        raise ControlError(
            f"it is not the pulleys alone: with {1e3 * radius:.1f} mm, which fit best, lengths miss by "
            f"{1e3 * after:.3f} mm, before by {1e3 * before:.3f} mm, and length_uncertainty of the robot's file "
            f"explains {1e3 * explained:.3f} mm. Check exit points, anchor points, drum radius, home pose and cables"
        )
    return PulleyRadius(radius, deviation, before, after, n)


@dataclass(frozen=True, eq=False)
class _Fit:
    robot: Robot
    pose: Pose
    error: Floats  # (n, m)


def _fit(robot: Robot, samples: CalibrationSamples, radius: float | None) -> _Fit:
    """Return the poses that fit the samples best over pulleys of a radius, or those of the file."""
    if radius is not None:
        robot = robot.with_geometry(pulleys=Pulleys(radius, robot.pulleys.swivel_axis))
    lengths = robot.cable_lengths(samples.motor_angles, samples.tensions)
    # no error is too large here
    solution = solve_forward_kinematics(
        robot, lengths, robot.home, length_deviation=float(robot.winch.home_lengths.mean())
    )
    if not solution.converged.all():
        k = int(np.flatnonzero(~solution.converged)[0])
        raise ControlError(
            f"sample {k + 1} of {len(lengths)} fits no pose at all: check that robot and recording belong together"
        )
    return _Fit(robot, solution.pose, solution.residual)


def _misfit(error: Floats) -> float:
    return float(np.sqrt(np.mean(np.sum(error * error, axis=1))))


def _deviation(robot: Robot, fit: _Fit, slope: Floats, curvature: float) -> float:
    """Return the standard deviation of the radius.

    Points that are off by a standard deviation in each coordinate, the same at home and in all samples, leave errors
    M e of the points' coordinates e. The deviation is as large as what is left suggests, and at least what the robot's
    file states.
    """
    n, m = fit.error.shape
    try:
        cables, home = inverse_kinematics(fit.robot, fit.pose), inverse_kinematics(fit.robot, fit.robot.home)
    except KinematicsError as error:
        raise ControlError(str(error)) from error
    own = _by_points(cables, fit.pose) - _by_points(home, fit.robot.home)
    by_points = np.zeros((n, m, m, 6))
    by_points[:, range(m), range(m)] = own
    J = cables.jacobian
    kept = np.eye(m) - J @ np.linalg.pinv(J)  # poses eliminated
    M = kept @ by_points.reshape(n, m, 6 * m)
    along = np.einsum("nm,nmk->k", slope, M)
    left = M - slope[..., None] * along / curvature
    squares, spread = float(np.sum(fit.error**2)), float(np.sum(left**2))
    if not spread > 0.0:  # at home alone
        return math.inf
    points = max(math.sqrt(squares / spread), robot.length_deviation)
    noise = squares / max(n * (m - 6) - 1, 1) / curvature
    return math.sqrt((points * float(np.linalg.norm(along)) / curvature) ** 2 + noise)


def _by_points(cables: Cables, pose: Pose) -> Floats:
    """Return the derivative of each length by its exit and its anchor point, (..., m, 6)."""
    u = cables.directions
    return np.concatenate((u, -np.einsum("...ji,...mj->...mi", pose.rotation, u)), axis=-1)


def _too_little(samples: int, deviation: float, limit: float) -> str:
    told = f"only to {1e3 * deviation:.1f} mm" if math.isfinite(deviation) else "not at all"
    return (
        f"this motion tells the radius {told} (standard deviation), where {1e3 * limit:g} mm are wanted: it visits "
        f"{samples} place{'s' * (samples != 1)}. Record a longer way through the workspace, far from home and at "
        "several heights, with every cable taut"
    )
