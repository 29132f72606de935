"""The simulated machine: platform, payload, elastic cables and winches in MuJoCo.

MuJoCo integrates the rigid bodies and the winch shafts (inertia, dry and viscous friction, brake) and measures
the geometric length of each cable. The law of the cables, and their way over pulleys, stand in `cable_force`. Pulleys
have neither mass nor friction: before each step the cable's end at the frame is moved to where it leaves its pulley.
"""

from __future__ import annotations

import math

import mujoco
import numpy as np
from numpy.typing import NDArray

from cspr_drivers.errors import DriverError
from cspr_drivers.simulation.plant.cable_force import cable_and_motor_forces, lead_over_pulleys
from cspr_drivers.simulation.simulation_config import CableProperties, SimulationConfig
from cspr_kinematics import Payload, Robot, distribute_tensions, inverse_kinematics, static_wrench

FloatArray = NDArray[np.float64]

_SHORTEST_STEP = 1e-7  # s; what is left to a moment that rounding put apart is no step

# Dry friction and the brake are constraints in MuJoCo and creep under load as far as these are soft. With an
# impedance this close to 1 the brake slips by less than 1e-4 rad/s of the motor under the largest load.
_SHAFT_SOLVER = 'solreffriction="0.002 1" solimpfriction="0.9999 0.9999 0.001"'


class PlantError(DriverError):
    """The simulated machine cannot be built or has left the range in which it is a model of anything."""


class Plant:
    """Platform on elastic cables from motorised winches, integrated on demand.

    Nothing runs by itself: `advance` integrates up to a time with the inputs as they are. Set inputs after
    advancing to the moment at which they change. All motor quantities are at the motor shaft, positive angle pays
    out, zero at the home pose. Not thread-safe: the caller serialises.

    Parameters
    ----------
    config
        The true machine. The plant starts at rest at the home pose, in equilibrium, with brakes closed.

    Attributes
    ----------
    payload
        What the platform carries now.

    Raises
    ------
    PlantError
        If no cable tensions hold the platform and its payload at the home pose.
    """

    def __init__(self, config: SimulationConfig) -> None:
        self._config = config
        self._robot = robot = config.robot
        self._cables: CableProperties = config.cables
        m = robot.number_of_cables
        self._model = mujoco.MjModel.from_xml_string(_mjcf(robot, config.time_step))
        self._data = mujoco.MjData(self._model)
        self._scratch = mujoco.MjData(self._model)  # mj_setConst overwrites the data that it is given
        self._payload_body = self._model.body("payload").id
        shaft = np.array([self._model.joint(f"shaft_{i}").dofadr[0] for i in range(m)])
        self._shaft = slice(int(shaft[0]), int(shaft[-1]) + 1)
        self._shaft_position = slice(
            int(self._model.joint("shaft_0").qposadr[0]),
            int(self._model.joint(f"shaft_{m - 1}").qposadr[0]) + 1,
        )
        self._friction = np.full(m, robot.motor.coulomb_friction)
        self._torque_input = np.zeros(m)
        self._applied_torque = np.zeros(m)
        self._damping = np.zeros(m)
        self._tensions = np.zeros(m)
        self._brake_share = np.ones(m)
        self._transmission_ratio = robot.winch.transmission_ratio  # m of cable per rad of the motor
        exits = [self._model.site(f"exit_{i}").id for i in range(m)]
        platform = int(self._model.joint("platform").qposadr[0])
        self._pulleys = (
            robot.exit_points,
            robot.anchor_points,
            robot.pulleys.radii(m),
            robot.pulleys.axes(m),
            self._data.qpos[platform : platform + 7],
            self._model.site_pos[exits[0] : exits[-1] + 1],
        )
        self._has_pulleys = bool(robot.pulleys.radii(m).any())
        self._wrapped = np.zeros(m)
        cables = self._cables
        self._cable_constants = np.array(
            [self._transmission_ratio, cables.axial_stiffness, cables.damping_time, cables.dead_length]
        )
        self.payload = Payload.none()
        self.set_payload(config.payload)
        self._free_lengths_at_home = self._equilibrium_free_lengths()
        # MuJoCo's arrays are views of memory that stays where it is.
        self._angles: FloatArray = self._data.qpos[self._shaft_position]
        self._speeds: FloatArray = self._data.qvel[self._shaft]
        self._forces = (
            self._data.ten_length,
            self._data.ten_velocity,
            self._wrapped,
            self._angles,
            self._speeds,
            self._free_lengths_at_home,
            self._cable_constants,
            self._torque_input,
            self._damping,
            robot.motor.torque_limit,
            self._tensions,
            self._applied_torque,
            self._data.ctrl,
        )
        for index in range(m):
            self.set_brake(index, closed=True)
        self._turn_pulleys()
        mujoco.mj_forward(self._model, self._data)
        self._apply_forces()

    def _equilibrium_free_lengths(self) -> FloatArray:
        """Free lengths with which the platform hangs still at the home pose, m. (m,)."""
        robot = self._robot
        cables = inverse_kinematics(robot, robot.home)
        held = distribute_tensions(
            cables.wrench_matrix,
            static_wrench(robot, robot.home, self.payload),
            robot.tension_min,
            robot.tension_max,
            method="closest",
        )
        if not held.feasible:
            raise PlantError(
                f"no cable tensions within {robot.tension_min:g}..{robot.tension_max:g} N hold the platform with a "
                f"payload of {self.payload.mass:g} kg at the home pose: reduce the payload in simulation.yaml"
            )
        stretch = held.tensions / self._cables.axial_stiffness
        dead = self._cables.dead_length
        free: FloatArray = (cables.lengths + dead) / (1.0 + stretch) - dead
        return free

    @property
    def time(self) -> float:
        """Time since the plant was made, s."""
        return float(self._data.time)

    def set_payload(self, payload: Payload) -> None:
        """Put a point mass on the platform in place of what it carries, moving with the platform from now on."""
        body, model = self._payload_body, self._model
        # MuJoCo wants a body with mass and inertia; a milligram stands for no payload
        model.body_mass[body] = max(payload.mass, 1e-6)
        model.body_inertia[body] = max(payload.mass, 1e-6) * 1e-4
        model.body_ipos[body] = payload.center_of_mass
        mujoco.mj_setConst(model, self._scratch)
        self.payload = payload

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
        """Tensions of the cables as they are, N. (m,)."""
        return self._tensions.copy()

    def platform_position(self) -> FloatArray:
        """Position of the platform's origin in the base frame, m. (3,)."""
        return np.array(self._data.body("platform").xpos)

    def platform_rotation(self) -> FloatArray:
        """Rotation of the platform in the base frame. (3, 3)."""
        return np.array(self._data.body("platform").xmat).reshape(3, 3)

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
            if self._has_pulleys:
                self._turn_pulleys()
            mujoco.mj_step1(model, data)  # lengths and rates of the present state
            self._apply_forces()
            mujoco.mj_step2(model, data)
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


def _mjcf(robot: Robot, time_step: float) -> str:
    """Return the MuJoCo model of a robot: a free platform, one shaft per winch, one spatial tendon per cable."""
    body = robot.platform
    inertia = body.inertia
    full = (inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2])
    m = range(robot.number_of_cables)
    motor = robot.motor
    home = robot.home
    x, y, z, w = home.quaternion
    exits = "".join(f'<site name="exit_{i}" pos="{_row(robot.exit_points[i])}"/>' for i in m)
    anchors = "".join(f'<site name="anchor_{i}" pos="{_row(robot.anchor_points[i])}"/>' for i in m)
    shafts = "".join(
        f'<body name="winch_{i}" pos="{_row(robot.exit_points[i])}"><inertial pos="0 0 0" mass="1e-3" '
        f'diaginertia="1e-9 1e-9 1e-9"/><joint name="shaft_{i}" type="hinge" armature="{motor.inertia!r}" '
        f'damping="{motor.viscous_friction!r}" frictionloss="{motor.coulomb_friction!r}" {_SHAFT_SOLVER}/></body>'
        for i in m
    )
    tendons = "".join(
        f'<spatial name="cable_{i}"><site site="exit_{i}"/><site site="anchor_{i}"/></spatial>' for i in m
    )
    pulls = "".join(f'<motor tendon="cable_{i}"/>' for i in m)
    torques = "".join(f'<motor joint="shaft_{i}"/>' for i in m)
    return f"""
<mujoco>
  <option timestep="{time_step!r}" gravity="0 0 -9.81" integrator="Euler"><flag contact="disable"/></option>
  <compiler autolimits="true" angle="radian"/>
  <worldbody>{exits}
    <body name="platform" pos="{_row(home.position)}" quat="{_row((w, x, y, z))}"><freejoint name="platform"/>
      <inertial pos="{_row(body.center_of_mass)}" mass="{body.mass!r}" fullinertia="{_row(full)}"/>{anchors}
      <body name="payload"><inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/></body>
    </body>{shafts}
  </worldbody>
  <equality><connect name="obstacle" body1="platform" anchor="0 0 0" active="false"/></equality>
  <tendon>{tendons}</tendon>
  <actuator>{pulls}{torques}</actuator>
</mujoco>"""


def _row(values: object) -> str:
    return " ".join(repr(float(value)) for value in values)  # type: ignore[attr-defined]
