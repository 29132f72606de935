"""The paper's trajectories without their jumps: the same path, followed from rest to rest."""

from __future__ import annotations

import numpy as np

from cspr_control.errors import TrajectoryError
from cspr_control.reference.paper import PaperTrajectory
from cspr_control.reference.path_time import PathTime, rest_to_rest
from cspr_control.reference.quintic import Reals
from cspr_kinematics import Motion


class SmoothTrajectory:
    """A `PaperTrajectory` that comes to rest at its start, at its switch and at its end.

    The path turns by a sharp corner at the switch: the only motion along exactly this path with a continuous
    velocity stands still there. Each part is followed in its own time except for ``blend_time`` at its two
    ends, during which the pace changes along a quintic: velocity and acceleration are continuous. Each part
    lasts ``blend_time`` longer than printed.

    Parameters
    ----------
    path
        The trajectory as printed.
    blend_time
        Time from rest to full pace, s, more than zero and at most the shorter of the two parts.

    Raises
    ------
    TrajectoryError
        If the blend time does not fit.
    """

    def __init__(self, path: PaperTrajectory, blend_time: float) -> None:
        shortest = min(path.switch_time, path.duration - path.switch_time)
        if not 0.0 < blend_time <= shortest:
            raise TrajectoryError(
                f"{path.name}: the blend time is {blend_time} s; it must lie in (0, {shortest:g}] s to fit "
                "into the parts of the path"
            )
        self.name = path.name.replace("paper", "smooth")
        self.switch_time = path.switch_time + blend_time
        self.duration = path.duration + 2.0 * blend_time
        self._path = path
        self._blend_time = blend_time

    def sample(self, time: Reals) -> Motion:
        """Return the reference at ``time``, s; times outside [0, duration] count as the nearer end."""
        if isinstance(time, np.ndarray):
            value, rate, acceleration = np.array([self._path_time(t) for t in time.tolist()]).T
        else:
            value, rate, acceleration = self._path_time(time)
        return self._path.sample(value).scaled_in_time(rate, acceleration)

    def _path_time(self, time: float) -> PathTime:
        if time <= self.switch_time:
            begin, end, elapsed = 0.0, self._path.switch_time, time
        else:
            begin, end, elapsed = self._path.switch_time, self._path.duration, time - self.switch_time
        path_time = rest_to_rest(elapsed, end - begin, self._blend_time)
        return path_time._replace(value=begin + path_time.value)
