"""What the cables are made of: how they stretch and what they weigh (docs/model.md, section 4b)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import (
    FloatArray,
    ReadOnlyArrays,
    as_floats,
    checked,
    frozen,
    require_one_for_each_cable,
)
from cspr_kinematics.errors import InvalidInputError


@dataclass(frozen=True, eq=False)
class CableProperties(ReadOnlyArrays):
    """The ropes of m cables; each number is one for all of them or one for each, and in a `Robot` one for each.

    Attributes
    ----------
    axial_stiffness : numpy.ndarray, shape () or (m,)
        EA, tension over relative elongation, N; infinite by default: the cables do not stretch.
    damping_time : numpy.ndarray, shape () or (m,)
        Damping over stiffness of a taut cable, s.
    dead_length : numpy.ndarray, shape () or (m,)
        d, of the cable between drum and exit point, which stretches too, m.
    mass_per_metre : numpy.ndarray, shape () or (m,)
        mu, kg/m; zero by default: the cables weigh nothing.

    Raises
    ------
    InvalidInputError
        If a stiffness is not positive, another value is negative or not finite, or a shape is another one. The
        methods raise it for input that is not finite or not (..., m).
    """

    axial_stiffness: FloatArray
    damping_time: FloatArray
    dead_length: FloatArray
    mass_per_metre: FloatArray

    def __init__(
        self,
        axial_stiffness: ArrayLike = np.inf,
        damping_time: ArrayLike = 0.0,
        dead_length: ArrayLike = 0.0,
        mass_per_metre: ArrayLike = 0.0,
    ) -> None:
        stiffness = as_floats("axial_stiffness", axial_stiffness)
        if not np.all(stiffness > 0.0):
            raise InvalidInputError("axial_stiffness", axial_stiffness, "must be positive")
        self._set(axial_stiffness=frozen(stiffness))
        for name, value in (
            ("damping_time", damping_time),
            ("dead_length", dead_length),
            ("mass_per_metre", mass_per_metre),
        ):
            values = checked(name, value)
            if np.any(values < 0.0):
                raise InvalidInputError(name, value, "must not be negative")
            self._set(**{name: frozen(values)})
        for name, values in vars(self).items():
            if values.ndim > 1:
                raise InvalidInputError(name, values, f"shape {values.shape} where () or (m,) is needed")

    def for_each(self, number_of_cables: int) -> CableProperties:
        """Return the same with one number for each of m cables.

        Raises
        ------
        InvalidInputError
            If they are the properties of another number of cables.
        """
        arrays = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if value.ndim == 1:
                require_one_for_each_cable(field.name, value, number_of_cables)
            arrays[field.name] = np.broadcast_to(value, (number_of_cables,))
        return CableProperties(**arrays)

    @cached_property
    def stretch(self) -> bool:
        """Whether any cable stretches."""
        return bool(np.isfinite(self.axial_stiffness).any())

    @cached_property
    def weigh(self) -> bool:
        """Whether any cable has mass."""
        return bool(self.mass_per_metre.any())

    def free_length(self, length: ArrayLike, tension: ArrayLike) -> FloatArray:
        """Unstretched lengths (..., m) of cables that have these lengths under tension: (l + d) / (1 + t/EA) - d.

        Parameters
        ----------
        length
            l, from exit point to anchor point along the cable, (..., m), m.
        tension
            t, (..., m), N; a slack cable has none.
        """
        length = self._per_cable("length", length)
        return np.asarray((length + self.dead_length) / self._extension(tension) - self.dead_length)

    def stretched_length(self, free_length: ArrayLike, tension: ArrayLike) -> FloatArray:
        """Lengths (..., m) of cables of these unstretched lengths under tension: (f + d) (1 + t/EA) - d.

        Parameters are those of `free_length`, of which it is the inverse.
        """
        free = self._per_cable("free_length", free_length)
        return np.asarray((free + self.dead_length) * self._extension(tension) - self.dead_length)

    def _extension(self, tension: ArrayLike) -> FloatArray:
        return np.asarray(1.0 + self._per_cable("tension", tension) / self.axial_stiffness)

    def _per_cable(self, name: str, value: ArrayLike) -> FloatArray:
        return checked(name, value, *self.axial_stiffness.shape)
