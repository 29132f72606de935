"""The machine at rest: how its cables are wound when it is homed, and where bodies hang with the forces that act."""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from cspr_drivers.errors import DriverError
from cspr_drivers.simulation.simulation_config import CableProperties
from cspr_kinematics import Payload, Robot, distribute_tensions, inverse_kinematics, static_wrench

FloatArray = NDArray[np.float64]

GRAVITY = 9.81  # m/s^2
_HOMING_STEPS = 6

_NUDGE = 1e-6  # m and rad, of the differences that stand for derivatives
_LONGEST_STEP = 0.02  # m and rad; cables may go slack on the way, where Newton's step tells little
_MOST_STEPS = 50
_BALANCED = 1e-9  # share of the largest force on the way that may be left: that of rounding


class PlantError(DriverError):
    """The simulated machine cannot be built or has left the range in which it is a model of anything."""


def free_lengths_at_home(robot: Robot, properties: CableProperties) -> FloatArray:
    """Return the free lengths with which the empty platform hangs still at the home pose, m. (m,).

    Of all tensions that hold it those of least effort within the limits: so are the cables wound when the motors are
    given their zero.

    Raises
    ------
    PlantError
        If there are none.
    """
    cables = inverse_kinematics(robot, robot.home)
    rise = cables.directions[:, 2] * cables.free_lengths
    free = cables.lengths
    for _ in range(
        _HOMING_STEPS
    ):  # their weight follows from their free lengths, and hardly changes with them
        weight = properties.mass_per_metre * GRAVITY * free
        hanging = np.zeros((len(free), 3))
        hanging[:, 2] = 0.5 * weight
        wrench = static_wrench(robot, robot.home, Payload.none())
        wrench = wrench + np.concatenate((hanging.sum(axis=0), np.cross(cables.arms, hanging).sum(axis=0)))
        held = distribute_tensions(
            cables.wrench_matrix, wrench, robot.tension_min, robot.tension_max, method="closest"
        )
        if not held.feasible:
            raise PlantError(
                f"no cable tensions within the limits of {robot.name} hold the empty platform at the home pose"
            )
        dead, pull = properties.dead_length, held.tensions
        across = (weight / free) ** 2 * (cables.free_lengths**2 - rise**2)
        arc = cables.lengths + across * cables.free_lengths / (24.0 * pull**2)
        free = (arc + dead) / (1.0 + pull / properties.axial_stiffness) - dead
    return free


def settle(
    model: mujoco.MjModel, data: mujoco.MjData, dofs: slice, net_force: Callable[[], FloatArray]
) -> bool:
    """Move bodies to where they are in balance, all else held; return whether there is such a place.

    Parameters
    ----------
    model, data
        Of MuJoCo; `data` begins near the equilibrium, and ends in it.
    dofs
        Degrees of freedom that may move.
    net_force
        Returns the generalised force on `dofs` with the bodies where `data` has them, N and N m.
    """
    start = data.qpos.copy()
    count = dofs.stop - dofs.start
    away = np.zeros(model.nv)  # from the start, as a velocity for one second

    def force(at: FloatArray) -> FloatArray:
        away[dofs] = at
        data.qpos[:] = start
        mujoco.mj_integratePos(model, data.qpos, away, 1.0)
        return net_force().copy()

    place = np.zeros(count)
    left = force(place)
    scale = float(np.abs(left).max())
    for _ in range(_MOST_STEPS):
        stiffness = np.empty((count, count))
        for axis in range(count):
            nudge = np.zeros(count)
            nudge[axis] = _NUDGE
            stiffness[:, axis] = (force(place + nudge) - force(place - nudge)) / (2.0 * _NUDGE)
        scale = max(scale, float(np.abs(stiffness).max()) * _NUDGE)
        step = -np.linalg.lstsq(stiffness, left, rcond=None)[0]
        place = place + step * min(1.0, _LONGEST_STEP / max(float(np.abs(step).max()), _LONGEST_STEP))
        left = force(place)
        if float(np.abs(left).max()) <= _BALANCED * scale:
            return True
    return False
