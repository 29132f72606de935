"""The states of a recorded run from which a robot is calibrated: some in each place, none with slack cables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cspr_control.analysis.recording import Floats, Recording, Times
from cspr_control.errors import ControlError
from cspr_control.estimation.length_misfit import SPACING
from cspr_kinematics import Robot


@dataclass(frozen=True, eq=False)
class CalibrationSamples:
    """States of a robot in n places.

    Attributes
    ----------
    motor_angles : ndarray, shape (n, m)
        rad.
    tensions : ndarray, shape (n, m), or None
        N; None where no load cell was recorded.
    """

    motor_angles: Floats
    tensions: Floats | None


def calibration_samples(recording: Recording, robot: Robot) -> CalibrationSamples:
    """Return the states of a run wherever a cable's length has changed enough since the last of them.

    Standing still and going slowly so count no more than going fast.

    Raises
    ------
    ControlError
        If cables were slack all the time.
    """
    angles, tensions = recording.states.position, None
    taut = np.isfinite(angles).all(axis=1)
    if recording.tensions is not None:
        tensions = _at(recording.states.time_ns, recording.tensions.time_ns, recording.tensions.effort)
        taut &= (tensions >= robot.tension_min).all(axis=1)
    places = np.flatnonzero(taut)
    if not places.size:
        raise ControlError(
            f"{recording.path}: in no state all cables carry tension_min of the robot's file; their lengths tell "
            "nothing then"
        )
    moved = SPACING * float(robot.winch.home_lengths.mean()) / robot.winch.transmission_ratio
    taken = [places[0]]
    for k in places[1:]:
        if np.abs(angles[k] - angles[taken[-1]]).max() >= moved:
            taken.append(k)
    return CalibrationSamples(angles[taken], None if tensions is None else tensions[taken])


def _at(times: Times, of: Times, values: Floats) -> Floats:
    """Return the values nearest in time."""
    after = np.searchsorted(of, times).clip(1, max(len(of) - 1, 1))
    nearest = (
        np.where(times - of[after - 1] <= of[after] - times, after - 1, after) if len(of) > 1 else 0 * after
    )
    return np.asarray(values[nearest])
