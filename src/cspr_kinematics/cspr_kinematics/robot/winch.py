"""Winch transmission between motor shaft and cable (docs/model.md, sections 2 and 3), and the motor itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import (
    FloatArray,
    ReadOnlyArrays,
    checked,
    frozen,
    non_negative_number,
    positive_number,
)
from cspr_kinematics.errors import InvalidInputError


@dataclass(frozen=True, eq=False)
class Winch(ReadOnlyArrays):
    """The transmission of all m winches: positive motor angle pays cable out, zero at the home pose.

    Attributes
    ----------
    drum_radius : float
        rho, m.
    gear_ratio : float
        D, motor turns per drum turn.
    home_lengths : numpy.ndarray, shape (m,)
        Cable lengths at the home pose, m.

    Raises
    ------
    InvalidInputError
        If radius, ratio or a length is not positive and finite, or the lengths have another shape. The
        methods raise it for input that is not finite or not (..., m).
    """

    drum_radius: float
    gear_ratio: float
    home_lengths: FloatArray

    def __init__(self, drum_radius: float, gear_ratio: float, home_lengths: ArrayLike) -> None:
        radius, ratio = positive_number("drum_radius", drum_radius), positive_number("gear_ratio", gear_ratio)
        lengths = checked("home_lengths", home_lengths)
        if lengths.ndim != 1 or not np.all(lengths > 0.0):
            raise InvalidInputError("home_lengths", home_lengths, "must be one positive length per cable")
        self._set(drum_radius=radius, gear_ratio=ratio, home_lengths=frozen(lengths))

    @cached_property
    def transmission_ratio(self) -> float:
        """Cable length per motor angle rho / D, m/rad (eq. 6)."""
        return self.drum_radius / self.gear_ratio

    def motor_angle(self, lengths: ArrayLike) -> FloatArray:
        """Motor angles (..., m) in rad at cable lengths (..., m) in m."""
        return (self._per_cable("lengths", lengths) - self.home_lengths) / self.transmission_ratio

    def cable_lengths(self, angle: ArrayLike) -> FloatArray:
        """Cable lengths (..., m) in m at motor angles (..., m) in rad."""
        return self.home_lengths + self.transmission_ratio * self._per_cable("motor angle", angle)

    def motor_speed(self, length_rates: ArrayLike) -> FloatArray:
        """Motor speeds (..., m) in rad/s at rates of cable length (..., m) in m/s."""
        return self._per_cable("length_rates", length_rates) / self.transmission_ratio

    def motor_acceleration(self, length_accelerations: ArrayLike) -> FloatArray:
        """Motor accelerations (..., m) in rad/s^2 at accelerations of cable length (..., m) in m/s^2."""
        return self._per_cable("length_accelerations", length_accelerations) / self.transmission_ratio

    def cable_speed(self, motor_speed: ArrayLike) -> FloatArray:
        """Rates of cable length (..., m) in m/s at motor speeds (..., m) in rad/s."""
        return self.transmission_ratio * self._per_cable("motor_speed", motor_speed)

    def motor_torque(self, tensions: ArrayLike) -> FloatArray:
        """Motor torques (..., m) in N m that hold tensions (..., m) in N at rest: -(rho / D) t."""
        return -self.transmission_ratio * self._per_cable("tensions", tensions)

    def tension(self, torque: ArrayLike) -> FloatArray:
        """Tensions (..., m) in N that motor torques (..., m) in N m hold at rest."""
        return self._per_cable("torque", torque) / -self.transmission_ratio

    def _per_cable(self, name: str, value: ArrayLike) -> FloatArray:
        return checked(name, value, self.home_lengths.shape[0])


@dataclass(frozen=True)
class Motor:
    """The motor of a winch; every quantity refers to the motor shaft.

    Attributes
    ----------
    inertia : float
        J_w, of everything that turns with the shaft: rotor, brake, gearbox, and the drum by the square of the gear
        ratio less, kg m^2.
    torque_limit : float
        Largest torque in either direction, N m.
    speed_limit : float
        Largest speed in either direction, rad/s.
    coulomb_friction : float
        F_s of eq. 14, N m.
    viscous_friction : float
        F_v of eq. 14, N m s/rad.

    Raises
    ------
    InvalidInputError
        If a value is not finite, inertia or a limit is not positive, or friction is negative.
    """

    inertia: Annotated[float, Meta(ge=1e-9, le=1e3)]
    torque_limit: Annotated[float, Meta(ge=1e-3, le=1e6)]
    speed_limit: Annotated[float, Meta(ge=0.1, le=1e5)]
    coulomb_friction: Annotated[float, Meta(ge=0.0, le=1e5)]
    viscous_friction: Annotated[float, Meta(ge=0.0, le=1e3)]

    def __post_init__(self) -> None:
        for name in ("inertia", "torque_limit", "speed_limit"):
            object.__setattr__(self, name, positive_number(name, getattr(self, name)))
        for name in ("coulomb_friction", "viscous_friction"):
            object.__setattr__(self, name, non_negative_number(name, getattr(self, name)))
