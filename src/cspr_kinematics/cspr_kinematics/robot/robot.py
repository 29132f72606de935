"""The robot: geometry, platform, winches, motors and limits, validated and immutable."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import (
    FloatArray,
    ReadOnlyArrays,
    checked,
    for_each_cable,
    frozen,
    non_negative_number,
    positive_number,
    require_one_for_each_cable,
    single,
)
from cspr_kinematics.configuration.structure import located
from cspr_kinematics.configuration.yaml_file import read_yaml
from cspr_kinematics.errors import InvalidInputError
from cspr_kinematics.motion.pose import Pose
from cspr_kinematics.robot.cable_paths import checked_points, home_lengths, path_geometry
from cspr_kinematics.robot.cables import CableProperties
from cspr_kinematics.robot.pulleys import Pulleys
from cspr_kinematics.robot.rigid_body import RigidBody
from cspr_kinematics.robot.robot_description import CABLE_CLEARANCE, robot_parts
from cspr_kinematics.robot.winch import Motor, Winch
from cspr_kinematics.workspace.box import turned_outside

# A winch whose zero is off by more than this was not set up for the home pose, m.
_HOME_LENGTH_TOLERANCE = 1e-6
# Of the mean length at home, where nothing is stated. Points of a robot of 5 m surveyed to a millimetre leave less: the
# zero of the motors at home takes most of a survey error away.
_LENGTH_UNCERTAINTY = 1e-4
# rad, either way from home's, where nothing is stated: anchors crossed as on CoGiRo bear no more
_TURN = 0.35


@dataclass(frozen=True, eq=False)
class Robot(ReadOnlyArrays):
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
    tension_min, tension_max : numpy.ndarray, shape (m,)
        Limits of each cable's tension, N; given as one number for all cables or one for each.
    home : Pose
        Where all motor angles are zero.
    workspace_min, workspace_max : numpy.ndarray, shape (3,)
        Bounds of the platform's origin in base, m.
    trajectory_center : numpy.ndarray, shape (3,)
        Point in base about which the test trajectories run, m.
    pulleys : Pulleys
        At the exit points; by default of radius 0, that is, no pulleys.
    cables : CableProperties
        Of each cable; by default they neither stretch nor weigh anything.
    measured_home_tensions : numpy.ndarray, shape (m,), or None
        Tensions at the home pose when the motor angles were set to zero, as load cells at the frame show them, N;
        None if nobody wrote them down. `home_tensions` are those that count.
    length_uncertainty : float, optional
        Standard uncertainty of a cable's length, as far as this description does not explain it, m: survey errors,
        stretch that is not modelled.
    orientation_min, orientation_max : numpy.ndarray, shape (3,), optional
        Bounds of the platform's angles alpha, beta, gamma (eq. 4), rad; both or neither. `orientation_bounds` are
        those that count.
    cable_clearance : float
        Distance that the middle lines of two cables keep from each other, m; a cable keeps half of it from the
        platform.

    Raises
    ------
    InvalidInputError
        If a value is not finite or has another shape; if there are fewer than 6 cables, or not as
        many anchor points or pulleys as exit points; if limits or bounds are not in order, a measured tension is not
        positive or above its cable's limit, the home pose or the trajectories' centre lies outside its bounds, or
        the winch's home lengths are not the cable lengths at the home pose.
    """

    name: str
    exit_points: FloatArray
    anchor_points: FloatArray
    frame_size: FloatArray
    platform: RigidBody
    platform_size: FloatArray
    winch: Winch
    motor: Motor
    tension_min: FloatArray
    tension_max: FloatArray
    home: Pose
    workspace_min: FloatArray
    workspace_max: FloatArray
    trajectory_center: FloatArray
    pulleys: Pulleys = field(default_factory=Pulleys.none)
    cables: CableProperties = field(default_factory=CableProperties)
    measured_home_tensions: FloatArray | None = None
    length_uncertainty: float | None = None
    orientation_min: FloatArray | None = None
    orientation_max: FloatArray | None = None
    cable_clearance: float = CABLE_CLEARANCE

    def __post_init__(self) -> None:
        exits = checked_points("exit_points", self.exit_points)
        anchors = checked_points("anchor_points", self.anchor_points)
        self._set(exit_points=exits, anchor_points=anchors)
        for name in ("frame_size", "platform_size", "workspace_min", "workspace_max", "trajectory_center"):
            self._set(**{name: single(name, getattr(self, name), 3)})
        for name in ("frame_size", "platform_size"):
            if getattr(self, name).min() <= 0.0:
                raise InvalidInputError(name, getattr(self, name), "every dimension must be positive")
        self._set_tension_limits()
        self._set(cables=self.cables.for_each(len(exits)))
        if self.measured_home_tensions is not None:
            self._set_measured_home_tensions(self.measured_home_tensions)
        if self.length_uncertainty is not None:
            self._set(length_uncertainty=positive_number("length_uncertainty", self.length_uncertainty))
        self._set(cable_clearance=non_negative_number("cable_clearance", self.cable_clearance))
        self._check_workspace()
        self._check_orientation()
        self._check_home()

    @property
    def number_of_cables(self) -> int:
        """The number of cables, m."""
        return len(self.exit_points)

    @cached_property
    def length_deviation(self) -> float:
        """Standard deviation of cable lengths, m: as stated, or a ten-thousandth of the mean length at home."""
        if self.length_uncertainty is not None:
            return self.length_uncertainty
        return _LENGTH_UNCERTAINTY * float(self.winch.home_lengths.mean())

    @cached_property
    def orientation_bounds(self) -> tuple[FloatArray, FloatArray]:
        """Least and largest alpha, beta, gamma of the platform, (3,) each, rad: as stated, or 0.35 from home's."""
        if self.orientation_min is None or self.orientation_max is None:
            return self.home.euler - _TURN, self.home.euler + _TURN
        return self.orientation_min, self.orientation_max

    @cached_property
    def path_geometry(self) -> FloatArray:
        """The cables as the kernels see them, (m, 10): exit and anchor points, pulley radii, swivel axes."""
        return path_geometry(self.exit_points, self.anchor_points, self.pulleys)

    @cached_property
    def home_tensions(self) -> FloatArray:
        """Tensions at the home pose when the motor angles were set to zero, (m,), N.

        Those measured then; if there are none, the least ones within the limits that hold the empty platform.

        Raises
        ------
        SingularWrenchMatrixError
            If there are none, and the cables cannot hold the platform there whatever their tensions.
        """
        if self.measured_home_tensions is not None:
            return self.measured_home_tensions
        from cspr_kinematics.tensions.holding import (
            holding_tensions,
        )  # here, because it works on robots itself

        return frozen(holding_tensions(self, self.home).tensions)

    @cached_property
    def home_free_lengths(self) -> FloatArray:
        """Unstretched lengths of the cables at the home pose, where the motor angles are zero, (m,), m."""
        lengths = self.winch.home_lengths
        return (
            frozen(self.cables.free_length(lengths, self.home_tensions)) if self.cables.stretch else lengths
        )

    def cable_lengths(self, motor_angles: ArrayLike, tensions: ArrayLike | None = None) -> FloatArray:
        """Lengths of the cables, stretch included, at motor angles and tensions.

        Parameters
        ----------
        motor_angles
            (..., m), rad.
        tensions
            (..., m), N; by default those of the home pose. Of no account where cables do not stretch.

        Returns
        -------
        numpy.ndarray, shape (..., m)
            m.
        """
        angles = checked("motor_angles", motor_angles, self.number_of_cables)
        free = self.home_free_lengths + self.winch.transmission_ratio * angles
        if not self.cables.stretch:
            return np.asarray(free)
        return self.cables.stretched_length(free, self.home_tensions if tensions is None else tensions)

    def motor_angles(self, lengths: ArrayLike, tensions: ArrayLike | None = None) -> FloatArray:
        """Motor angles (..., m), rad, at which the cables have lengths (..., m), m; the inverse of `cable_lengths`."""
        lengths = checked("lengths", lengths, self.number_of_cables)
        if self.cables.stretch:
            lengths = self.cables.free_length(lengths, self.home_tensions if tensions is None else tensions)
        return np.asarray((lengths - self.home_free_lengths) / self.winch.transmission_ratio)

    def with_geometry(
        self,
        *,
        exit_points: ArrayLike | None = None,
        anchor_points: ArrayLike | None = None,
        pulleys: Pulleys | None = None,
        home: Pose | None = None,
    ) -> Robot:
        """Return this robot with other points, pulleys or home pose, and the zero of the winches set to match.

        Tensions that were measured at the old home pose do not count at another one.

        Raises
        ------
        InvalidInputError
            As in the constructor.
        """
        exits = self.exit_points if exit_points is None else exit_points
        anchors = self.anchor_points if anchor_points is None else anchor_points
        measured = self.measured_home_tensions if home is None else None
        pulleys, home = pulleys or self.pulleys, home or self.home
        lengths = home_lengths(exits, anchors, home, pulleys)
        return dataclasses.replace(
            self,
            exit_points=np.asarray(exits),
            anchor_points=np.asarray(anchors),
            pulleys=pulleys,
            home=home,
            measured_home_tensions=measured,
            winch=dataclasses.replace(self.winch, home_lengths=lengths),
        )

    @classmethod
    def from_yaml(cls, path: str | Path, remedy: str = "") -> Robot:
        """Read a robot from a YAML file; `config/robot.yaml` documents the keys.

        Parameters
        ----------
        path
            The file.
        remedy
            How the user names another one, for the error about a file that is missing or is not the right one.

        Raises
        ------
        ConfigurationFileError
            If the file is missing or not YAML, and for each value that cannot be used, naming file, key
            and value.
        """
        return cls.from_mapping(read_yaml(path, remedy), source=str(path))

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
        ConfigurationFileError
            For each value that cannot be used, naming source, key and value.
        """
        parts = robot_parts(mapping, source)
        with located(source):
            return cls(**parts)

    def _set_tension_limits(self) -> None:
        for name in ("tension_min", "tension_max"):
            limits = for_each_cable(name, getattr(self, name), self.number_of_cables)
            self._set(**{name: limits})
        if self.tension_min.min() < 0.0:
            raise InvalidInputError("tension_min", self.tension_min, "must not be negative")
        if np.any(self.tension_min >= self.tension_max):
            raise InvalidInputError(
                "tension_min", self.tension_min, f"must be below tension_max = {self.tension_max.tolist()}"
            )

    def _set_measured_home_tensions(self, measured: ArrayLike) -> None:
        tensions = checked("home_tensions", measured)
        if tensions.ndim != 1:
            raise InvalidInputError("home_tensions", measured, "must be a list, one tension for each cable")
        require_one_for_each_cable("home_tensions", tensions, self.number_of_cables)
        for place, (tension, largest) in enumerate(zip(tensions, self.tension_max, strict=True)):
            if tension <= 0.0:
                problem = "must be positive: of a slack cable the zero of its motor says nothing"
            elif tension > largest:
                problem = f"is above tension_max = {largest:g} of this cable"
            else:
                continue
            remedy = "set the home pose again with all cables taut and write down the tensions of then, or leave it out"
            raise InvalidInputError(f"home_tensions[{place}]", float(tension), f"{problem}; {remedy}")
        self._set(measured_home_tensions=frozen(tensions))

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

    def _check_orientation(self) -> None:
        given = {
            name: getattr(self, name)
            for name in ("orientation_min", "orientation_max")
            if getattr(self, name) is not None
        }
        if len(given) == 1:
            raise InvalidInputError(*given.popitem(), "give orientation_min and orientation_max, or neither")
        self._set(**{name: single(name, value, 3) for name, value in given.items()})
        low, high = self.orientation_bounds
        if np.any(low >= high):
            problem = f"must be below orientation_max = {high.tolist()} in every angle"
            raise InvalidInputError("orientation_min", low, problem)
        if given and max(abs(low[1]), abs(high[1])) >= 0.5 * np.pi:
            worse = "orientation_min" if abs(low[1]) >= abs(high[1]) else "orientation_max"
            raise InvalidInputError(worse, given[worse], "beta must stay within pi / 2 of level")
        if turned_outside(self.home.euler, low, high).any():
            raise InvalidInputError(
                "home", self.home.euler, "its angles lie outside orientation_min to orientation_max"
            )

    def _check_home(self) -> None:
        lengths = home_lengths(self.exit_points, self.anchor_points, self.home, self.pulleys)
        given = self.winch.home_lengths
        if given.shape != lengths.shape or np.abs(given - lengths).max() > _HOME_LENGTH_TOLERANCE:
            raise InvalidInputError(
                "winch", given, f"home_lengths must be the cable lengths at home, {lengths.tolist()}"
            )
