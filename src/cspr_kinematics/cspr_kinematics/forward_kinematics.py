"""Pose from cable lengths by Levenberg-Marquardt iteration, in batches."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .arrays import BoolArray, FloatArray, broadcast_batch, checked, positive_number
from .cable_geometry import cable_geometry
from .errors import ForwardKinematicsError, InvalidInputError
from .pose import Pose
from .robot import Robot
from .so3 import orthonormalised, rotation_from_vector

# The gradient J^T e of half the squared length errors, below which a pose is a minimum, m. For a
# well-conditioned Jacobian the pose is then within about the same distance of it.
GRADIENT_TOLERANCE = 1e-9
_INITIAL_DAMPING = 1e-6
_LEAST_DAMPING = 1e-12
_IDENTITY = np.eye(6)
# Allowance for rounding when costs are compared: close to the minimum all steps change them by less.
_COST_ROUNDING = 1.0 + 1e-12


@dataclass(frozen=True, eq=False)
class ForwardKinematicsSolution:
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
        Number of iterations made for the whole batch.
    """

    pose: Pose
    residual: FloatArray
    converged: BoolArray
    iterations: int

    def __post_init__(self) -> None:
        for array in (self.residual, self.converged):
            array.setflags(write=False)


def forward_kinematics(
    robot: Robot,
    lengths: ArrayLike,
    guess: Pose,
    *,
    max_residual: float = 0.05,
    max_iterations: int = 50,
) -> Pose:
    """Return the pose at which the cables have the given lengths.

    More cables than six give more equations than unknowns: the pose is the one with the least sum of
    squared length errors. Of the several poses that may exist, it is the one the iteration reaches from
    `guess`.

    Parameters
    ----------
    robot : Robot
    lengths : array_like, shape (..., m)
        Cable lengths, m.
    guess : Pose
        Start of the iteration; its batch axes broadcast against those of `lengths`.
    max_residual : float
        Largest length error that is accepted at the solution, m. Measured lengths never fit exactly,
        because cables stretch; lengths that belong to no pose leave more.
    max_iterations : int
        Limit on iterations.

    Raises
    ------
    ForwardKinematicsError
        If the iteration does not converge, or to a pose that does not fit; carries residual, iterations
        and which members of the batch failed.
    InvalidInputError
        If lengths are not positive and finite or have another shape, or the batch axes do not broadcast.
    """
    solution = solve_forward_kinematics(
        robot, lengths, guess, max_residual=max_residual, max_iterations=max_iterations
    )
    if not solution.converged.all():
        failed = int(np.count_nonzero(~solution.converged))
        worst = np.abs(solution.residual).max()
        raise ForwardKinematicsError(
            f"{failed} of {solution.converged.size} not solved after {solution.iterations} iterations; the "
            f"largest length error is {worst:.6g} m where {max_residual:.6g} m is accepted. Check that the "
            "lengths belong to this robot, and start from a nearer guess",
            solution.residual,
            solution.iterations,
            solution.converged,
        )
    return solution.pose


def solve_forward_kinematics(
    robot: Robot,
    lengths: ArrayLike,
    guess: Pose,
    *,
    max_residual: float = 0.05,
    max_iterations: int = 50,
) -> ForwardKinematicsSolution:
    """Do the work of `forward_kinematics`, and report instead of raising when it fails.

    Parameters are those of `forward_kinematics`.

    Raises
    ------
    InvalidInputError
        As in `forward_kinematics`.
    """
    target = checked("lengths", lengths, robot.number_of_cables)
    if not (target > 0.0).all():
        raise InvalidInputError("lengths", lengths, "cable lengths must be positive")
    positive_number("max_residual", max_residual)
    batch = broadcast_batch(lengths=target.shape[:-1], guess=guess.batch_shape)
    position = np.broadcast_to(guess.position, (*batch, 3))
    rotation = np.broadcast_to(guess.rotation, (*batch, 3, 3))
    damping = np.full(batch, _INITIAL_DAMPING)

    current = _evaluate(robot, target, position, rotation)
    iterations = 0
    while True:
        J, J_transposed = current.jacobian, current.jacobian.swapaxes(-1, -2)
        gradient = (J_transposed @ current.error[..., None])[..., 0]
        at_minimum = np.abs(gradient).max(axis=-1) <= GRADIENT_TOLERANCE
        if iterations >= max_iterations or at_minimum.all():
            break
        iterations += 1
        damped = J_transposed @ J + damping[..., None, None] * _IDENTITY
        step = np.asarray(np.linalg.solve(damped, -gradient[..., None])[..., 0], dtype=np.float64)
        trial = _evaluate(
            robot,
            target,
            current.position + step[..., :3],
            rotation_from_vector(step[..., 3:]) @ current.rotation,
        )
        better = (trial.cost <= current.cost * _COST_ROUNDING) & ~at_minimum
        current = _select(better, trial, current)
        damping = np.where(better, np.maximum(0.1 * damping, _LEAST_DAMPING), 10.0 * damping)

    fits = np.abs(current.error).max(axis=-1) <= max_residual
    pose = Pose(current.position, orthonormalised(current.rotation))
    return ForwardKinematicsSolution(pose, current.error, np.asarray(at_minimum & fits), iterations)


class _Iterate(NamedTuple):
    """A batch of trial poses: length errors (..., m), half their square sum (...), J (..., m, 6)."""

    position: FloatArray
    rotation: FloatArray
    error: FloatArray
    cost: FloatArray
    jacobian: FloatArray


def _evaluate(robot: Robot, target: FloatArray, position: FloatArray, rotation: FloatArray) -> _Iterate:
    geometry = cable_geometry(robot.exit_points, robot.anchor_points, position, rotation)
    error = geometry.lengths - target
    cost = 0.5 * np.einsum("...i,...i->...", error, error)
    return _Iterate(position, rotation, error, cost, -geometry.wrench_columns())


def _select(mask: BoolArray, chosen: _Iterate, other: _Iterate) -> _Iterate:
    """Return `chosen` for the members of the batch where `mask` (...) holds, else `other`."""
    if mask.all():
        return chosen
    return _Iterate(
        *(
            np.where(mask.reshape(mask.shape + (1,) * (a.ndim - mask.ndim)), a, b)
            for a, b in zip(chosen, other, strict=True)
        )
    )
