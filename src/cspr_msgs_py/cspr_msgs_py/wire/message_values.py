"""Numbers of decoded messages: of rclpy's own classes, or of those that a bag's definitions make."""

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
