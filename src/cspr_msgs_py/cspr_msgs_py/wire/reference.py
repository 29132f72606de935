"""The platform's reference motion as raw CDR of trajectory_msgs/MultiDOFJointTrajectory.

One point per message: pose, twist and acceleration of the frame ``platform`` in ``base``. As in
:mod:`cspr_msgs_py.wire.joint_state` the layout is constant, so a message is a frame with numbers at fixed offsets.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspr_msgs_py.topics import BASE_FRAME, PLATFORM_FRAME
from cspr_msgs_py.wire.cdr import NANOSECONDS, Bytes, Frame, Template, pack_time, unpack_time

_DOUBLE: Final = np.dtype("<f8")


class ReferenceSample(NamedTuple):
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

# A point has sequences of transforms, velocities and accelerations, here of one element each.
_FIRST_OF_SEQUENCE: Final = ("position", "linear_velocity", "linear_acceleration")


class ReferenceCodec(Frame):
    """Encodes and decodes the messages of ``/reference``: one joint, one point with all its derivatives.

    The fields of its dtype are ``seconds`` and ``nanoseconds`` of the stamp, ``duration_seconds`` and
    ``duration_nanoseconds`` of time_from_start, and the vectors of a sample.
    """

    def __init__(self) -> None:
        template = Template()
        self._stamp_offset = template.place_time()
        template.string(BASE_FRAME)
        template.count(1)
        template.string(PLATFORM_FRAME)
        template.count(1)  # points
        offsets = []
        for name, size in VECTORS.items():
            if name in _FIRST_OF_SEQUENCE:
                template.count(1)
            offsets.append(template.place_doubles(name, size))
        self._duration_offset = template.place_time("duration_")
        super().__init__(template)
        self._vectors = tuple(zip(VECTORS.values(), offsets, strict=True))

    def encode(self, sample: ReferenceSample) -> bytes:
        """Return the message as CDR.

        Raises
        ------
        ValueError
            If a vector has another length than it must have, or a time does not fit the message.
        """
        return self.join(
            pack_time(sample.stamp_ns),
            *[_block(sample, field) for field in VECTORS],
            pack_time(round(sample.time_from_start * NANOSECONDS)),
        )

    def decode(self, buffer: Bytes) -> ReferenceSample | None:
        """Return what a message carries (arrays read-only), or None when `buffer` has another layout."""
        if not self.matches(buffer):
            return None
        data = buffer if isinstance(buffer, bytes) else bytes(buffer)  # arrays over bytes are read-only
        return ReferenceSample(
            unpack_time(data, self._stamp_offset),
            unpack_time(data, self._duration_offset) / NANOSECONDS,
            *[np.frombuffer(data, _DOUBLE, size, offset) for size, offset in self._vectors],
        )


def _block(sample: ReferenceSample, field: str) -> bytes:
    array = np.asarray(getattr(sample, field), dtype=_DOUBLE)
    if array.shape != (VECTORS[field],):
        raise ValueError(f"{field} has shape {array.shape}, not ({VECTORS[field]},)")
    return array.tobytes()
