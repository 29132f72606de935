"""The platform's reference motion as raw CDR of trajectory_msgs/MultiDOFJointTrajectory.

One point a message: pose, twist and acceleration of the frame ``platform`` in ``base``. As in
:mod:`cspr_msgs_py.wire.joint_state` the layout is constant, so a message is a frame with numbers at fixed offsets.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspr_msgs_py.topics import BASE_FRAME, PLATFORM_FRAME
from cspr_msgs_py.wire.cdr import NANOSECONDS, Bytes, Template, pack_time, unpack_time

_DOUBLE: Final = np.dtype("<f8")


@dataclass(frozen=True, slots=True)
class ReferenceSample:
    """Desired motion of the platform at one instant, all vectors in base.

    Attributes
    ----------
    stamp_ns : int
        ``header.stamp`` in nanoseconds: when the point is to be reached.
    time_from_start : float
        Seconds since the trajectory began; resolved to nanoseconds in a message.
    position : ndarray, shape (3,)
        Origin of the platform, m.
    quaternion_xyzw : ndarray, shape (4,)
        Rotation of platform to base coordinates.
    linear_velocity, angular_velocity : ndarray, shape (3,)
        m/s and rad/s.
    linear_acceleration, angular_acceleration : ndarray, shape (3,)
        m/s^2 and rad/s^2.
    """

    stamp_ns: int
    time_from_start: float
    position: NDArray[np.float64]
    quaternion_xyzw: NDArray[np.float64]
    linear_velocity: NDArray[np.float64]
    angular_velocity: NDArray[np.float64]
    linear_acceleration: NDArray[np.float64]
    angular_acceleration: NDArray[np.float64]


VECTORS: Final = {
    "position": 3,
    "quaternion_xyzw": 4,
    "linear_velocity": 3,
    "angular_velocity": 3,
    "linear_acceleration": 3,
    "angular_acceleration": 3,
}


class ReferenceCodec:
    """Encodes and decodes the messages of ``/reference``: one joint, one point with all its derivatives."""

    def __init__(self, frame_id: str = BASE_FRAME, joint_name: str = PLATFORM_FRAME) -> None:
        template = Template()
        self._stamp_offset = template.time()
        template.string(frame_id)
        template.count(1)
        template.string(joint_name)
        template.count(1)  # points
        template.count(1)  # transforms of the point
        self._pose_offset = template.doubles(7)
        template.count(1)  # velocities of the point
        self._twist_offset = template.doubles(6)
        template.count(1)  # accelerations of the point
        self._acceleration_offset = template.doubles(6)
        self._duration_offset = template.time()
        self._frame = template.finish()
        self.size = self._frame.size

    def encode(self, sample: ReferenceSample) -> bytes:
        """Return the message as CDR.

        Raises
        ------
        ValueError
            If a vector has another length than it must have, or a time does not fit the message.
        """
        return self._frame.encode(
            pack_time(sample.stamp_ns),
            _block(sample, "position") + _block(sample, "quaternion_xyzw"),
            _block(sample, "linear_velocity") + _block(sample, "angular_velocity"),
            _block(sample, "linear_acceleration") + _block(sample, "angular_acceleration"),
            pack_time(round(sample.time_from_start * NANOSECONDS)),
        )

    def decode(self, buffer: Bytes) -> ReferenceSample | None:
        """Return what a message carries (arrays read-only), or None when `buffer` has another layout."""
        if not self._frame.matches(buffer):
            return None
        data = buffer if isinstance(buffer, bytes) else bytes(buffer)  # arrays over bytes are read-only
        pose = np.frombuffer(data, _DOUBLE, 7, self._pose_offset)
        twist = np.frombuffer(data, _DOUBLE, 6, self._twist_offset)
        acceleration = np.frombuffer(data, _DOUBLE, 6, self._acceleration_offset)
        return ReferenceSample(
            unpack_time(data, self._stamp_offset),
            unpack_time(data, self._duration_offset) / NANOSECONDS,
            pose[:3],
            pose[3:],
            twist[:3],
            twist[3:],
            acceleration[:3],
            acceleration[3:],
        )

    def matches(self, buffer: Bytes) -> bool:
        """Return whether `buffer` is a message of this layout."""
        return self._frame.matches(buffer)

    def matches_each(self, records: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return for each of many messages of this layout's size, shape (n, size), whether it has the layout."""
        return self._frame.matches_each(records)

    @property
    def dtype(self) -> np.dtype[np.void]:
        """Structured type of one message, to view many joined ones as columns.

        Its fields are ``seconds`` and ``nanoseconds`` of the stamp, ``duration_seconds`` and
        ``duration_nanoseconds`` of time_from_start, ``pose`` (7), ``twist`` (6) and ``acceleration`` (6).
        """
        columns = {
            "seconds": ("<i4", self._stamp_offset),
            "nanoseconds": ("<u4", self._stamp_offset + 4),
            "pose": ((_DOUBLE, (7,)), self._pose_offset),
            "twist": ((_DOUBLE, (6,)), self._twist_offset),
            "acceleration": ((_DOUBLE, (6,)), self._acceleration_offset),
            "duration_seconds": ("<i4", self._duration_offset),
            "duration_nanoseconds": ("<u4", self._duration_offset + 4),
        }
        return np.dtype(
            {
                "names": list(columns),
                "formats": [format for format, _ in columns.values()],
                "offsets": [offset for _, offset in columns.values()],
                "itemsize": self.size,
            }
        )


def _block(sample: ReferenceSample, field: str) -> bytes:
    array = np.asarray(getattr(sample, field), dtype=_DOUBLE)
    if array.shape != (VECTORS[field],):
        raise ValueError(f"{field} has shape {array.shape}, not ({VECTORS[field]},)")
    return array.tobytes()
