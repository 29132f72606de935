"""How long limits in time may be: by the height that the platform loses while they run.

Two things can be wrong meanwhile. A drive that applies another torque than the commanded one may let go of what it
holds: at worst the platform falls freely. Drives that hear no more commands keep the torque that they have, which
balances the load but for a little: a platform that was held stays, one that moved goes on and sinks slowly.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from cspr_drivers.config.timeouts import Timeouts

ALLOWED_DROP = 0.02  # m, unless the configuration says otherwise
_FREE_FALL = 9.81  # m/s^2
# m/s^2, one hundredth of g: in the simulated plant, 353 kg at 0.2 m/s level lose less than 1 mm in any time up to 1 s
_UNBALANCED = 0.1

_KEEPING_TORQUE = ("command", "feedback", "rpdo", "heartbeat_consumer")
"""Limits in time that run while the drives keep their torque."""

_HIDDEN = 0.25  # largest share of a drive's torque limit that it may be off without being noticed


def longest_time(drop: float, acceleration: float) -> float:
    """Return the time, s, in which a platform at rest sinks by `drop`, m, at an acceleration, m/s^2."""
    return math.sqrt(2.0 * drop / acceleration)


def height_faults(
    timeouts: Timeouts,
    check_time: float,
    check_difference: float,
    torque_limits: Sequence[float],
    drop: float,
) -> Iterator[tuple[str, object, str]]:
    """Yield key, value and problem of each limit that costs more height than allowed.

    Parameters
    ----------
    timeouts, check_time, check_difference
        Limits in time, and those of the check of torques, s and N m.
    torque_limits
        Of the drives, N m.
    drop
        Height that each of them may cost, m.
    """
    allowed = f"allowed_drop = {drop:g} m"
    held = longest_time(drop, _UNBALANCED)
    for name in _KEEPING_TORQUE:
        time = getattr(timeouts, name)
        if time > held:
            problem = f"must be at most {held:.3g} s: the drives keep their torque for so long, and what that leaves "
            yield (
                f"timeouts.{name}",
                time,
                problem + f"unbalanced, {_UNBALANCED:g} m/s^2, then costs {allowed}",
            )
    falling = longest_time(drop, _FREE_FALL)
    if check_time > falling:
        problem = f"must be at most {falling:.3g} s: a drive may have let go for so long, and a free fall then costs "
        yield "torque_check.time", check_time, problem + allowed
    largest = _HIDDEN * min(torque_limits)
    if check_difference > largest:
        problem = f"must be at most {largest:g} N m, a quarter of the smallest torque_limit: a drive that lets go of "
        yield "torque_check.difference", check_difference, problem + "more must be noticed"
