"""Motor angles and cable tensions of the same SYNC."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspr_msgs_py.wire.joint_state import JointStateSample


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
    """Puts together what two topics bring of the same SYNC: what has the same stamp.

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
        if motors is None or tensions is None or motors.stamp_ns != tensions[0]:
            return None
        self._motors = self._tensions = None
        return SyncPair(motors.stamp_ns, motors.position, tensions[1], motors.effort)
