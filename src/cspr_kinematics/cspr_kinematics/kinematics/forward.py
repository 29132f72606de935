"""Pose from cable lengths, with or without pulleys, by Levenberg-Marquardt iteration (docs/model.md, section 5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    ReadOnlyArrays,
    broadcast_batch,
    checked,
    frozen,
    positive_integer,
    positive_number,
)
from cspr_kinematics.compiled import in_batch, kernel_input
from cspr_kinematics.errors import ForwardKinematicsError, InvalidInputError
from cspr_kinematics.kinematics import _forward as kernels
from cspr_kinematics.kinematics import _iteration as iteration
from cspr_kinematics.kinematics._search import ABOVE_FRAME
from cspr_kinematics.kinematics.accuracy import covariance as covariance_of
from cspr_kinematics.kinematics.accuracy import largest_misfit, length_deviations
from cspr_kinematics.kinematics.pose_search import pose_search
from cspr_kinematics.motion.pose import Pose
from cspr_kinematics.robot.robot import Robot


class ForwardKinematicsStatus(IntEnum):
    """How the search for one pose ended."""

    CONVERGED = iteration.CONVERGED
    """A pose that fits the lengths."""
    ITERATION_LIMIT = iteration.ITERATION_LIMIT
    """No minimum reached within the limit on iterations."""
    NO_POSE_FITS = kernels.NO_POSE_FITS
    """The nearest pose leaves length errors larger than what is accepted."""
    SLACK_CABLE = kernels.SLACK_CABLE
    """As before, but all cables except those in `slack` fit."""
    SLACK_UNCERTAIN = kernels.SLACK_UNCERTAIN
    """As before, but any one of the cables in `slack` explains the lengths; which one it is cannot be told."""
    ABOVE_FRAME = ABOVE_FRAME
    """The pose that fits lies above the frame, where no suspended platform can be."""
    BEYOND_PULLEY = iteration.BEYOND_PULLEY
    """At the guess a cable cannot reach its pulley."""


@dataclass(frozen=True, eq=False)
class ForwardKinematicsSolution(ReadOnlyArrays):
    """Poses found, and how good they are; arrays are read-only.

    Attributes
    ----------
    pose : Pose
        Last iterate.
    residual : numpy.ndarray, shape (..., m)
        Cable lengths at `pose` minus the given lengths, m.
    converged : numpy.ndarray of bool, shape (...)
        Whether the pose is a minimum of the squared residual, and no residual exceeds the limit.
    iterations : int
        Number of iterations, the largest of the batch; without a guess, the sum over all starts.
    status : numpy.ndarray of int, shape (...)
        A `ForwardKinematicsStatus` for each.
    slack : numpy.ndarray, shape (..., m)
        By how much each slack cable is longer than its path, m; zero for the others. With the status
        SLACK_UNCERTAIN only one of them is slack. `pose` is still the one that fits all cables best.
    covariance : numpy.ndarray, shape (..., 6, 6), or None
        Of position and rotation vector in base axes, if the uncertainty of the lengths was given.
    """

    pose: Pose
    residual: FloatArray
    converged: BoolArray
    iterations: int
    status: IntArray
    slack: FloatArray
    covariance: FloatArray | None = None


def forward_kinematics(
    robot: Robot,
    lengths: ArrayLike,
    guess: Pose | None = None,
    *,
    max_residual: float = 0.05,
    max_iterations: int = 50,
) -> Pose:
    """Return the pose at which the cables have the given lengths.

    More cables than six give more equations than unknowns: the pose is the one with the least sum of
    squared length errors. Of the several poses that may exist, it is the one the iteration reaches from
    `guess`; without a guess the best fit below the frame, never its mirror image above.

    Parameters
    ----------
    robot : Robot
    lengths : array_like, shape (..., m)
        Cable lengths, including what is wrapped around the pulleys, m.
    guess : Pose, optional
        Where the iteration starts; its batch axes broadcast against those of `lengths`.
    max_residual : float
        Largest length error that is accepted at the solution, m. Measured lengths never fit exactly,
        because cables stretch; lengths that belong to no pose leave larger errors. All cables share the slack
        of one: 0.1 m on the shipped robot leaves an error of about 0.03 m, and the pose is 0.04 m off. To
        detect less slack, accept less, or state `length_deviation` in `solve_forward_kinematics`.
    max_iterations : int
        Limit on iterations. From a guess a centimetre and a degree away, 3 suffice; from the home pose to
        anywhere in the workspace of the shipped robot, 8.

    Raises
    ------
    ForwardKinematicsError
        If the iteration does not converge, or converges to a pose that does not fit; has the residual, the
        iterations, which members of the batch failed, and the cables found to be slack.
    InvalidInputError
        If lengths are not positive and finite or have another shape, the batch axes do not broadcast, or a
        limit is not positive.
    """
    solved = _solve(robot, lengths, guess, max_residual, max_iterations, None)
    if solved.failures:
        raise _failure(_solution(solved), max_residual)
    return Pose.trusted(in_batch(solved.position, solved.batch), in_batch(solved.rotation, solved.batch))


def solve_forward_kinematics(
    robot: Robot,
    lengths: ArrayLike,
    guess: Pose | None = None,
    *,
    max_residual: float = 0.05,
    max_iterations: int = 50,
    length_deviation: ArrayLike | None = None,
) -> ForwardKinematicsSolution:
    """Do the same as `forward_kinematics`, but report failures instead of raising an error.

    Parameters
    ----------
    robot, lengths, guess, max_residual, max_iterations
        As in `forward_kinematics`.
    length_deviation : float or array_like, shape (m,), optional
        Standard deviation of the length errors, m. With it, the squares are weighted, the solution has a
        covariance, and errors larger than it explains are reported even below `max_residual`.

    Raises
    ------
    InvalidInputError
        As in `forward_kinematics`.
    SingularWrenchMatrixError
        If the covariance is requested where lengths do not determine the pose.
    """
    return _solution(_solve(robot, lengths, guess, max_residual, max_iterations, length_deviation))


class _Solved(NamedTuple):
    """Raw output of the kernel for n poses; `forward_kinematics` needs little of it, and a control cycle is short."""

    batch: tuple[int, ...]
    failures: int
    iterations: int
    deviation: FloatArray | None
    position: FloatArray
    rotation: FloatArray
    error: FloatArray
    jacobian: FloatArray
    status: IntArray
    converged: BoolArray
    slack: FloatArray


def _solution(solved: _Solved) -> ForwardKinematicsSolution:
    batch, covariance = solved.batch, None
    if solved.deviation is not None:
        covariance = in_batch(covariance_of(solved.jacobian, solved.deviation, solved.converged), batch)
    return ForwardKinematicsSolution(
        Pose.trusted(in_batch(solved.position, batch), in_batch(solved.rotation, batch)),
        in_batch(solved.error, batch),
        in_batch(solved.converged, batch),
        solved.iterations,
        in_batch(solved.status, batch),
        in_batch(solved.slack, batch),
        covariance,
    )


def _solve(
    robot: Robot,
    lengths: ArrayLike,
    guess: Pose | None,
    max_residual: float,
    max_iterations: int,
    length_deviation: ArrayLike | None,
) -> _Solved:
    m = robot.number_of_cables
    target = checked("lengths", lengths, m)
    limit = positive_number("max_residual", max_residual)
    batch = target.shape[:-1]
    search = pose_search(robot)
    if guess is None:
        guess_position, guess_rotation = search.center, search.starts[0]
    else:
        guess_position, guess_rotation = guess.position, guess.rotation
        guess_batch = guess_position.shape[:-1]
        if guess_batch and guess_batch != batch:
            batch = broadcast_batch(lengths=batch, guess=guess_batch)
            guess_position = np.broadcast_to(guess_position, (*batch, 3))
            guess_rotation = np.broadcast_to(guess_rotation, (*batch, 3, 3))
        if batch != target.shape[:-1]:
            target = np.broadcast_to(target, (*batch, m))
    n = math.prod(batch)
    weights, deviation, misfit, known = search.ones, search.ones, search.no_misfit, None
    if length_deviation is not None:
        deviation, misfit = length_deviations(length_deviation, m), largest_misfit(m)
        weights, known = frozen((deviation.min() / deviation) ** 2), deviation

    targets = kernel_input(target, n, m)
    count = guess_position.size // 3
    guesses = kernel_input(guess_position, count, 3), kernel_input(guess_rotation, count, 3, 3)
    position, rotation = np.empty((n, 3)), np.empty((n, 3, 3))
    error, jacobian, slack = np.empty((n, m)), np.empty((n, m, 6)), np.empty((n, m))
    status, converged = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.bool_)
    starting = robot.path_geometry, search.frame, search.starts, search.center, search.home
    limits = weights, deviation, limit, misfit, positive_integer("max_iterations", max_iterations)
    outputs = position, rotation, error, jacobian, status, converged, slack

    arguments: list[Any] = [*starting, targets, guess is not None, *guesses, *limits, *outputs]
    failures, iterations = kernels.forward_at_poses(*arguments)
    if failures < 0:
        raise InvalidInputError("lengths", lengths, "cable lengths must be positive")
    return _Solved(batch, failures, iterations, known, *outputs)


def _failure(solution: ForwardKinematicsSolution, max_residual: float) -> ForwardKinematicsError:
    failed = ~solution.converged
    statuses = solution.status[failed]
    count = int(np.count_nonzero(failed))
    errors = np.abs(solution.residual[failed])
    worst = float(np.nanmax(errors)) if np.isfinite(errors).any() else math.nan
    advice = {
        ABOVE_FRAME: "The pose that fits lies above the frame, where no suspended platform can be",
        iteration.BEYOND_PULLEY: "At the guess a cable cannot reach its pulley",
    }.get(int(statuses[0]), "Check that the lengths belong to this robot, and start from a nearer guess")
    slack = solution.slack[failed].reshape(-1, solution.slack.shape[-1])
    with_slack = np.flatnonzero(slack.any(axis=-1))
    if len(with_slack):
        first = slack[with_slack[0]]
        certain = statuses.ravel()[with_slack[0]] == kernels.SLACK_CABLE
        named = (" and " if certain else ", or ").join(
            f"cable {k + 1} is slack by {first[k]:.4g} m" for k in np.flatnonzero(first)
        )
        advice = f"All other cables fit: {named}"
    return ForwardKinematicsError(
        f"{count} of {solution.converged.size} not solved after {solution.iterations} iterations; the "
        f"largest length error is {worst:.6g} m where {max_residual:.6g} m is accepted. {advice}",
        solution.residual,
        solution.iterations,
        solution.converged,
        solution.slack,
    )
