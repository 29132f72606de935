"""Numbers of decoded messages: of rclpy's own classes, or of those that a bag's definitions make."""

import math
from typing import Any

from cspr_msgs_py.wire.cdr import NANOSECONDS


def nanoseconds(time: Any) -> int:
    """Return a ``builtin_interfaces`` Time or Duration in ns."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def vector(xyz: Any) -> list[float]:
    """Return the coordinates of a Vector3 or Point."""
    return [xyz.x, xyz.y, xyz.z]


def quaternion(xyzw: Any) -> list[float]:
    """Return the components of a Quaternion in the order x, y, z, w."""
    return [xyzw.x, xyzw.y, xyzw.z, xyzw.w]


def motion(point: Any, joint: int) -> list[list[float]]:
    """Return the motion of one joint at a point of a MultiDOFJointTrajectory, as `wire.reference.VECTORS` orders it.

    NaN for the velocities and accelerations, which a point need not have.
    """
    transform = point.transforms[joint]
    vectors = [vector(transform.translation), quaternion(transform.rotation)]
    for twists in (point.velocities, point.accelerations):
        nothing = [[math.nan] * 3] * 2
        vectors += [vector(twists[joint].linear), vector(twists[joint].angular)] if twists else nothing
    return vectors
