"""Inverse kinematics for fixed exit points (eqs. 1-7; MODEL sections 1 and 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .arrays import FloatArray
from .cable_geometry import SHORTEST_CABLE, cable_geometry
from .errors import InvalidInputError
from .pose import Pose
from .robot import Robot


@dataclass(frozen=True, eq=False)
class Cables:
    """The cables at one pose or a batch of poses; arrays are read-only.

    Attributes
    ----------
    lengths : numpy.ndarray, shape (..., m)
        l_i, m.
    directions : numpy.ndarray, shape (..., m, 3)
        Unit vectors u_i from the platform to the exit point, in base axes.
    arms : numpy.ndarray, shape (..., m, 3)
        r_i = Q b_i, from the platform's origin to the anchor point, in base axes, m.
    wrench_matrix : numpy.ndarray, shape (..., 6, m)
        A, column i [u_i; r_i x u_i]: `A @ t` is the wrench of tensions t on the platform about its origin,
        in base axes.
    jacobian : numpy.ndarray, shape (..., m, 6)
        J = -A^T: `J @ [v; omega]` are the rates of cable length.
    """

    lengths: FloatArray
    directions: FloatArray
    arms: FloatArray
    wrench_matrix: FloatArray
    jacobian: FloatArray

    def __post_init__(self) -> None:
        for array in (self.lengths, self.directions, self.arms, self.wrench_matrix, self.jacobian):
            array.setflags(write=False)


def inverse_kinematics(robot: Robot, pose: Pose) -> Cables:
    """Return cable lengths, directions and Jacobian at `pose`.

    Parameters
    ----------
    robot : Robot
    pose : Pose
        One pose or a batch.

    Raises
    ------
    InvalidInputError
        If an anchor point coincides with its exit point (within a micrometre): the cable has no
        direction there.
    """
    geometry = cable_geometry(robot.exit_points, robot.anchor_points, pose.position, pose.rotation)
    lengths, directions, arms = geometry
    if lengths.size and lengths.min() < SHORTEST_CABLE:
        raise InvalidInputError("pose", pose.position, "an anchor point coincides with its exit point")
    columns = geometry.wrench_columns()
    return Cables(lengths, directions, arms, columns.swapaxes(-1, -2), np.negative(columns))
