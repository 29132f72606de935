"""What a robot description must hold, and the parts of a robot from it; `config/robot.yaml` documents the keys."""

from __future__ import annotations

from typing import Any

from cspr_kinematics.arrays import FloatArray
from cspr_kinematics.motion.pose import Pose
from cspr_kinematics.robot.cable_paths import check_cables, home_lengths
from cspr_kinematics.robot.pulleys import UPWARDS, Pulleys
from cspr_kinematics.robot.rigid_body import RigidBody
from cspr_kinematics.robot.robot_file import Section
from cspr_kinematics.robot.winch import Motor, Winch

_ROBOT_KEYS = (
    "name",
    "exit_points",
    "anchor_points",
    "frame_size",
    "platform",
    "platform_size",
    "winch",
    "motor",
    "tension_min",
    "tension_max",
    "home",
    "workspace_min",
    "workspace_max",
    "trajectory_center",
)
_OPTIONAL_ROBOT_KEYS = ("pulleys",)
_PULLEY_KEYS = ("radius",)
_OPTIONAL_PULLEY_KEYS = ("swivel_axis",)
_PLATFORM_KEYS = ("mass", "center_of_mass", "inertia")
_WINCH_KEYS = ("drum_radius", "gear_ratio")
_MOTOR_KEYS = ("inertia", "torque_limit", "speed_limit", "coulomb_friction", "viscous_friction")
_HOME_KEYS = ("position", "euler")


def robot_section(mapping: object, source: str) -> Section:
    """Return the description of a robot, which has all its keys and no others.

    Raises
    ------
    ConfigurationFileError
        If it has not, or is no mapping.
    """
    return Section(source, mapping, _ROBOT_KEYS, optional=_OPTIONAL_ROBOT_KEYS)


def read_robot(top: Section) -> dict[str, Any]:
    """Return the attributes of the `Robot` that a description stands for.

    Raises
    ------
    ConfigurationFileError
        For each value that cannot be used, naming source, key and value.
    """
    exit_points = top.array("exit_points", None, 3)
    anchor_points = top.array("anchor_points", None, 3)
    home = _read_home(top.section("home", _HOME_KEYS))
    with top.constructing():
        check_cables(exit_points, anchor_points)
    pulleys = Pulleys.none()
    if "pulleys" in top:
        section = top.section("pulleys", _PULLEY_KEYS, optional=_OPTIONAL_PULLEY_KEYS)
        pulleys = _read_pulleys(section, len(exit_points))
    with top.constructing():
        lengths = home_lengths(exit_points, anchor_points, home, pulleys)
    return {
        "name": top.text("name"),
        "exit_points": exit_points,
        "anchor_points": anchor_points,
        "frame_size": top.array("frame_size", 3),
        "platform": _read_platform(top.section("platform", _PLATFORM_KEYS)),
        "platform_size": top.array("platform_size", 3),
        "winch": _read_winch(top.section("winch", _WINCH_KEYS), lengths),
        "motor": _read_motor(top.section("motor", _MOTOR_KEYS)),
        "tension_min": top.number("tension_min"),
        "tension_max": top.number("tension_max"),
        "home": home,
        "workspace_min": top.array("workspace_min", 3),
        "workspace_max": top.array("workspace_max", 3),
        "trajectory_center": top.array("trajectory_center", 3),
        "pulleys": pulleys,
    }


def _read_home(section: Section) -> Pose:
    position = section.array("position", 3)
    alpha, beta, gamma = section.array("euler", 3)
    with section.constructing():
        return Pose.from_euler(position, alpha, beta, gamma)


def _read_pulleys(section: Section, number_of_cables: int) -> Pulleys:
    radius = section.array_or_row("radius", number_of_cables)
    axis = section.array_or_row("swivel_axis", number_of_cables, 3) if "swivel_axis" in section else UPWARDS
    with section.constructing():
        return Pulleys(radius, axis)


def _read_platform(section: Section) -> RigidBody:
    mass = section.number("mass")
    center_of_mass = section.array("center_of_mass", 3)
    inertia = section.array("inertia", 3, 3)
    with section.constructing():
        return RigidBody(mass, center_of_mass, inertia)


def _read_winch(section: Section, home_lengths: FloatArray) -> Winch:
    drum_radius = section.number("drum_radius")
    gear_ratio = section.number("gear_ratio")
    with section.constructing():
        return Winch(drum_radius, gear_ratio, home_lengths)


def _read_motor(section: Section) -> Motor:
    values = {key: section.number(key) for key in _MOTOR_KEYS}
    with section.constructing():
        return Motor(**values)
