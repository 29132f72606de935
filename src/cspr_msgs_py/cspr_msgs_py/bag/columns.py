"""Messages of a topic as numpy arrays: one row for each message.

How they come about: :mod:`cspr_msgs_py.bag.collecting`.
"""

from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspr_msgs_py.wire.cdr import NANOSECONDS

Floats = NDArray[np.float64]
Times = NDArray[np.int64]


@dataclass(frozen=True)
class Samples:
    """All messages of a topic, or those of a range of time.

    Attributes
    ----------
    start_ns : int
        Log time of the first message of the bag, on any topic.
    time_ns, log_time_ns : ndarray, shape (n,)
        Stamp in the message, and when the recorder received it. A message without a header counts as stamped
        when it was received.
    """

    start_ns: int
    time_ns: Times
    log_time_ns: Times

    def __len__(self) -> int:
        return len(self.time_ns)

    @property
    def time(self) -> Floats:
        """Stamps in seconds since the start of the bag, shape (n,): comparable between topics."""
        seconds: Floats = (self.time_ns - self.start_ns) / NANOSECONDS
        return seconds


@dataclass(frozen=True)
class JointStates(Samples):
    """All messages of a JointState topic: n messages of m joints.

    Attributes
    ----------
    names : tuple of str
        In the order of the first message; joints that appear only in later messages come last.
    position, velocity, effort : ndarray, shape (n, m)
        Of shape (n, 0) where no message carries the field; NaN where one does not carry the joint.
    """

    names: tuple[str, ...]
    position: Floats
    velocity: Floats
    effort: Floats


@dataclass(frozen=True)
class References(Samples):
    """All messages of the reference topic; vectors in base.

    Attributes
    ----------
    time_from_start : ndarray, shape (n,)
        Seconds since the trajectory began.
    position, linear_velocity, angular_velocity, linear_acceleration, angular_acceleration : ndarray, shape (n, 3)
    quaternion_xyzw : ndarray, shape (n, 4)
    """

    time_from_start: Floats
    position: Floats
    quaternion_xyzw: Floats
    linear_velocity: Floats
    angular_velocity: Floats
    linear_acceleration: Floats
    angular_acceleration: Floats


@dataclass(frozen=True)
class Poses(Samples):
    """All messages of a PoseStamped topic: position (n, 3), quaternion_xyzw (n, 4)."""

    position: Floats
    quaternion_xyzw: Floats


@dataclass(frozen=True)
class Inertias(Samples):
    """All messages of an InertiaStamped topic: mass (n,), center_of_mass (n, 3)."""

    mass: Floats
    center_of_mass: Floats


@dataclass(frozen=True)
class Messages(Samples):
    """All messages of a topic of any other type, decoded.

    Attributes
    ----------
    messages : list
        Objects with the message's fields as attributes.
    """

    messages: list[Any]

    def column(self, field: str) -> NDArray[Any]:
        """Return a field of every message, such as ``column("status.level")``, as an array of length n.

        Raises
        ------
        AttributeError
            If the messages do not have it.
        """
        return np.array([attrgetter(field)(message) for message in self.messages])
