"""What one cycle of the bus says of the platform and of what pulls on it, and why it may say nothing."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Held(Enum):
    """Why the estimate of the payload stays as it is."""

    NO_CYCLE = "no motor states and cable tensions of one SYNC have arrived"
    STALE = "motor states and cable tensions of one SYNC are too old"
    SLACK_CABLE = "a cable is slack"
    AFTER_SLACK = "a cable was slack a moment ago"
    DOUBT = "a load cell is in doubt"
    NO_POSE = "the lengths of the cables fit no pose"
    STARTING = "too few cycles without a gap"
    JOLT = "the platform is jolted"
    MOVING_TOO_FAST = "the platform moves too fast"
    TURNING_TOO_FAST = "the platform turns too fast"
    EXCLUDED = "a load cell is not believed"
    NOT_VERTICAL = "the cables pull sideways, as on a platform that accelerates"


class Observation(NamedTuple):
    """What angles and tensions of one SYNC say.

    Attributes
    ----------
    step
        Time since the observation before, s; infinite for the first, and after a gap.
    position, rotation
        Where the platform is, (3,) and (3, 3).
    wrench
        What the cables pull (6,), about the platform's origin in base, N and N m.
    jacobian
        J (m, 6) at the pose; A = -J^T.
    """

    step: float
    position: NDArray[np.float64]
    rotation: NDArray[np.float64]
    wrench: NDArray[np.float64]
    jacobian: NDArray[np.float64]


class Found(NamedTuple):
    """What a method has found of the payload.

    Attributes
    ----------
    mass
        kg, negative by measurement errors.
    moment
        Mass times centre of mass (3,), in platform, kg m.
    external_wrench
        What the surroundings exert on the platform (6,) beyond what gravity and inertia explain, about its origin in
        base, N and N m; None if the method cannot tell.
    """

    mass: float
    moment: NDArray[np.float64]
    external_wrench: NDArray[np.float64] | None
