"""The rigid bodies of the simulated machine, as a model in MuJoCo's own format."""

from __future__ import annotations

from cspr_drivers.simulation.plant.equilibrium import GRAVITY
from cspr_kinematics import Robot

# Dry friction and the brake are constraints in MuJoCo and creep under load as far as these are soft. With an
# impedance this close to 1 the brake slips by less than 1e-4 rad/s of the motor under the largest load.
_SHAFT_SOLVER = 'solreffriction="0.002 1" solimpfriction="0.9999 0.9999 0.001"'

# What lands sinks in by a tenth of a millimetre and hardly bounces: a time of 20 ms, critically damped.
_GROUND = 'solref="0.02 1" solimp="0.95 0.99 0.001" friction="0.5 0.005 0.0001"'
_POINT = 1e-3  # m, radius of the sphere that stands for a point


def machine_mjcf(robot: Robot, time_step: float, table_height: float | None) -> str:
    """Return the MuJoCo model of a robot: a free platform, one shaft per winch, one spatial tendon per cable.

    Parameters
    ----------
    robot
        The true robot. Its platform, a box of its size, rests on the floor at z = 0 if it comes down there.
    time_step
        s.
    table_height
        Height of what loads on a sling rest on, m; `None` for a machine without slings. With them there is a body
        `load` that moves freely, and after the cables a tendon `sling` from the site `hook` of the platform to it.
    """
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
    table = hook = load = sling = lift = ""
    if table_height is not None:
        top = _row((0.0, 0.0, table_height - _POINT))
        table = f'<geom name="table" type="plane" size="0 0 1" pos="{top}" {_ONLY_LOADS}/>'
        hook = '<site name="hook"/>'
        slides = "".join(
            f'<joint name="load_{axis}" type="slide" axis="{direction}"/>' for axis, direction in _AXES
        )
        load = (
            f'<body name="load"><inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/>{slides}'
            f'<geom type="sphere" size="{_POINT!r}" {_ONLY_LOADS} {_GROUND}/><site name="load"/></body>'
        )
        sling = '<spatial name="sling"><site site="hook"/><site site="load"/></spatial>'
        lift = '<motor tendon="sling"/>'
    return f"""
<mujoco>
  <option timestep="{time_step!r}" gravity="0 0 {-GRAVITY!r}" integrator="Euler"/>
  <compiler autolimits="true" angle="radian"/>
  <worldbody>{exits}
    <geom name="floor" type="plane" size="0 0 1"/>{table}
    <body name="platform" pos="{_row(home.position)}" quat="{_row((w, x, y, z))}"><freejoint name="platform"/>
      <inertial pos="{_row(body.center_of_mass)}" mass="{body.mass!r}" fullinertia="{_row(full)}"/>{anchors}{hook}
      <geom name="hull" type="box" size="{_row(robot.platform_size / 2.0)}" {_GROUND}/>
      <body name="payload"><inertial pos="0 0 0" mass="1e-6" diaginertia="1e-9 1e-9 1e-9"/></body>
    </body>{load}{shafts}
  </worldbody>
  <equality><connect name="obstacle" body1="platform" anchor="0 0 0" active="false"/></equality>
  <tendon>{tendons}{sling}</tendon>
  <actuator>{pulls}{torques}{lift}</actuator>
</mujoco>"""


_AXES = (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
_ONLY_LOADS = 'contype="2" conaffinity="2"'  # what else there is has 1


def _row(values: object) -> str:
    return " ".join(repr(float(value)) for value in values)  # type: ignore[attr-defined]
