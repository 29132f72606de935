"""The robot: geometry, platform, winches, motors and limits, validated and immutable."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from .arrays import FloatArray, checked, frozen, non_negative_number, positive_number
from .cable_paths import path_geometry, path_lengths
from .errors import CableReachError, InvalidInputError
from .pose import Pose
from .pulleys import UPWARDS, Pulleys
from .rigid_body import RigidBody
from .robot_file import Section, read_yaml
from .winch import Motor, Winch

MINIMUM_CABLES = 6
# A winch whose zero is off by more than this was not set up for this home pose, m.
_HOME_LENGTH_TOLERANCE = 1e-6

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


@dataclass(frozen=True, eq=False)
class Robot:
    """A cable-suspended parallel robot with m cables, from fixed exit points or over swivelling pulleys.

    Attributes
    ----------
    name : str
    exit_points : numpy.ndarray, shape (m, 3)
        a_i in base, where the cable leaves the frame, or runs onto its pulley, m.
    anchor_points : numpy.ndarray, shape (m, 3)
        b_i in platform, m.
    frame_size : numpy.ndarray, shape (3,)
        Outer dimensions of the frame along base x, y, z, m.
    platform : RigidBody
        The platform without payload.
    platform_size : numpy.ndarray, shape (3,)
        Outer dimensions of the platform along its axes, m.
    winch : Winch
    motor : Motor
    tension_min, tension_max : float
        Limits of every cable's tension, N.
    home : Pose
        Where all motor angles are zero.
    workspace_min, workspace_max : numpy.ndarray, shape (3,)
        Bounds of the platform's origin in base, m.
    trajectory_center : numpy.ndarray, shape (3,)
        Place in base about which the test trajectories run, m.
    pulleys : Pulleys
        At the exit points; by default of radius 0, which is no pulley.

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape; with fewer than 6 cables, or not as many anchor
        points or pulleys as exit points; if limits are not in order, the home pose or the trajectories'
        centre lies outside the workspace, or the winch's home lengths are not the cable lengths at the home
        pose.
    """

    name: str
    exit_points: FloatArray
    anchor_points: FloatArray
    frame_size: FloatArray
    platform: RigidBody
    platform_size: FloatArray
    winch: Winch
    motor: Motor
    tension_min: float
    tension_max: float
    home: Pose
    workspace_min: FloatArray
    workspace_max: FloatArray
    trajectory_center: FloatArray
    pulleys: Pulleys = field(default_factory=Pulleys.none)

    def __post_init__(self) -> None:
        self._set("exit_points", _points("exit_points", self.exit_points))
        self._set("anchor_points", _points("anchor_points", self.anchor_points))
        _check_cables(self.exit_points, self.anchor_points)
        for name in ("frame_size", "platform_size", "workspace_min", "workspace_max", "trajectory_center"):
            self._set(name, _vector(name, getattr(self, name)))
        for name in ("frame_size", "platform_size"):
            if getattr(self, name).min() <= 0.0:
                raise InvalidInputError(name, getattr(self, name), "every dimension must be positive")
        self._set("tension_min", non_negative_number("tension_min", self.tension_min))
        self._set("tension_max", positive_number("tension_max", self.tension_max))
        if self.tension_min >= self.tension_max:
            raise InvalidInputError(
                "tension_min", self.tension_min, f"must be below tension_max = {self.tension_max}"
            )
        self._check_workspace()
        self._check_home()

    @property
    def number_of_cables(self) -> int:
        """The number of cables, m."""
        return len(self.exit_points)

    @cached_property
    def path_geometry(self) -> FloatArray:
        """What the kernels know of the cables, (m, 10): exit and anchor points, pulley radii, swivel axes."""
        return path_geometry(self.exit_points, self.anchor_points, self.pulleys)

    def with_geometry(
        self,
        *,
        exit_points: ArrayLike | None = None,
        anchor_points: ArrayLike | None = None,
        pulleys: Pulleys | None = None,
        home: Pose | None = None,
    ) -> Robot:
        """Return this robot with other points, pulleys or home pose, and the winches' zero set for them.

        Raises
        ------
        InvalidInputError
            As the constructor.
        """
        exits = self.exit_points if exit_points is None else _points("exit_points", exit_points)
        anchors = self.anchor_points if anchor_points is None else _points("anchor_points", anchor_points)
        pulleys = self.pulleys if pulleys is None else pulleys
        home = self.home if home is None else home
        lengths = home_lengths(exits, anchors, home, pulleys)
        return dataclasses.replace(
            self,
            exit_points=exits,
            anchor_points=anchors,
            pulleys=pulleys,
            home=home,
            winch=dataclasses.replace(self.winch, home_lengths=lengths),
        )

    @classmethod
    def from_yaml(cls, path: str | Path) -> Robot:
        """Read a robot from a YAML file; `config/robot.yaml` documents the keys.

        Raises
        ------
        RobotFileError
            If the file is missing or not YAML, and for each value that cannot be used, naming file, key
            and value.
        """
        return cls.from_mapping(read_yaml(path), source=str(path))

    @classmethod
    def from_mapping(cls, mapping: object, source: str = "robot description") -> Robot:
        """Build a robot from the content of its YAML file.

        Parameters
        ----------
        mapping : object
            What the YAML file holds: a mapping with exactly the documented keys.
        source : str
            Where it came from, for errors.

        Raises
        ------
        RobotFileError
            For each value that cannot be used, naming source, key and value.
        """
        top = Section(source, mapping, _ROBOT_KEYS, optional=_OPTIONAL_ROBOT_KEYS)
        exit_points = top.array("exit_points", None, 3)
        anchor_points = top.array("anchor_points", None, 3)
        home = _read_home(top.section("home", _HOME_KEYS))
        with top.constructing():
            _check_cables(exit_points, anchor_points)
        pulleys = Pulleys.none()
        if "pulleys" in top:
            pulleys = _read_pulleys(
                top.section("pulleys", _PULLEY_KEYS, optional=_OPTIONAL_PULLEY_KEYS), len(exit_points)
            )
        with top.constructing():
            lengths = home_lengths(exit_points, anchor_points, home, pulleys)
        platform = _read_platform(top.section("platform", _PLATFORM_KEYS))
        winch = _read_winch(top.section("winch", _WINCH_KEYS), lengths)
        motor = _read_motor(top.section("motor", _MOTOR_KEYS))
        with top.constructing():
            return cls(
                name=top.text("name"),
                exit_points=exit_points,
                anchor_points=anchor_points,
                frame_size=top.array("frame_size", 3),
                platform=platform,
                platform_size=top.array("platform_size", 3),
                winch=winch,
                motor=motor,
                tension_min=top.number("tension_min"),
                tension_max=top.number("tension_max"),
                home=home,
                workspace_min=top.array("workspace_min", 3),
                workspace_max=top.array("workspace_max", 3),
                trajectory_center=top.array("trajectory_center", 3),
                pulleys=pulleys,
            )

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _check_workspace(self) -> None:
        if np.any(self.workspace_min >= self.workspace_max):
            raise InvalidInputError(
                "workspace_min",
                self.workspace_min,
                f"must be below workspace_max = {self.workspace_max.tolist()} in every direction",
            )
        for name, point in (("home", self.home.position), ("trajectory_center", self.trajectory_center)):
            if np.any(point < self.workspace_min) or np.any(point > self.workspace_max):
                raise InvalidInputError(name, point, "outside workspace_min to workspace_max")

    def _check_home(self) -> None:
        lengths = home_lengths(self.exit_points, self.anchor_points, self.home, self.pulleys)
        given = self.winch.home_lengths
        if given.shape != lengths.shape or np.abs(given - lengths).max() > _HOME_LENGTH_TOLERANCE:
            raise InvalidInputError(
                "winch", given, f"home_lengths must be the cable lengths at home, {lengths.tolist()}"
            )


def home_lengths(
    exit_points: ArrayLike, anchor_points: ArrayLike, home: Pose, pulleys: Pulleys | None = None
) -> FloatArray:
    """Return the cable lengths (m,) at a home pose, which are the zero of the winches, m.

    For whoever builds a robot from other points than a file's: `Winch.home_lengths` must fit them, and with
    pulleys they are not the distances of the points.

    Parameters
    ----------
    exit_points, anchor_points : array_like, shape (m, 3)
        In base and in platform, m.
    home : Pose
        A single pose.
    pulleys : Pulleys, optional
        None for fixed exit points.

    Raises
    ------
    InvalidInputError
        If the points do not fit each other or the pulleys, home is a batch, or a cable has no path there.
    """
    exits, anchors = _points("exit_points", exit_points), _points("anchor_points", anchor_points)
    _check_cables(exits, anchors)
    if home.batch_shape:
        raise InvalidInputError("home", home.position, "must be a single pose")
    geometry = path_geometry(exits, anchors, Pulleys.none() if pulleys is None else pulleys)
    try:
        return path_lengths(geometry, home)
    except CableReachError as error:
        raise InvalidInputError(
            "home", home.position, f"cable {error.cable} has no length at this pose; {error.fault}"
        ) from error


def _points(name: str, value: ArrayLike) -> FloatArray:
    points = checked(name, value, 3)
    if points.ndim != 2:
        raise InvalidInputError(name, value, f"shape {points.shape} where (m, 3) is needed")
    return frozen(points)


def _vector(name: str, value: ArrayLike) -> FloatArray:
    vector = checked(name, value, 3)
    if vector.ndim != 1:
        raise InvalidInputError(name, value, f"shape {vector.shape} where (3,) is needed")
    return frozen(vector)


def _check_cables(exit_points: FloatArray, anchor_points: FloatArray) -> None:
    if len(exit_points) < MINIMUM_CABLES:
        raise InvalidInputError(
            "exit_points",
            exit_points,
            f"{len(exit_points)} cables; six degrees of freedom take at least {MINIMUM_CABLES}",
        )
    if len(anchor_points) != len(exit_points):
        raise InvalidInputError(
            "anchor_points",
            anchor_points,
            f"{len(anchor_points)} anchor points for {len(exit_points)} exit points",
        )


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
