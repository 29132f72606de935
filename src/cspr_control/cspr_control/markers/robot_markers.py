"""The robot as shapes in space, for live views: frame, platform, cables, payload, trajectory. All in base."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum
from itertools import combinations, product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspr_control.markers.tension_colours import tension_colours
from cspr_control.reference.trajectory import Trajectory
from cspr_kinematics import Payload, Pose, Robot, inverse_kinematics

Floats = NDArray[np.float64]
Colour = tuple[float, float, float, float]
"""Red, green, blue and opacity, each in [0, 1]."""

FRAME_COLOUR: Colour = (0.45, 0.45, 0.45, 1.0)
PLATFORM_COLOUR: Colour = (0.34, 0.71, 0.91, 0.9)
REFERENCE_COLOUR: Colour = (0.48, 0.48, 0.48, 0.35)
PAYLOAD_COLOUR: Colour = (0.90, 0.62, 0.0, 0.9)
TRAJECTORY_COLOUR: Colour = (0.48, 0.48, 0.48, 1.0)
PATH_COLOUR: Colour = (0.0, 0.45, 0.70, 1.0)

FRAME_WIDTH = 0.03  # m
CABLE_WIDTH = 0.012  # m
PATH_WIDTH = 0.008  # m
EXIT_SIZE = 0.07  # m
TEXT_HEIGHT = 0.12  # m
STEEL = 7850.0  # kg/m^3: the payload is shown as a ball of steel
SHOWN_PAYLOAD = 1.0  # kg; less is measurement error
TRAJECTORY_POINTS = 200


class ShapeKind(Enum):
    """How the points of a shape are drawn; the names are those of the types in visualization_msgs/Marker."""

    LINE_LIST = "pairs of points"
    LINE_STRIP = "points joined one after the other"
    SPHERE_LIST = "a ball at each point"
    CUBE = "a box"
    TEXT_VIEW_FACING = "a text that faces the viewer"


@dataclass(frozen=True, eq=False)
class Shape:
    """One thing to draw.

    Attributes
    ----------
    name
        What it is; a shape of the same name replaces the one before.
    kind
        How it is drawn.
    colour
        Of all of it, where ``colours`` is empty.
    size
        Three sizes of a box, m; of lines and paths the first is the width, of balls the diameter, of a text the
        third is its height.
    points
        (n, 3), m; of a box or a text its centre alone.
    colours
        Red, green and blue of each point, (n, 3), or empty.
    quaternion
        Orientation x, y, z, w of a box.
    text
        Of a text.
    """

    name: str
    kind: ShapeKind
    colour: Colour
    size: tuple[float, float, float]
    points: Floats
    colours: Floats = field(default_factory=lambda: np.empty((0, 3)))
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    text: str = ""


def frame_shapes(robot: Robot) -> list[Shape]:
    """Return what does not move: the edges of the frame, which stands on the floor, and the exit points."""
    half = robot.frame_size / 2.0
    signs = np.array(list(product((-1, 1), repeat=3)))
    edges = [(i, j) for i, j in combinations(range(8), 2) if np.count_nonzero(signs[i] != signs[j]) == 1]
    points = signs[np.ravel(edges)] * half + (0.0, 0.0, half[2])
    width, size = (FRAME_WIDTH,) * 3, (EXIT_SIZE,) * 3
    return [
        Shape("frame", ShapeKind.LINE_LIST, FRAME_COLOUR, width, points),
        Shape("exit_points", ShapeKind.SPHERE_LIST, FRAME_COLOUR, size, robot.exit_points),
    ]


def platform_shape(
    robot: Robot, pose: Pose, name: str = "platform", colour: Colour = PLATFORM_COLOUR
) -> Shape:
    """Return the platform at a pose: where it is, or as the shadow ``reference`` where it should be."""
    x, y, z, w = pose.quaternion.tolist()
    a, b, c = robot.platform_size.tolist()
    return Shape(name, ShapeKind.CUBE, colour, (a, b, c), pose.position[None], quaternion=(x, y, z, w))


def cable_shape(robot: Robot, pose: Pose, tensions: ArrayLike | None) -> Shape:
    """Return the cables at a pose, each coloured by its tension from ``tension_min`` to ``tension_max``.

    A cable runs from its anchor point to where it leaves its pulley, and from there to its exit point.

    Parameters
    ----------
    robot, pose
        The robot, and where its platform is.
    tensions
        Measured, (m,), N; None if they are not known.

    Raises
    ------
    cspr_kinematics.KinematicsError
        If a cable has no path.
    """
    m = robot.number_of_cables
    cables = inverse_kinematics(robot, pose)
    anchors, departures = cables.anchor_points, cables.tangent_points
    points = np.stack((anchors, departures, departures, robot.exit_points), axis=1).reshape(-1, 3)
    known = np.full(m, np.nan) if tensions is None else tensions
    colours = tension_colours(known, robot.tension_min, robot.tension_max)
    width = (CABLE_WIDTH,) * 3
    return Shape(
        "cables", ShapeKind.LINE_LIST, (1.0, 1.0, 1.0, 1.0), width, points, np.repeat(colours, 4, axis=0)
    )


def payload_shapes(pose: Pose, payload: Payload) -> list[Shape]:
    """Return the payload as a ball of its mass in steel at its centre of mass, and its mass as a text above it.

    Both are there at any mass, so that the ball of a load that was put down vanishes.
    """
    center = pose.position + pose.rotation @ payload.center_of_mass
    shown = payload.mass >= SHOWN_PAYLOAD
    diameter = 2.0 * math.cbrt(3.0 * payload.mass / (4.0 * math.pi * STEEL)) if shown else 1e-3
    above = center + np.array([0.0, 0.0, 0.5 * diameter + 2.0 * TEXT_HEIGHT])
    text = f"{payload.mass:z.1f} kg" if shown else "no payload"
    return [
        Shape("payload", ShapeKind.SPHERE_LIST, PAYLOAD_COLOUR, (diameter,) * 3, center[None]),
        Shape(
            "payload_mass",
            ShapeKind.TEXT_VIEW_FACING,
            PAYLOAD_COLOUR,
            (0.0, 0.0, TEXT_HEIGHT),
            above[None],
            text=text,
        ),
    ]


def trajectory_shape(trajectory: Trajectory) -> Shape:
    """Return the path that the platform's origin is to follow."""
    times = np.linspace(0.0, trajectory.duration, TRAJECTORY_POINTS)
    points = np.array([trajectory.sample(float(time)).pose.position for time in times])
    return Shape("trajectory", ShapeKind.LINE_STRIP, TRAJECTORY_COLOUR, (PATH_WIDTH,) * 3, points)


def path_shape(positions: Sequence[Floats]) -> Shape:
    """Return the path that the platform's origin has followed, (n, 3) with n >= 2."""
    return Shape(
        "path", ShapeKind.LINE_STRIP, PATH_COLOUR, (PATH_WIDTH,) * 3, np.asarray(positions, dtype=float)
    )
