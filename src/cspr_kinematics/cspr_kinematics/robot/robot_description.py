"""What a robot's file must hold, and the parts of a robot from it; `config/robot.yaml` documents the keys."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from msgspec import Meta

from cspr_kinematics.configuration.structure import (
    Text,
    Vector,
    located,
    structured,
)
from cspr_kinematics.motion.pose import Pose
from cspr_kinematics.robot.cable_paths import home_lengths
from cspr_kinematics.robot.cables import CableProperties
from cspr_kinematics.robot.pulleys import UPWARDS, Pulleys
from cspr_kinematics.robot.rigid_body import RigidBody
from cspr_kinematics.robot.winch import Motor, Winch

# What robots on cables have, with a wide margin: a slip of the keyboard lies outside.
Coordinate = Annotated[float, Meta(ge=-1000.0, le=1000.0)]
Point = tuple[Coordinate, Coordinate, Coordinate]
Points = Annotated[list[Point], Meta(min_length=1)]
Radius = Annotated[float, Meta(ge=0.0, le=10.0)]
Angle = Annotated[float, Meta(ge=-7.0, le=7.0)]
Tension = Annotated[float, Meta(ge=0.0, le=1e7)]
Stiffness = Annotated[float, Meta(ge=1.0, le=1e12)]
DampingTime = Annotated[float, Meta(ge=0.0, le=10.0)]
DeadLength = Annotated[float, Meta(ge=0.0, le=1000.0)]
MassPerMetre = Annotated[float, Meta(ge=0.0, le=1000.0)]
Moment = Annotated[float, Meta(ge=-1e8, le=1e8)]
Moments = tuple[Moment, Moment, Moment]

CABLE_CLEARANCE = 0.01  # m, where nothing is stated: a rope of 6 mm, and as much again for errors


@dataclass(frozen=True)
class PlatformEntry:
    """The platform without payload: mass in kg, centre of mass in m, inertia about it in kg m^2."""

    mass: Annotated[float, Meta(ge=1e-3, le=1e6)]
    center_of_mass: Point
    inertia: tuple[Moments, Moments, Moments]


@dataclass(frozen=True)
class WinchEntry:
    """The winches' transmission: radius of the drum in m, motor turns per drum turn."""

    drum_radius: Annotated[float, Meta(ge=1e-3, le=10.0)]
    gear_ratio: Annotated[float, Meta(ge=0.01, le=1e4)]

    @property
    def transmission_ratio(self) -> float:
        """Cable length per motor angle, m/rad."""
        return self.drum_radius / self.gear_ratio


@dataclass(frozen=True)
class HomeEntry:
    """The pose at which all motor angles are zero: position in m, angles about z, y, x in rad."""

    position: Point
    euler: tuple[Angle, Angle, Angle]


@dataclass(frozen=True)
class PulleysEntry:
    """The pulleys at the exit points: radius in m and swivel axis in base, for all cables or one for each."""

    radius: Radius | list[Radius]
    swivel_axis: tuple[float | Vector, ...] = UPWARDS

    def pulleys(self, number_of_cables: int, source: str, key: str) -> Pulleys:
        """Return the pulleys; `source` and `key` say where they are described.

        Raises
        ------
        ConfigurationFileError
            If they are those of another number of cables, or an axis is none.
        """
        with located(source, key):
            pulleys = Pulleys(self.radius, self.swivel_axis)
            pulleys.radii(number_of_cables)
            pulleys.axes(number_of_cables)
        return pulleys


@dataclass(frozen=True)
class CablesEntry:
    """The cables' axial stiffness in N, damping time in s, dead length in m, and mass in kg/m, for all or for each."""

    axial_stiffness: Stiffness | list[Stiffness]
    damping_time: DampingTime | list[DampingTime] = 0.0
    dead_length: DeadLength | list[DeadLength] = 0.0
    mass_per_metre: MassPerMetre | list[MassPerMetre] = 0.0

    def cables(self, number_of_cables: int, source: str, key: str) -> CableProperties:
        """Return the cables' properties, one for each; `source` and `key` say where they are described.

        Raises
        ------
        ConfigurationFileError
            If they are those of another number of cables.
        """
        with located(source, key):
            return CableProperties(**vars(self)).for_each(number_of_cables)


@dataclass(frozen=True)
class RobotDescription:
    """The content of a robot's file; units and meaning as of the attributes of `Robot`."""

    name: Text
    exit_points: Points
    anchor_points: Points
    frame_size: Point
    platform: PlatformEntry
    platform_size: Point
    winch: WinchEntry
    motor: Motor
    tension_min: Tension | list[Tension]
    tension_max: Tension | list[Tension]
    home: HomeEntry
    workspace_min: Point
    workspace_max: Point
    trajectory_center: Point
    pulleys: PulleysEntry | None = None
    cables: CablesEntry | None = None
    home_tensions: list[Tension] | None = None
    length_uncertainty: Annotated[float, Meta(ge=1e-6, le=1.0)] | None = None
    orientation_min: tuple[Angle, Angle, Angle] | None = None
    orientation_max: tuple[Angle, Angle, Angle] | None = None
    cable_clearance: Annotated[float, Meta(ge=0.0, le=1.0)] = CABLE_CLEARANCE


def robot_parts(mapping: object, source: str) -> dict[str, Any]:
    """Return the attributes of the `Robot` that a description stands for.

    Raises
    ------
    ConfigurationFileError
        For the first value that cannot be used, naming source, key and value.
    """
    file = structured(RobotDescription, mapping, source)
    exit_points, anchor_points = file.exit_points, file.anchor_points
    home = Pose.from_euler(file.home.position, *file.home.euler)
    pulleys = Pulleys.none()
    if file.pulleys is not None:
        pulleys = file.pulleys.pulleys(len(exit_points), source, "pulleys")
    cables = CableProperties()
    if file.cables is not None:
        cables = file.cables.cables(len(exit_points), source, "cables")
    with located(source):
        lengths = home_lengths(exit_points, anchor_points, home, pulleys)
    with located(source, "platform"):
        platform = RigidBody(file.platform.mass, file.platform.center_of_mass, file.platform.inertia)
    winch = Winch(file.winch.drum_radius, file.winch.gear_ratio, lengths)
    given = {name: value for name, value in vars(file).items() if name != "home_tensions"}
    given["measured_home_tensions"] = file.home_tensions
    return given | {"home": home, "pulleys": pulleys, "cables": cables, "platform": platform, "winch": winch}
