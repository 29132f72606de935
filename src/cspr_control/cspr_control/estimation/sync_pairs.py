"""Motor angles and cable tensions of the same SYNC."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspr_msgs_py.wire.joint_state import JointStateSample

_SAME_SYNC = 250_000
"""Largest difference of stamps of one SYNC, ns, half a cycle at 2,000 Hz: load cells with a process of their own have
their own stamps."""


class SyncPair(NamedTuple):
    """What was measured at one SYNC.

    Attributes
    ----------
    stamp
        In ns.
    motor_angles, tensions, torques
        (m,) each, of the motors in rad and N m, of the cables in N.
    """

    stamp: int
    motor_angles: NDArray[np.float64]
    tensions: NDArray[np.float64]
    torques: NDArray[np.float64]


class SyncPairs:
    """Puts together what two topics bring of the same SYNC, by its stamp; that of the motors is the pair's.

    Either may come first; what has waited in vain when the next of its kind comes is counted.

    Attributes
    ----------
    unpaired
        Number of samples whose partner did not come.
    """

    def __init__(self) -> None:
        self.unpaired = 0
        self._motors: JointStateSample | None = None
        self._tensions: tuple[int, NDArray[np.float64]] | None = None

    def motors(self, sample: JointStateSample) -> SyncPair | None:
        """Take motor states; return the pair that they complete."""
        self.unpaired += self._motors is not None
        self._motors = sample
        return self._pair()

    def tensions(self, stamp: int, tensions: NDArray[np.float64]) -> SyncPair | None:
        """Take cable tensions; return the pair that they complete."""
        self.unpaired += self._tensions is not None
        self._tensions = (stamp, tensions)
        return self._pair()

    def _pair(self) -> SyncPair | None:
        motors, tensions = self._motors, self._tensions
        if motors is None or tensions is None or abs(motors.stamp_ns - tensions[0]) > _SAME_SYNC:
            return None
        self._motors = self._tensions = None
        return SyncPair(motors.stamp_ns, motors.position, tensions[1], motors.effort)
