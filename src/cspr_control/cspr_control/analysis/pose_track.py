"""Poses of the platform over time, and how far two such tracks are apart."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from cspr_msgs_py.bag.columns import Poses, References

Floats = NDArray[np.float64]
Times = NDArray[np.int64]

_UNIT = 1e-3  # by which the norm of a quaternion may differ from 1

LONGEST_GAP = 0.1
"""Time between two poses from which on nothing is known in between, s."""


@dataclass(frozen=True, eq=False)
class PoseTrack:
    """Poses in base, at times that increase strictly.

    Attributes
    ----------
    time_ns : ndarray, shape (n,)
    position : ndarray, shape (n, 3)
        Of a point of the platform, m.
    rotation : Rotation or None
        Of the platform (n); None where it is not known, as of a prism.
    """

    time_ns: Times
    position: Floats
    rotation: Rotation | None

    @classmethod
    def of(cls, poses: Poses | References) -> PoseTrack:
        """Return the track of recorded poses, of the platform's origin, without those that are none.

        Poses that are not finite or whose quaternion is no rotation are left out; of equal stamps the first counts.
        Where every quaternion is zero, nobody knew the rotation.
        """
        norm = np.linalg.norm(poses.quaternion_xyzw, axis=1)
        known = bool(norm.any())
        usable = np.isfinite(poses.position).all(axis=1)
        if known:
            usable &= np.abs(norm - 1.0) < _UNIT
        _, first = np.unique(poses.time_ns[usable], return_index=True)
        chosen = np.flatnonzero(usable)[first]
        rotation = Rotation.from_quat(poses.quaternion_xyzw[chosen]) if known else None
        return cls(poses.time_ns[chosen], poses.position[chosen], rotation)

    def part(self, chosen: NDArray[np.bool_]) -> PoseTrack:
        """Return the poses at some of the times."""
        rotation = None if self.rotation is None else self.rotation[chosen]
        return PoseTrack(self.time_ns[chosen], self.position[chosen], rotation)

    def of_point(self, point: Floats) -> PoseTrack:
        """Return the track of a point (3,) in platform, m, in place of the platform's origin.

        Raises
        ------
        ValueError
            If the rotation is not known, and the point is another one.
        """
        if not np.any(point):
            return self
        if self.rotation is None:
            raise ValueError("the point of a platform whose rotation is not known is where it is")
        return replace(self, position=self.position + self.rotation.apply(point))

    def at(self, time_ns: Times) -> PoseTrack:
        """Return the poses at other times, by linear interpolation; times in and beside larger gaps are left out."""
        if self.time_ns.size < 2:
            return self.part(np.isin(self.time_ns, time_ns))
        after = np.clip(np.searchsorted(self.time_ns, time_ns), 1, self.time_ns.size - 1)
        before = after - 1
        gap = self.time_ns[after] - self.time_ns[before]
        met = np.isin(time_ns, self.time_ns)
        inside = (time_ns >= self.time_ns[0]) & (time_ns <= self.time_ns[-1])
        known = time_ns[inside & (met | (gap <= LONGEST_GAP * 1e9))]
        seconds, at = (1e-9 * (times - self.time_ns[0]) for times in (self.time_ns, known))
        position = np.stack([np.interp(at, seconds, column) for column in self.position.T], axis=-1)
        rotation = None if self.rotation is None else Slerp(seconds, self.rotation)(at)
        return PoseTrack(known, position, rotation)


@dataclass(frozen=True, eq=False)
class PoseDifference:
    """How far one track is from another, in base.

    Attributes
    ----------
    time_ns : ndarray, shape (n,)
    position : ndarray, shape (n, 3)
        m.
    rotation : ndarray, shape (n, 3), or None
        Rotation vector of what turns the second into the first, rad; None if one of the rotations is not known.
    """

    time_ns: Times
    position: Floats
    rotation: Floats | None

    def __neg__(self) -> PoseDifference:
        return PoseDifference(self.time_ns, -self.position, None if self.rotation is None else -self.rotation)

    def part(self, chosen: NDArray[np.bool_]) -> PoseDifference:
        """Return the differences at some of the times."""
        rotation = None if self.rotation is None else self.rotation[chosen]
        return PoseDifference(self.time_ns[chosen], self.position[chosen], rotation)

    @property
    def distance(self) -> Floats:
        """Distance (n,), m."""
        return np.asarray(np.linalg.norm(self.position, axis=1))

    @property
    def angle(self) -> Floats | None:
        """Angle of the rotation (n,), rad; None if it is not known."""
        return None if self.rotation is None else np.asarray(np.linalg.norm(self.rotation, axis=1))


def pose_difference(first: PoseTrack, second: PoseTrack) -> PoseDifference:
    """Return the first track less the second, at the times of the first at which the second is known."""
    second = second.at(first.time_ns)
    first = first.part(np.isin(first.time_ns, second.time_ns))
    rotation = None
    if first.rotation is not None and second.rotation is not None:
        rotation = (first.rotation * second.rotation.inv()).as_rotvec()
    return PoseDifference(first.time_ns, first.position - second.position, rotation)
