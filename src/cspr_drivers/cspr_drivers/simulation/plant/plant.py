"""The simulated machine: platform, payload, elastic cables and winches in MuJoCo.

MuJoCo integrates the rigid bodies and the winch shafts (inertia, dry and viscous friction, brake) and measures
the geometric length of each cable. The law of the cables, and their way over pulleys, stand in `cable_force`. Pulleys
have no mass: before each step the cable's end at the frame is moved to where it leaves its pulley. What comes down on
the floor, or on its sling on a table, is MuJoCo's contact.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from cspr_drivers.simulation.plant.cable_force import cable_and_motor_forces, lead_over_pulleys
from cspr_drivers.simulation.plant.equilibrium import GRAVITY, PlantError, free_lengths_at_home, settle
from cspr_drivers.simulation.plant.mjcf import machine_mjcf
from cspr_drivers.simulation.plant.sling import SlingLoad
from cspr_drivers.simulation.simulation_config import CableProperties, SimulationConfig, Sling
from cspr_kinematics import Payload

FloatArray = NDArray[np.float64]

_SHORTEST_STEP = 1e-7  # s; what is left to a moment that rounding put apart is no step


class Plant:
    """Platform on elastic cables from motorised winches, integrated on demand.

    Nothing runs by itself: `advance` integrates up to a time with the inputs as they are. Set inputs after
    advancing to the moment at which they change. All motor quantities are at the motor shaft, positive angle pays
    out, zero at the home pose. Not thread-safe: the caller serialises.

    Parameters
    ----------
    config
        The true machine. Its motors have their zero where they hold the empty platform at the home pose. The plant
        starts at rest with brakes closed, its payload aboard, lower than home by what the cables stretch under it.

    Raises
    ------
    PlantError
        If cables within the limits of their tensions hold the empty platform at the home pose, or the platform with
        its payload, nowhere.
    """

    def __init__(self, config: SimulationConfig) -> None:
        self._config = config
        self._robot = robot = config.robot
        self._cables: CableProperties = config.cables
        m = robot.number_of_cables
        self._model = mujoco.MjModel.from_xml_string(
            machine_mjcf(robot, config.time_step, config.table_height if config.has_sling else None)
        )
        # MuJoCo looks for what lies at its body's origin, to compute less for it; an older one looks only once, but
        # payload, hook and exits will be moved.
        self._model.body_sameframe[:] = self._model.site_sameframe[:] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE
        self._data = mujoco.MjData(self._model)
        self._scratch = mujoco.MjData(self._model)  # mj_setConst overwrites the data that it is given
        self._payload_body = self._model.body("payload").id
        shaft = np.array([self._model.joint(f"shaft_{i}").dofadr[0] for i in range(m)])
        self._shaft = slice(int(shaft[0]), int(shaft[-1]) + 1)
        self._shaft_position = slice(
            int(self._model.joint("shaft_0").qposadr[0]),
            int(self._model.joint(f"shaft_{m - 1}").qposadr[0]) + 1,
        )
        platform_dof = int(self._model.joint("platform").dofadr[0])
        self._platform_dofs = slice(platform_dof, platform_dof + 6)
        self._friction = np.full(m, robot.motor.coulomb_friction)
        self._torque_input = np.zeros(m)
        self._applied_torque = np.zeros(m)
        self._damping = np.zeros(m)
        self._tensions = np.zeros(m)
        self._brake_share = np.ones(m)
        self._transmission_ratio = robot.winch.transmission_ratio  # m of cable per rad of the motor
        exits = [self._model.site(f"exit_{i}").id for i in range(m)]
        platform = int(self._model.joint("platform").qposadr[0])
        self._platform: FloatArray = self._data.qpos[platform : platform + 7]
        self._pulleys = (
            robot.exit_points,
            robot.anchor_points,
            robot.pulleys.radii(m),
            robot.pulleys.axes(m),
            self._platform,
            self._model.site_pos[exits[0] : exits[-1] + 1],
        )
        self._has_pulleys = bool(robot.pulleys.radii(m).any())
        self._wrapped = np.zeros(m)
        cables = self._cables
        self._cable_constants = np.array(
            [
                self._transmission_ratio,
                cables.axial_stiffness,
                cables.damping_time,
                cables.dead_length,
                cables.mass_per_metre * GRAVITY,
                cables.pulley_friction,
            ]
        )
        self._free_lengths_at_home = free_lengths_at_home(robot, config.cables)
        # MuJoCo's arrays are views of memory that stays where it is.
        self._angles: FloatArray = self._data.qpos[self._shaft_position]
        self._speeds: FloatArray = self._data.qvel[self._shaft]
        anchor, body, motor = self._model.site("anchor_0").id, self._model.body("platform").id, robot.motor
        self._forces = (
            self._data.ten_length[:m],
            self._data.ten_velocity[:m],
            self._wrapped,
            self._angles,
            self._speeds,
            self._data.site_xpos[exits[0] : exits[-1] + 1],
            self._data.site_xpos[anchor : anchor + m],
            self._data.xipos[body],
            self._free_lengths_at_home,
            self._cable_constants,
            self._torque_input,
            self._damping,
            np.array(
                [motor.torque_limit, motor.speed_limit, motor.speed_limit * config.drive.no_load_speed_ratio]
            ),
            self._tensions,
            self._applied_torque,
            self._data.ctrl,
            self._data.xfrc_applied[body],
        )
        for index in range(m):
            self.set_brake(index, closed=True)
        self._load = SlingLoad(self._model, self._data, config.table_height) if config.has_sling else None
        self._aboard = config.payload
        self._growth: tuple[float, float, Payload, Payload] | None = None
        self._carry(config.payload, config.sling)
        self._settle()

    def _settle(self) -> None:
        """Hang the platform and its payload still on the cables as they are."""
        at_rest = settle(self._model, self._data, self._platform_dofs, self._net_force)
        if not at_rest or (self._tensions > self._robot.tension_max).any():
            raise PlantError(
                f"the cables of {self._robot.name} do not hold a payload of {self.payload.mass:g} kg at the home pose "
                "within the limits of their tensions: reduce the payload in simulation.yaml"
            )

    def _net_force(self) -> FloatArray:
        """Force and moment on the platform at rest where it is, N and N m. (6,)."""
        model, data = self._model, self._data
        if self._load is not None:
            self._load.place()
        self._turn_pulleys()
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        self._apply_forces()
        mujoco.mj_fwdActuation(model, data)
        mujoco.mj_fwdAcceleration(model, data)
        force: FloatArray = data.qfrc_smooth[self._platform_dofs]
        return force

    @property
    def time(self) -> float:
        """Time since the plant was made, s."""
        return float(self._data.time)

    @property
    def payload(self) -> Payload:
        """What the platform carries now; of a load that a table carries in part, the rest of it."""
        if self._load is None or self._load.sling is None:
            return self._aboard
        return Payload(self._load.mass, self._aboard.center_of_mass)

    def set_payload(self, payload: Payload, duration: float = 0.0, sling: Sling | None = None) -> None:
        """Put a point mass on the platform in place of what it carries, moving with the platform from now on.

        Parameters
        ----------
        payload
            What it carries in the end.
        duration
            How long it takes, s: as when a load is lifted off a table, mass and moment of mass pass over evenly.
        sling
            On which the mass hangs on the platform, for one that does not move with it; comes aboard at once. It
            begins still under the platform or as the sling is deflected, but no lower than on the table.

        Raises
        ------
        PlantError
            If the machine was made without a sling.
        """
        grows = duration > 0.0 and sling is None and (self._load is None or self._load.sling is None)
        self._growth = (self.time, duration, self._aboard, payload) if grows else None
        if self._growth is None:
            self._carry(payload, sling)

    def _grow(self, time: float) -> None:
        """Carry at a time, s, what is aboard of a payload that grows."""
        if self._growth is None:
            return
        begin, duration, before, after = self._growth
        share = (time - begin) / duration
        if share > 1.0 - 1e-9:
            self._growth = None
            self._carry(after)
            return
        mass = before.mass + share * (after.mass - before.mass)
        moment = (1.0 - share) * before.mass * before.center_of_mass
        moment += share * after.mass * after.center_of_mass
        self._carry(Payload(mass, moment / mass if mass > 0.0 else after.center_of_mass))

    def _carry(self, payload: Payload, sling: Sling | None = None) -> None:
        body, model = self._payload_body, self._model
        if self._load is not None:
            self._load.hang(payload, sling)
        elif sling is not None:
            raise PlantError("the simulated machine was made for payloads without a sling")
        # MuJoCo wants a body with mass and inertia; a milligram stands for no payload
        mass = max(payload.mass if sling is None else 0.0, 1e-6)
        model.body_mass[body] = mass
        model.body_inertia[body] = mass * 1e-4
        model.body_ipos[body] = payload.center_of_mass
        mujoco.mj_setConst(model, self._scratch)
        self._aboard = payload

    def set_torque(self, index: int, torque: float) -> None:
        """Set the torque that a drive applies to its motor shaft, N m."""
        self._torque_input[index] = torque

    def set_damping(self, index: int, gain: float) -> None:
        """Set the velocity feedback with which a drive brakes its motor by itself, N m s/rad; 0 turns it off."""
        self._damping[index] = gain

    def set_brake(self, index: int, closed: bool) -> None:
        """Close or open the holding brake of a motor."""
        held = self._brake_share[index] * self._config.brake.holding_torque if closed else 0.0
        self._model.dof_frictionloss[self._shaft.start + index] = self._friction[index] + held

    def weaken_brake(self, index: int, share: float) -> None:
        """Let the brake of a motor hold a share of its torque from the next time it closes; 1 repairs it."""
        self._brake_share[index] = share

    def slip_cable(self, index: int, length: float) -> None:
        """Let a cable slip on its drum: a length of it, m, is paid out without turning the motor."""
        self._free_lengths_at_home[index] += length

    def catch_platform(self, caught: bool) -> None:
        """Let an obstacle hold the platform's origin where it is, or let it go again."""
        self._model.equality("obstacle").data[3:6] = self.platform_position()
        self._data.eq_active[self._model.equality("obstacle").id] = caught

    def motor_angles(self) -> FloatArray:
        """Angles of the motor shafts, rad. (m,)."""
        return self._angles.copy()

    def motor_speeds(self) -> FloatArray:
        """Speeds of the motor shafts, rad/s. (m,)."""
        return self._speeds.copy()

    def motor_torques(self) -> FloatArray:
        """Torques that the drives apply, saturated at the limit of the motors, N m. (m,)."""
        return self._applied_torque.copy()

    def tensions(self) -> FloatArray:
        """Tensions of the cables where load cells sense them, between drum and pulley, N. (m,)."""
        return self._tensions.copy()

    def platform_position(self) -> FloatArray:
        """Position of the platform's origin in the base frame, m. (3,)."""
        return self._platform[:3].copy()

    def platform_quaternion(self) -> FloatArray:
        """Orientation of the platform in the base frame, x, y, z, w with w >= 0. (4,)."""
        w, *xyz = self._platform[3:].tolist()
        return np.array((*xyz, w)) if w >= 0.0 else -np.array((*xyz, w))

    def load_position(self) -> FloatArray:
        """Position of a payload on a sling in the base frame, m. (3,); the machine must be made for one."""
        return np.array(self._data.body("load").xpos)

    def advance(self, time: float) -> None:
        """Integrate to a time (s since the plant was made) with the inputs as they are; earlier times do nothing.

        The time is met exactly, in equal steps of at most the configured length: what encoders sense belongs to
        the requested moment.

        Raises
        ------
        PlantError
            If the integration diverges, or an anchor point gets into its pulley.
        """
        data, model = self._data, self._model
        span = time - data.time
        if span <= _SHORTEST_STEP:
            return
        steps = math.ceil(span / self._config.time_step - 1e-6)
        model.opt.timestep = span / steps
        for _ in range(steps):
            self._grow(data.time + model.opt.timestep)
            if self._has_pulleys:
                self._turn_pulleys()
            mujoco.mj_step1(model, data)  # lengths and rates of the present state
            self._apply_forces()
            mujoco.mj_step2(model, data)
        # what load cells sense belongs to the requested moment too, not to the beginning of the last step
        if self._has_pulleys:
            self._turn_pulleys()
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        self._apply_forces()
        if data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number:
            raise PlantError(f"the simulated machine diverged at t = {data.time:.4f} s")

    def _turn_pulleys(self) -> None:
        """Let the cables leave their pulleys where they do at the present pose; nothing without pulleys."""
        inside = lead_over_pulleys(*self._pulleys, self._wrapped)
        if inside >= 0:
            raise PlantError(
                f"cable {inside + 1} of the simulated machine has its anchor point inside its pulley at "
                f"t = {self._data.time:.4f} s"
            )

    def _apply_forces(self) -> None:
        """Set the forces of cables and drives from lengths, rates, angles and speeds as they are."""
        cable_and_motor_forces(*self._forces)
        if self._load is not None:
            self._load.pull()
