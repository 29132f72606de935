"""Accuracy of a pose found from uncertain cable lengths (docs/model.md, sections 5 and 9)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import BoolArray, FloatArray, for_each_cable, frozen
from cspr_kinematics.errors import InvalidInputError, SingularWrenchMatrixError
from cspr_kinematics.kinematics.inverse import inverse_kinematics
from cspr_kinematics.motion.pose import Pose
from cspr_kinematics.robot.robot import Robot

# Misfits that errors of the stated deviation reach more rarely than this are not accepted: at 250 Hz once in a century.
_IMPROBABLE = 1e-12
# Of two poses that fit, the worse one is the true one with these odds, or it cannot be told which is.
_ODDS = 1e-4
_SINGULAR = 1e-10


def pose_covariance(robot: Robot, pose: Pose, length_deviation: ArrayLike) -> FloatArray:
    """Return the covariance of a pose found from uncertain lengths, shape (..., 6, 6).

    It is that of position and rotation vector in base axes, (m, rad), for least squares weighted by the deviations.

    Parameters
    ----------
    robot : Robot
    pose : Pose
    length_deviation : float or array_like, shape (m,)
        Standard deviations of the independent length errors, m.

    Raises
    ------
    SingularWrenchMatrixError
        If the lengths do not determine the pose there.
    InvalidInputError
        If the deviations are not positive and finite or have another shape.
    """
    deviation = length_deviations(length_deviation, robot.number_of_cables)
    J = inverse_kinematics(robot, pose).jacobian
    return covariance(J, deviation, np.ones(pose.batch_shape, dtype=np.bool_))


class Tolerance(NamedTuple):
    """Which length errors are accepted; costs are half the sum of their squares times the weights, m^2."""

    weights: FloatArray  # (m,), 1 for the cables whose lengths are best known
    limits: FloatArray  # (m + 1,): the largest cost at which k = 0..m cables fit a pose
    rivalry: float  # by how much the costs of two poses may differ that fit about as well


def tolerance(deviation: FloatArray) -> Tolerance:
    """Return what errors of standard deviations (m,), m, explain.

    What least squares leave of k independent normal errors, divided by their deviations, has a sum of squares with
    the distribution chi-squared of k - 6 degrees of freedom. Six lengths or fewer fit exactly, or not at all; they are
    given one degree.
    """
    from scipy.special import chdtri  # here, because its import takes long

    freedom = np.maximum(np.arange(len(deviation) + 1) - 6.0, 1.0)
    half_variance = 0.5 * float(deviation.min()) ** 2
    limits = half_variance * chdtri(freedom, _IMPROBABLE)
    rivalry = -2.0 * math.log(_ODDS) * half_variance
    return Tolerance(frozen((deviation.min() / deviation) ** 2), frozen(limits), rivalry)


def length_deviations(length_deviation: ArrayLike, m: int) -> FloatArray:
    """Return standard deviations of m lengths, (m,), from one or m of them.

    Raises
    ------
    InvalidInputError
        If they are not positive and finite or have another shape.
    """
    deviation = for_each_cable("length_deviation", length_deviation, m)
    if deviation.min() <= 0.0:
        raise InvalidInputError("length_deviation", length_deviation, "must be positive")
    return deviation


def covariance(jacobian: FloatArray, deviation: FloatArray, wanted: BoolArray) -> FloatArray:
    """Return (J^T S^-1 J)^-1 for the members that are wanted, NaN for the others."""
    result = np.full((*wanted.shape, 6, 6), np.nan)
    J = jacobian[wanted]
    if not J.size:
        return result
    _, singular, _ = np.linalg.svd(J)
    flat = singular[:, -1] <= _SINGULAR * singular[:, 0]
    if flat.any():
        k = int(np.argmax(flat))
        index = tuple(int(i) for i in np.argwhere(wanted)[k])
        raise SingularWrenchMatrixError("the lengths do not determine the pose", -J[k].T, singular[k], index)
    inverse = np.linalg.pinv(J / deviation[:, None])
    result[wanted] = inverse @ inverse.swapaxes(-1, -2)
    return result
