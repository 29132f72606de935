"""Laws by which path time runs: the pace at which a trajectory is followed.

Following a trajectory in another time than its own leaves the path as it is. Each law starts and ends its
change of pace with zero slope, so that it adds no jump of acceleration to the motion.
"""

from __future__ import annotations

from typing import NamedTuple

from cspr_control.reference.quintic import quintic, quintic_integral


class PathTime(NamedTuple):
    """Time on the path, s; its rate, 1 when the path is followed in its own time; the derivative of that, 1/s."""

    value: float
    rate: float
    acceleration: float


def rest_to_rest(elapsed: float, length: float, blend_time: float) -> PathTime:
    """Path time that starts from rest, reaches the path's own pace and comes to rest at ``length``.

    The pace rises from 0 to 1 along a quintic over ``blend_time``, and falls over the same time at the end.
    Each of the two passes over half as much path as it takes time: the whole lasts ``length + blend_time``.

    Parameters
    ----------
    elapsed
        Time since the start, s; outside [0, length + blend_time] it counts as the nearer end.
    length
        Time on the path to cover, s, not less than ``blend_time``.
    blend_time
        Time to reach the path's pace from rest, s.
    """
    duration = length + blend_time
    elapsed = min(max(elapsed, 0.0), duration)
    rising = elapsed <= 0.5 * duration
    x = (elapsed if rising else duration - elapsed) / blend_time
    rate, slope, _ = quintic(x)
    covered = blend_time * (quintic_integral(x) + max(x - 1.0, 0.0))
    if rising:
        return PathTime(covered, rate, slope / blend_time)
    return PathTime(length - covered, rate, -slope / blend_time)


def slowing_to_rest(elapsed: float, start: float, stop_time: float) -> PathTime:
    """Path time that runs at the path's own pace at ``start`` and comes to rest within ``stop_time``.

    Parameters
    ----------
    elapsed
        Time since slowing began, s; outside [0, stop_time] it counts as the nearer end.
    start
        Time on the path when slowing began, s.
    stop_time
        Time to come to rest, s; half of it is passed over on the path.
    """
    elapsed = min(max(elapsed, 0.0), stop_time)
    x = elapsed / stop_time
    value, slope, _ = quintic(x)
    return PathTime(start + elapsed - stop_time * quintic_integral(x), 1.0 - value, -slope / stop_time)
