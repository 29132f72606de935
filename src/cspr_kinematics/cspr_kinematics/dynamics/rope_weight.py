"""The weight of the ropes, in terms of what load cells at the frame show (docs/model.md, section 4b)."""

from __future__ import annotations

import math

import numpy as np

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.compiled import kernel_input
from cspr_kinematics.dynamics._dynamics import GRAVITY_Z
from cspr_kinematics.dynamics._rope_weight import rope_wrenches
from cspr_kinematics.kinematics.inverse import Cables
from cspr_kinematics.robot.robot import Robot


def rope_wrench(robot: Robot, cables: Cables) -> FloatArray:
    """Return what straight ropes under the tensions at the frame would give the platform too much: w_r = A t - w.

    A rope of weight W between frame and platform pulls harder at its upper end, where the load cell is, and half
    of it hangs on the platform. With t the tensions at the frame and w the wrench on the platform,

        A t = w + w_r,   w_r = sum over the cables of (W_i / 2) [e_i; r_i x e_i],   e_i = z + (u_i . z) u_i

    so that `required_wrench` + w_r is what tensions at the frame must satisfy, and A t - w_r what measured ones
    say of the platform. To first order in W / t: what is left out, W^2 / (8 t), is a hundredth of a newton for a
    rope of 5 N under 300 N.

    Parameters
    ----------
    robot : Robot
        Of which the ropes are.
    cables : Cables
        From `inverse_kinematics`, at one pose or a batch.

    Returns
    -------
    numpy.ndarray, shape (..., 6)
        Force and moment about the platform's origin, in base axes, N and N m; zero without weight.
    """
    if not robot.cables.weigh:
        return np.zeros((*cables.lengths.shape[:-1], 6))
    *batch, m = cables.lengths.shape
    n = math.prod(batch)
    halves = -0.5 * GRAVITY_Z * robot.cables.mass_per_metre * cables.free_lengths
    wrench = np.empty((n, 6))
    rope_wrenches(
        kernel_input(halves, n, m),
        kernel_input(cables.directions, n, m, 3),
        kernel_input(cables.arms, n, m, 3),
        wrench,
    )
    return wrench.reshape(*batch, 6)
