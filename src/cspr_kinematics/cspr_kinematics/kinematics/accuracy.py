"""Accuracy of a pose found from uncertain cable lengths (docs/model.md, sections 5 and 9)."""

from __future__ import annotations

import functools

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import BoolArray, FloatArray, for_each_cable, frozen
from cspr_kinematics.errors import InvalidInputError, SingularWrenchMatrixError
from cspr_kinematics.kinematics.inverse import inverse_kinematics
from cspr_kinematics.motion.pose import Pose
from cspr_kinematics.robot.robot import Robot

# Errors so large that noise explains them in less than one case in 10,000 are reported: normal quantile of 1e-4.
_MISFIT_QUANTILE = 3.719
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


@functools.lru_cache(maxsize=64)
def largest_misfit(m: int) -> FloatArray:
    """Return the weighted square sum that noise of k = 0..m cables exceeds once in 10,000 cases.

    From the approximation by Wilson and Hilferty of the quantile of chi-squared with k - 6 degrees of freedom.
    """
    freedom = np.maximum(np.arange(m + 1) - 6.0, 1.0)
    spread = 2.0 / (9.0 * freedom)
    quantile = freedom * (1.0 - spread + _MISFIT_QUANTILE * np.sqrt(spread)) ** 3
    quantile[:7] = np.inf  # six lengths fit any six
    return frozen(quantile)


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
