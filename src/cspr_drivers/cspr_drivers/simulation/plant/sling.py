"""A payload that hangs on a sling: a point mass with a motion of its own, which a table may carry."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from cspr_drivers.simulation.plant.equilibrium import GRAVITY
from cspr_drivers.simulation.simulation_config import Sling
from cspr_kinematics import Payload

FloatArray = NDArray[np.float64]

_NOTHING = 1e-6  # kg; MuJoCo wants bodies with mass


class SlingLoad:
    """The body `load` of the model of `machine_mjcf`, and the elastic sling on which it hangs on the platform.

    Parameters
    ----------
    model, data
        Of MuJoCo.
    table_height
        Of what the load rests on when it comes down there, m.

    Attributes
    ----------
    sling
        What it hangs on, `None` while there is no load.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, table_height: float) -> None:
        self._model, self._data = model, data
        self._table_height = table_height
        self._body, self._geom = model.body("load").id, int(model.body("load").geomadr[0])
        position, motion = int(model.joint("load_x").qposadr[0]), int(model.joint("load_x").dofadr[0])
        self._position: FloatArray = data.qpos[position : position + 3]
        self._velocity: FloatArray = data.qvel[motion : motion + 3]
        self._carried: FloatArray = data.qfrc_constraint[motion : motion + 3]
        self._held: FloatArray = data.qfrc_applied[motion : motion + 3]
        platform, motion = int(model.joint("platform").qposadr[0]), int(model.joint("platform").dofadr[0])
        self._platform: FloatArray = data.qpos[platform : platform + 7]
        self._platform_velocity: FloatArray = data.qvel[motion : motion + 6]
        self._hook: FloatArray = model.site("hook").pos
        self._tendon = model.tendon("sling").id
        self.sling: Sling | None = None
        self.hang(Payload.none(), None)

    @property
    def mass(self) -> float:
        """What the platform carries of it, kg: what the table does not."""
        if self.sling is None:
            return 0.0
        return max(0.0, float(self._model.body_mass[self._body]) - float(self._carried[2]) / GRAVITY)

    def hang(self, payload: Payload, sling: Sling | None) -> None:
        """Hang a payload on a sling, from what is its centre of mass without one; no sling takes it away.

        A load that hangs already stays where it is and only changes its mass and its sling. `mj_setConst` is to be
        called afterwards.
        """
        hangs = self.sling is not None
        self.sling = sling if payload.mass > 0.0 else None
        there = self.sling is not None
        mass = payload.mass if there else _NOTHING
        self._model.body_mass[self._body] = mass
        self._model.body_inertia[self._body] = mass * 1e-6
        self._model.geom_contype[self._geom] = self._model.geom_conaffinity[self._geom] = 2 if there else 0
        self._held[2] = 0.0 if there else mass * GRAVITY  # what is nothing does not fall
        self._hook[:] = payload.center_of_mass
        if not hangs:
            self.place()

    def place(self) -> None:
        """Put the load where it hangs still under the platform, or as its sling is deflected, or on the table."""
        hook, velocity = np.zeros(3), np.zeros(3)
        turn = self._platform[3:] / np.linalg.norm(self._platform[3:])
        mujoco.mju_rotVecQuat(hook, self._hook, turn)
        mujoco.mju_rotVecQuat(velocity, np.cross(self._platform_velocity[3:], self._hook), turn)
        reach = np.zeros(3)
        if self.sling is not None:
            direction = np.array([*np.tan(self.sling.deflection), -1.0])
            direction /= np.linalg.norm(direction)
            stretch = self._model.body_mass[self._body] * GRAVITY / self.sling.stiffness
            reach = direction * (self.sling.length + stretch)
        self._position[:] = self._platform[:3] + hook + reach
        self._velocity[:] = self._platform_velocity[:3] + velocity if self.sling is not None else 0.0
        if self.sling is not None and self._position[2] < self._table_height:
            self._position[2] = self._table_height
            self._velocity[:] = 0.0

    def pull(self) -> None:
        """Let the sling pull at platform and load, by length and rate as they are."""
        pull = 0.0
        if self.sling is not None:
            stretch = float(self._data.ten_length[self._tendon]) - self.sling.length
            if stretch > 0.0:
                rate = float(self._data.ten_velocity[self._tendon])
                pull = max(0.0, self.sling.stiffness * (stretch + self.sling.damping_time * rate))
        self._data.ctrl[-1] = -pull
