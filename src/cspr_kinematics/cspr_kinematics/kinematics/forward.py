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
)
from cspr_kinematics.compiled import in_batch, kernel_input
from cspr_kinematics.errors import ForwardKinematicsError, InvalidInputError
from cspr_kinematics.kinematics import _forward as kernels
from cspr_kinematics.kinematics import _iteration as iteration
from cspr_kinematics.kinematics._search import ABOVE_FRAME, AMBIGUOUS
from cspr_kinematics.kinematics.accuracy import covariance as covariance_of
from cspr_kinematics.kinematics.accuracy import length_deviations, tolerance
from cspr_kinematics.kinematics.pose_search import pose_search
from cspr_kinematics.motion.pose import Pose
from cspr_kinematics.robot.robot import Robot


class ForwardKinematicsStatus(IntEnum):
    """How the search for one pose ended."""

    CONVERGED = iteration.CONVERGED
    """A pose that fits the lengths, and no other is known to."""
    ITERATION_LIMIT = iteration.ITERATION_LIMIT
    """No minimum reached within the limit on iterations."""
    NO_POSE_FITS = kernels.NO_POSE_FITS
    """The nearest pose leaves length errors larger than their stated deviation explains."""
    SLACK_CABLE = kernels.SLACK_CABLE
    """As before, but all cables except those in `slack` fit."""
    SLACK_UNCERTAIN = kernels.SLACK_UNCERTAIN
    """As before, but any one of the cables in `slack` explains the lengths; which one it is cannot be told."""
    ABOVE_FRAME = ABOVE_FRAME
    """The pose that fits lies above the frame, where no suspended platform can be."""
    BEYOND_PULLEY = iteration.BEYOND_PULLEY
    """At the guess a cable cannot reach its pulley."""
    AMBIGUOUS = AMBIGUOUS
    """Another pose fits about as well, so that it cannot be told which is the true one."""


@dataclass(frozen=True, eq=False)
class ForwardKinematicsSolution(ReadOnlyArrays):
    """Poses found, and how good they are; arrays are read-only.

    Attributes
    ----------
    pose : Pose
        Last iterate; if AMBIGUOUS, of the poses that fit the one turned least from home, or reached from the guess.
    residual : numpy.ndarray, shape (..., m)
        Cable lengths at `pose` minus the given lengths, m.
    converged : numpy.ndarray of bool, shape (...)
        Whether the pose is a minimum of the squared residual, which its deviation explains, and the only one.
    iterations : int
        Number of iterations, the largest of the batch; the sum over all starts.
    status : numpy.ndarray of int, shape (...)
        A `ForwardKinematicsStatus` for each.
    slack : numpy.ndarray, shape (..., m)
        By how much each slack cable is longer than its path, m; zero for the others. With the status
        SLACK_UNCERTAIN only one of them is slack. `pose` is still the one that fits all cables best.
    alternative : Pose
        If AMBIGUOUS, another pose that fits; else not-a-number.
    covariance : numpy.ndarray, shape (..., 6, 6), or None
        Of position and rotation vector in base axes, if the uncertainty of the lengths was given.
    """

    pose: Pose
    residual: FloatArray
    converged: BoolArray
    iterations: int
    status: IntArray
    slack: FloatArray
    alternative: Pose
    covariance: FloatArray | None = None


def forward_kinematics(
    robot: Robot,
    lengths: ArrayLike,
    guess: Pose | None = None,
    *,
    max_iterations: int = 100,
    length_deviation: ArrayLike | None = None,
) -> Pose:
    """Return the pose at which the cables have the given lengths.

    More cables than six give more equations than unknowns: the pose is the one with the least sum of squared
    length errors, and lengths that fit none are refused. Which of several poses it is, a guess tells, such as the last
    pose of a platform that moves: the one that the iteration reaches from there. Without a guess, and where the pose is
    turned from the guess by more than 0.8 rad, all poses below the frame are looked for; several that fit are refused.

    Parameters
    ----------
    robot : Robot
    lengths : array_like, shape (..., m)
        Cable lengths, including what is wrapped around the pulleys, m.
    guess : Pose, optional
        Where the iteration starts; its batch axes broadcast against those of `lengths`.
    max_iterations : int
        Limit on the iterations from one start. From a guess a centimetre and a degree away, 3 suffice; from the home
        pose to anywhere in the workspace of the shipped robot, 8.
    length_deviation : float or array_like, shape (m,), optional
        Standard deviation of the length errors, m; by default `robot.length_deviation`. The squares are weighted with
        it. Errors so large that it explains them in less than one of 10^12 cases are refused: for eight cables,
        square sums beyond 7.4 deviations.

    Raises
    ------
    ForwardKinematicsError
        If no pose fits, or several do; has the residual, the iterations, which members of the batch failed, and the
        cables found to be slack.
    InvalidInputError
        If lengths are not positive and finite or have another shape, the batch axes do not broadcast, or deviation or
        limit are not positive.
    """
    solved = _solve(robot, lengths, guess, max_iterations, length_deviation)
    if solved.failures:
        raise _failure(_solution(solved, None))
    return Pose.trusted(in_batch(solved.position, solved.batch), in_batch(solved.rotation, solved.batch))


def solve_forward_kinematics(
    robot: Robot,
    lengths: ArrayLike,
    guess: Pose | None = None,
    *,
    max_iterations: int = 100,
    length_deviation: ArrayLike | None = None,
) -> ForwardKinematicsSolution:
    """Do the same as `forward_kinematics`, but report failures instead of raising an error.

    If `length_deviation` is given, the solution has a covariance.

    Raises
    ------
    InvalidInputError
        As in `forward_kinematics`.
    SingularWrenchMatrixError
        If the covariance is requested where lengths do not determine the pose.
    """
    return _solution(_solve(robot, lengths, guess, max_iterations, length_deviation), length_deviation)


class _Solved(NamedTuple):
    """Raw output of the kernel for n poses; `forward_kinematics` needs little of it, and a control cycle is short."""

    batch: tuple[int, ...]
    failures: int
    iterations: int
    position: FloatArray
    rotation: FloatArray
    error: FloatArray
    jacobian: FloatArray
    status: IntArray
    converged: BoolArray
    slack: FloatArray
    other: FloatArray


def _solution(solved: _Solved, length_deviation: ArrayLike | None) -> ForwardKinematicsSolution:
    batch, covariance = solved.batch, None
    if length_deviation is not None:
        deviation = length_deviations(length_deviation, solved.error.shape[1])
        covariance = in_batch(covariance_of(solved.jacobian, deviation, solved.converged), batch)
    other = solved.other.reshape(*batch, 12)
    return ForwardKinematicsSolution(
        Pose.trusted(in_batch(solved.position, batch), in_batch(solved.rotation, batch)),
        in_batch(solved.error, batch),
        in_batch(solved.converged, batch),
        solved.iterations,
        in_batch(solved.status, batch),
        in_batch(solved.slack, batch),
        Pose.trusted(frozen(other[..., :3]), frozen(other[..., 3:].reshape(*batch, 3, 3))),
        covariance,
    )


def _solve(
    robot: Robot,
    lengths: ArrayLike,
    guess: Pose | None,
    max_iterations: int,
    length_deviation: ArrayLike | None,
) -> _Solved:
    m = robot.number_of_cables
    target = checked("lengths", lengths, m)
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
    accepted = search.tolerance
    if length_deviation is not None:
        accepted = tolerance(length_deviations(length_deviation, m))

    targets = kernel_input(target, n, m)
    count = guess_position.size // 3
    guesses = kernel_input(guess_position, count, 3), kernel_input(guess_rotation, count, 3, 3)
    position, rotation = np.empty((n, 3)), np.empty((n, 3, 3))
    error, jacobian, slack, other = np.empty((n, m)), np.empty((n, m, 6)), np.empty((n, m)), np.empty((n, 12))
    status, converged = np.empty(n, dtype=np.int64), np.empty(n, dtype=np.bool_)
    starting = robot.path_geometry, search.frame, search.starts, search.center, search.home
    limits = *accepted, positive_integer("max_iterations", max_iterations)
    outputs = position, rotation, error, jacobian, status, converged, slack, other

    arguments: list[Any] = [*starting, targets, guess is not None, *guesses, *limits, *outputs]
    failures, iterations = kernels.forward_at_poses(*arguments)
    if failures < 0:
        raise InvalidInputError("lengths", lengths, "cable lengths must be positive")
    return _Solved(batch, failures, iterations, *outputs)


def _failure(solution: ForwardKinematicsSolution) -> ForwardKinematicsError:
    failed = ~solution.converged
    statuses = np.atleast_1d(solution.status[failed])
    first = int(statuses[0])
    count = int(np.count_nonzero(failed))
    errors = np.abs(solution.residual[failed])
    worst = float(np.nanmax(errors)) if np.isfinite(errors).any() else math.nan
    misfit = f"the largest length error is {worst:.6g} m. "
    slack = solution.slack[failed].reshape(-1, solution.slack.shape[-1])
    with_slack = np.flatnonzero(slack.any(axis=-1))
    if len(with_slack):
        amounts = slack[with_slack[0]]
        certain = statuses[with_slack[0]] == kernels.SLACK_CABLE
        named = (" and " if certain else ", or ").join(
            f"cable {k + 1} is slack by {amounts[k]:.4g} m" for k in np.flatnonzero(amounts)
        )
        advice = f"{misfit}All other cables fit: {named}"
    elif first == AMBIGUOUS:
        advice = _two_poses(solution, int(np.flatnonzero(failed.ravel())[0]))
    else:
        advice = misfit + _ADVICE[first]
    return ForwardKinematicsError(
        f"{count} of {solution.converged.size} not solved after {solution.iterations} iterations; {advice}",
        solution.residual,
        solution.iterations,
        solution.converged,
        solution.slack,
    )


_ADVICE = {
    iteration.ITERATION_LIMIT: "Start from a nearer guess, or allow more iterations",
    kernels.NO_POSE_FITS: "That is more than length_uncertainty explains: check that lengths, exit points, anchor "
    "points and pulleys are this robot's, or start from a nearer guess",
    ABOVE_FRAME: "The pose that fits lies above the frame, where no suspended platform can be",
    iteration.BEYOND_PULLEY: "At the guess a cable cannot reach its pulley",
}


def _two_poses(solution: ForwardKinematicsSolution, member: int) -> str:
    """Say between which poses of a member of the batch it cannot be told."""
    places, turns = [], []
    for pose in (solution.pose, solution.alternative):
        places.append(np.array2string(pose.position.reshape(-1, 3)[member], precision=3, separator=", "))
        turns.append(pose.rotation.reshape(-1, 3, 3)[member])
    angle = math.acos(max(-1.0, min(1.0, 0.5 * (float(np.sum(turns[0] * turns[1])) - 1.0))))
    return (
        f"it is ambiguous: a pose at {places[0]} m and one at {places[1]} m, turned from it by "
        f"{math.degrees(angle):.0f} degrees, fit about as well; "
        "start from a guess that is turned by less than 45 degrees from the true one"
    )
