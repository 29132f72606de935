"""Messages of ROS to and from plain arrays, as other programs send and hear them: they check the codecs, too.

Stamps are integers in nanoseconds of ROS time.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import InertiaStamped, PoseStamped
from numpy.typing import ArrayLike, NDArray

from cspr_msgs_py.topics import BASE_FRAME, PLATFORM_FRAME
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.cdr import NANOSECONDS


def time_message(stamp_ns: int) -> Time:
    """Return a stamp as a message."""
    seconds, nanoseconds = divmod(stamp_ns, NANOSECONDS)
    return Time(sec=seconds, nanosec=nanoseconds)


def nanoseconds(stamp: Time) -> int:
    """Return a stamp message as nanoseconds."""
    return int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def pose_stamped(
    stamp_ns: int, position: ArrayLike, quaternion_xyzw: ArrayLike, frame_id: str = BASE_FRAME
) -> PoseStamped:
    """Return a pose: `position` (3,) in m, `quaternion_xyzw` (4,)."""
    message = PoseStamped()
    message.header.stamp = time_message(stamp_ns)
    message.header.frame_id = frame_id
    target = message.pose
    target.position.x, target.position.y, target.position.z = _floats(position)
    orientation = target.orientation
    orientation.x, orientation.y, orientation.z, orientation.w = _floats(quaternion_xyzw)
    return message


def from_pose_stamped(message: PoseStamped) -> tuple[int, NDArray[np.float64], NDArray[np.float64]]:
    """Return stamp (ns), position (3,) and quaternion_xyzw (4,) of a pose."""
    position, orientation = message.pose.position, message.pose.orientation
    return (
        nanoseconds(message.header.stamp),
        np.array([position.x, position.y, position.z]),
        np.array([orientation.x, orientation.y, orientation.z, orientation.w]),
    )


def inertia_stamped(
    stamp_ns: int, mass: float, center_of_mass: ArrayLike, frame_id: str = PLATFORM_FRAME
) -> InertiaStamped:
    """Return a point mass: `mass` in kg, `center_of_mass` (3,) in m; its moments of inertia are zero."""
    message = InertiaStamped()
    message.header.stamp = time_message(stamp_ns)
    message.header.frame_id = frame_id
    message.inertia.m = float(mass)
    center = message.inertia.com
    center.x, center.y, center.z = _floats(center_of_mass)
    return message


def from_inertia_stamped(message: InertiaStamped) -> tuple[int, float, NDArray[np.float64]]:
    """Return stamp (ns), mass (kg) and centre of mass (3,) (m) of an inertia."""
    center = message.inertia.com
    return (
        nanoseconds(message.header.stamp),
        float(message.inertia.m),
        np.array([center.x, center.y, center.z]),
    )


def diagnostic_status(
    name: str,
    level: Level | int,
    message: str,
    values: Mapping[str, Any] | None = None,
    hardware_id: str = "",
) -> DiagnosticStatus:
    """Return a diagnostic status; the values are written with :func:`str`."""
    return DiagnosticStatus(
        level=bytes([level]),
        name=name,
        message=message,
        hardware_id=hardware_id,
        values=[KeyValue(key=key, value=str(value)) for key, value in (values or {}).items()],
    )


def from_diagnostic_status(message: DiagnosticStatus) -> tuple[str, Level, str, dict[str, str]]:
    """Return name, level, message and values of a diagnostic status."""
    level = message.level[0] if isinstance(message.level, bytes) else int(message.level)
    return (
        message.name,
        Level(min(level, Level.STALE)),
        message.message,
        {item.key: item.value for item in message.values},
    )


def diagnostic_array(stamp_ns: int, statuses: Iterable[DiagnosticStatus]) -> DiagnosticArray:
    """Return the statuses as one stamped message."""
    message = DiagnosticArray(status=list(statuses))
    message.header.stamp = time_message(stamp_ns)
    return message


def from_diagnostic_array(message: DiagnosticArray) -> dict[str, tuple[Level, str, dict[str, str]]]:
    """Return level, message and values of each status by its name, in the order of the message."""
    statuses: dict[str, tuple[Level, str, dict[str, str]]] = {}
    for status in message.status:
        name, level, text, values = from_diagnostic_status(status)
        statuses[name] = (level, text, values)
    return statuses


def _floats(values: ArrayLike) -> Sequence[float]:
    floats: list[float] = np.asarray(values, dtype=float).tolist()
    return floats
