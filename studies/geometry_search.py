"""Search for a geometry whose figure 9 is the paper's: `python -m studies.geometry_search`, a few minutes.

Every geometry keeps the shipped exit points but for their heights, and is itself again after half a turn about z. Its
tensions are those of least norm.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from cspr_control.reference.paper import TILT, equation_18
from cspr_kinematics import GRAVITY, KinematicsError
from studies.geometries import SHIPPED
from studies.simulation_statements import OUTSTANDING
from studies.suitability import clearances

HEIGHTS = (3.0, 2.75, 2.5)  # m, of exit points
MASSES = (153.0, 353.0, 453.0)  # kg
LEAST_TENSION = 75.0  # N; half as much again as tension_min
LARGEST_CONDITION_NUMBER = 20.0
CABLES_APART, CABLES_FROM_PLATFORM = 0.015, 0.01  # m; ropes of 6 mm
LEAST_RATIO = 1.5  # of the least deviation of the cables that stand out, to the largest of the others

_QUICK = 4.0  # the acceleration along (19), with that along (18) as the unit
_HALF_TURN = np.array([-1.0, -1.0, 1.0])
_c, _s = np.cos(TILT), np.sin(TILT)
_TILTED = np.array([[_c, 0, _s], [0, 1, 0], [-_s, 0, _c]]) @ np.array([[1, 0, 0], [0, _c, -_s], [0, _s, _c]])

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Candidate:
    """A geometry, and by what factor the cables that the paper names stand out."""

    heights: tuple[float, ...]  # (4,) m, of exit points 1 to 4; 5 to 8 have the same
    anchor_points: Floats  # (8, 3)
    ratio: float
    least_tension: float  # N
    condition_number: float
    between_cables: float  # m, the least distance
    to_platform: float  # m

    @property
    def exit_points(self) -> Floats:
        """The exit points (8, 3), m."""
        return exit_points(self.heights)

    @property
    def preference(self) -> tuple[float, ...]:
        """What is smaller for the better one: exit points that are lower, then the negative ratio."""
        return sum(height < HEIGHTS[0] for height in self.heights), -self.ratio


def exit_points(heights: Sequence[float]) -> Floats:
    """Return the shipped exit points (8, 3), m, at the heights (4,) of the first four, and of their opposites."""
    points = SHIPPED.robot.exit_points.copy()
    points[:, 2] = np.tile(heights, 2)
    return points


def assignments() -> Floats:
    """Return the 384 sets of anchor points (384, 8, 3), m, which half a turn about z maps to themselves."""
    half = SHIPPED.robot.platform_size / 2.0
    corners = half * np.array([(1.0, y, z) for y, z in product((-1.0, 1.0), repeat=2)])
    found = []
    for order in permutations(range(4)):
        for turned in product((False, True), repeat=4):
            first = np.where(
                np.array(turned)[:, None], corners[list(order)] * _HALF_TURN, corners[list(order)]
            )
            found.append(np.concatenate((first, first * _HALF_TURN)))
    return np.array(found)


def search(all_heights: Iterable[Sequence[float]], anchors: Floats) -> Iterator[Candidate]:
    """Yield the geometries that are accepted, of those with heights (4,) of exit points and anchor points (n, 8, 3)."""
    robot = SHIPPED.robot
    for heights in all_heights:
        exits = exit_points(heights)
        ratio, least, condition = _tensions(exits, anchors)
        suits = (ratio >= LEAST_RATIO) & (least >= LEAST_TENSION) & (condition <= LARGEST_CONDITION_NUMBER)
        for k in np.flatnonzero(suits).tolist():
            try:
                candidate = robot.with_geometry(exit_points=exits, anchor_points=anchors[k])
            except KinematicsError:  # an anchor point in an exit point
                continue
            apart, from_platform = clearances(candidate)
            if apart >= CABLES_APART and from_platform >= CABLES_FROM_PLATFORM:
                r, t, c = (float(each[k]) for each in (ratio, least, condition))
                yield Candidate(tuple(heights), anchors[k], r, t, c, apart, from_platform)


def _tensions(exits: Floats, anchors: Floats) -> tuple[Floats, Floats, Floats]:
    """Return ratio, least tension (N) and condition number, each (n,), of anchor points (n, 8, 3).

    At some points of the path while the platform accelerates, level along (18) and turned along (19).
    """
    time = np.linspace(0.0, 10.0, 6)
    points = SHIPPED.robot.trajectory_center + 1e-3 * np.array([equation_18(t)[0] for t in time])
    unit = 1e-3 * equation_18(0.0)[2][0]  # m/s^2 along x
    named = np.isin(np.arange(anchors.shape[1]) + 1, OUTSTANDING)
    n = len(anchors)
    ratio, least, condition = np.full(n, np.inf), np.full(n, np.inf), np.zeros(n)
    for acceleration, rotation in ((unit, np.eye(3)), (_QUICK * unit, _TILTED)):
        turned = (anchors @ rotation.T)[:, None]
        spans = exits - points[:, None] - turned
        directions = spans / np.linalg.norm(spans, axis=-1, keepdims=True)
        arms = np.broadcast_to(turned, directions.shape)
        wrench_matrix = np.concatenate((directions, np.cross(arms, directions)), -1).swapaxes(-1, -2)
        condition = np.maximum(condition, np.linalg.cond(wrench_matrix).max(axis=1))
        inverse = np.linalg.pinv(wrench_matrix)
        weight, inertial = -GRAVITY[2] * inverse[..., 2], np.abs(acceleration * inverse[..., 0])
        for mass in MASSES:
            least = np.minimum(least, mass * (weight - inertial).min(axis=(1, 2)))
        for size in (np.median(inertial, axis=1), np.sqrt((inertial**2).mean(axis=1))):
            ratio = np.minimum(ratio, size[:, named].min(axis=1) / size[:, ~named].max(axis=1))
    return ratio, least, condition


def main() -> None:
    """Print the geometries that are accepted, the best one last."""
    heights = [one for one in product(HEIGHTS, repeat=4) if HEIGHTS[0] in one]
    anchors = assignments()
    print(f"{len(heights) * len(anchors)} geometries", flush=True)
    found = []
    for candidate in search(heights, anchors):
        found.append(candidate)
        print(
            f"exit points at {candidate.heights} m: ratio {candidate.ratio:.2f}, {candidate.least_tension:.0f} N, "
            f"condition {candidate.condition_number:.1f}, cables {1e3 * candidate.between_cables:.1f} mm apart and "
            f"{1e3 * candidate.to_platform:.1f} mm from the platform",
            flush=True,
        )
    best = min(found, key=lambda one: one.preference)
    print(f"{len(found)} are accepted; the best one has")
    for name in ("exit_points", "anchor_points"):
        print(f"{name}:", *(f"  - {point}" for point in getattr(best, name).tolist()), sep="\n")


if __name__ == "__main__":
    main()
