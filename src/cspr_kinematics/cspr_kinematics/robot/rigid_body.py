"""The platform as a rigid body, and what it carries."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import (
    FloatArray,
    ReadOnlyArrays,
    frozen,
    non_negative_number,
    positive_number,
    single,
)
from cspr_kinematics.errors import InvalidInputError

# Allowance for rounding in the checks of an inertia, relative to its largest element.
_INERTIA_TOLERANCE = 1e-9
# Indices of the elements of an inertia tensor among the inertial parameters.
_TENSOR_PLACES = np.array([[4, 5, 6], [5, 7, 8], [6, 8, 9]])


@dataclass(frozen=True, eq=False)
class _MassProperties(ReadOnlyArrays):
    """Mass and centre of mass, with the moments that follow from them: those of a point mass."""

    mass: float
    center_of_mass: FloatArray

    @cached_property
    def first_moment(self) -> FloatArray:
        """Mass times centre of mass, shape (3,), kg m."""
        return frozen(self.mass * self.center_of_mass)

    @cached_property
    def inertia_about_origin(self) -> FloatArray:
        """Inertia tensor about the platform's origin, shape (3, 3), kg m^2 (I_P of docs/model.md, section 4)."""
        return frozen(_point_inertia(self.mass, self.center_of_mass))

    @cached_property
    def inertial_parameters(self) -> FloatArray:
        """The ten parameters in which the wrench is linear, shape (10,), in platform axes.

        Mass, first moment (3), and of the inertia tensor about the platform's origin Ixx, Ixy, Ixz, Iyy, Iyz,
        Izz.
        """
        moments = self.inertia_about_origin[np.triu_indices(3)]
        return frozen(np.concatenate(([self.mass], self.first_moment, moments)))


@dataclass(frozen=True, eq=False)
class RigidBody(_MassProperties):
    """Mass properties of a rigid body, in platform axes.

    Attributes
    ----------
    mass : float
        Mass, kg.
    center_of_mass : numpy.ndarray, shape (3,)
        c_p, from the platform's origin, m.
    inertia : numpy.ndarray, shape (3, 3)
        I_G, the inertia tensor about the centre of mass, kg m^2. Its off-diagonal elements are the
        negatives of the products of inertia.

    Raises
    ------
    InvalidInputError
        If the mass is not positive, a value is not finite or has another shape, or no body can
        have the inertia.
    """

    inertia: FloatArray

    def __init__(self, mass: float, center_of_mass: ArrayLike, inertia: ArrayLike) -> None:
        self._set(
            mass=positive_number("mass", mass),
            center_of_mass=single("center_of_mass", center_of_mass, 3),
            inertia=_inertia("inertia", inertia),
        )

    @cached_property
    def inertia_about_origin(self) -> FloatArray:
        """Inertia tensor about the platform's origin, shape (3, 3), kg m^2 (I_P of docs/model.md, section 4)."""
        return frozen(self.inertia + _point_inertia(self.mass, self.center_of_mass))

    @classmethod
    def from_inertial_parameters(cls, parameters: ArrayLike) -> RigidBody:
        """Build the body with the given inertial parameters (10,); the inverse of `inertial_parameters`.

        Raises
        ------
        InvalidInputError
            If no body has them: mass or principal moments are not positive, or two moments add up to less
            than the third.
        """
        pi = single("inertial parameters", parameters, 10)
        mass = positive_number("mass", pi[0])
        center = pi[1:4] / mass
        about_origin = pi[_TENSOR_PLACES]
        return cls(mass, center, about_origin - _point_inertia(mass, center))


@dataclass(frozen=True, eq=False)
class Payload(_MassProperties):
    """What the platform carries: a point mass fixed to it.

    Attributes
    ----------
    mass : float
        Mass, kg; zero for no payload.
    center_of_mass : numpy.ndarray, shape (3,)
        Position from the platform's origin in platform axes, m.

    Raises
    ------
    InvalidInputError
        If the mass is negative, or a value is not finite or has another shape.
    """

    def __init__(self, mass: float, center_of_mass: ArrayLike) -> None:
        checked_mass = non_negative_number("payload mass", mass)
        self._set(mass=checked_mass, center_of_mass=single("payload center_of_mass", center_of_mass, 3))

    @classmethod
    def trusted(cls, mass: float, center_of_mass: FloatArray) -> Payload:
        """Build a payload of finite numbers, without copy or check; the centre of mass (3,) becomes read-only."""
        payload = object.__new__(cls)
        center_of_mass.setflags(write=False)
        payload._set(mass=mass, center_of_mass=center_of_mass)
        return payload

    @cached_property
    def inertial_parameters(self) -> FloatArray:
        """The ten parameters in which the wrench is linear, shape (10,): those of any body, at a tenth of the cost."""
        m, (x, y, z) = self.mass, self.center_of_mass.tolist()
        moments = (
            m * (y * y + z * z),
            -m * x * y,
            -m * x * z,
            m * (x * x + z * z),
            -m * y * z,
            m * (x * x + y * y),
        )
        return frozen(np.array([m, m * x, m * y, m * z, *moments]))

    @classmethod
    def none(cls) -> Payload:
        """No payload."""
        return cls(0.0, np.zeros(3))


def _point_inertia(mass: float, position: FloatArray) -> FloatArray:
    """Inertia tensor (3, 3) about the origin of a point mass at `position` (3,), kg m^2."""
    return np.asarray(mass * ((position @ position) * np.eye(3) - np.outer(position, position)))


def _inertia(name: str, value: ArrayLike) -> FloatArray:
    inertia = single(name, value, 3, 3)
    tolerance = _INERTIA_TOLERANCE * np.abs(inertia).max()
    if np.abs(inertia - inertia.T).max() > tolerance:
        raise InvalidInputError(name, value, "no body has this inertia: not symmetric")
    principal = np.linalg.eigvalsh(inertia)
    shown = ", ".join(f"{moment:.6g}" for moment in principal)
    wrong = ""
    if principal[0] <= 0.0:
        wrong = f"principal moments {shown} are not all positive"
    elif principal[0] + principal[1] < principal[2] - tolerance:
        wrong = f"two of the principal moments {shown} add up to less than the third"
    if wrong:
        raise InvalidInputError(name, value, f"no body has this inertia: {wrong}")
    return inertia
