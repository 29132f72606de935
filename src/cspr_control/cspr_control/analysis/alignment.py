"""The rigid motion that brings the frame of a measuring instrument into that of the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cspr_control.errors import ControlError

Floats = NDArray[np.float64]

_THINNEST = 0.05
"""Least extent across a path, as a share of its length, that tells how it is turned about itself.

Across a thinner one an error of the platform looks like a turn: one that mirrors the path, like one by 180 degrees.
"""


@dataclass(frozen=True, eq=False)
class Alignment:
    """A rotation, then a translation: ``base = turn(instrument) + translation``.

    Attributes
    ----------
    rotation_vector_deg
        Axis times angle (3,), degrees.
    translation
        (3,), m.
    residual_rms_mm
        What is left between the points.
    """

    rotation_vector_deg: Floats
    translation: Floats
    residual_rms_mm: float

    @property
    def rotation(self) -> Rotation:
        """The rotation."""
        return Rotation.from_rotvec(self.rotation_vector_deg, degrees=True)

    def apply(self, points: Floats) -> Floats:
        """Return points (n, 3) of the instrument in base, m."""
        return np.asarray(self.rotation.apply(points) + self.translation)

    def __str__(self) -> str:
        axis = self.rotation_vector_deg
        turn, move = (f"({', '.join(f'{v:z.4g}' for v in vector)})" for vector in (axis, self.translation))
        left = f"{self.residual_rms_mm:.2f} mm RMS are left"
        return f"turned by the rotation vector {turn} deg, then moved by {move} m; {left}"


def align(measured: Floats, wanted: Floats) -> Alignment:
    """Return the rigid motion that brings points (n, 3) closest to others, in the sense of least squares.

    Raises
    ------
    ControlError
        If there are fewer than three points, or the wanted ones lie so nearly on one line that nothing tells how the
        others are turned about it.
    """
    if len(measured) < 3:
        raise ControlError(f"there are {len(measured)} positions on the trajectory, three are the least")
    along, across, _ = np.linalg.svd(wanted - wanted.mean(axis=0), compute_uv=False)
    if not across > _THINNEST * along:
        width = 2e3 * across / np.sqrt(len(wanted))
        raise ControlError(
            f"the path lies on one line to within {width:.0f} mm, less than a twentieth of its length: how the "
            "measured frame is turned about it cannot be told from an error of the platform. Align it along a path "
            "that is curved, such as paper-19"
        )
    return closest_motion(measured, wanted)


def closest_motion(measured: Floats, wanted: Floats) -> Alignment:
    """Return the same for at least one point, whether or not the points determine the rotation; the residual they do.

    W. Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta Cryst. A32 (1976) 922.
    """
    centers = measured.mean(axis=0), wanted.mean(axis=0)
    first, second = measured - centers[0], wanted - centers[1]
    u, _, vt = np.linalg.svd(first.T @ second)
    mirror = np.diag([1.0, 1.0, np.linalg.det(vt.T @ u.T)])
    rotation = Rotation.from_matrix(vt.T @ mirror @ u.T)
    residual = rotation.apply(first) - second
    return Alignment(
        rotation.as_rotvec(degrees=True),
        centers[1] - rotation.apply(centers[0]),
        1e3 * float(np.sqrt((residual**2).sum(axis=1).mean())),
    )
