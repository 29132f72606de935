"""Swivelling pulleys at the exit points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cspr_kinematics.arrays import FloatArray, ReadOnlyArrays, checked, frozen, require_one_for_each_cable
from cspr_kinematics.errors import InvalidInputError

UPWARDS = (0.0, 0.0, 1.0)


@dataclass(frozen=True, eq=False)
class Pulleys(ReadOnlyArrays):
    """The pulleys over which the cables leave the frame: the same for all cables, or one for each.

    A cable comes from its winch along the swivel axis, in the direction of the axis, and meets the pulley at
    the exit point, where the axis touches the bottom of the groove. The pulley turns about the axis so that its
    plane contains the anchor point, and its centre is on the side of the anchor point. With axis +z, the default, the
    cable runs up a post from a winch near the floor and over the pulley; with -z it comes down from above.

    Attributes
    ----------
    radius : numpy.ndarray, shape () or (m,)
        R, from the pulley's centre to the middle of the cable, m; 0 makes the exit point a fixed eyelet.
    swivel_axis : numpy.ndarray, shape (3,) or (m, 3)
        k, unit vector in base; normalised here.

    Raises
    ------
    InvalidInputError
        If a radius is negative, an axis has length zero, or a value is not finite or has another shape.
    """

    radius: FloatArray
    swivel_axis: FloatArray

    def __init__(self, radius: ArrayLike, swivel_axis: ArrayLike = UPWARDS) -> None:
        radii = checked("radius", radius)
        if radii.ndim > 1:
            raise InvalidInputError("radius", radius, f"shape {radii.shape} where () or (m,) is needed")
        if np.any(radii < 0.0):
            raise InvalidInputError("radius", radius, "must not be negative")
        axes = checked("swivel_axis", swivel_axis, 3)
        if axes.ndim > 2:
            raise InvalidInputError(
                "swivel_axis", swivel_axis, f"shape {axes.shape} where (3,) or (m, 3) is needed"
            )
        largest = np.abs(axes).max(axis=-1, keepdims=True)
        if not np.all(largest > 0.0):
            raise InvalidInputError("swivel_axis", swivel_axis, "an axis of length zero has no direction")
        axes = axes / largest  # so that no square overflows
        axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
        self._set(radius=frozen(radii), swivel_axis=frozen(axes))

    @classmethod
    def none(cls) -> Pulleys:
        """Return fixed eyelets in place of pulleys."""
        return cls(0.0)

    def radii(self, number_of_cables: int) -> FloatArray:
        """Radius for each of m cables, shape (m,), m.

        Raises
        ------
        InvalidInputError
            If the pulleys are for a different number of cables, as in `axes`.
        """
        return self._for_cables("radius", self.radius, (number_of_cables,))

    def axes(self, number_of_cables: int) -> FloatArray:
        """Swivel axis for each of m cables, shape (m, 3)."""
        return self._for_cables("swivel_axis", self.swivel_axis, (number_of_cables, 3))

    @staticmethod
    def _for_cables(name: str, value: FloatArray, shape: tuple[int, ...]) -> FloatArray:
        if value.ndim == len(shape):
            require_one_for_each_cable(name, value, shape[0])
        return frozen(np.broadcast_to(value, shape))
