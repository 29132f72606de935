"""One winch that is wound for a moment, at the operator's command, until its cable is taut.

The controllers cannot do that: while a cable hangs slack the lengths fit no pose, and where its motor should be is not
known. The driver itself lets the motor turn, slowly and with little torque.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import Enum

from cspr_drivers.config.can_file import WindingLimits

DURATION = 0.3  # s, from the moment at which the brake is open
_STIFFNESS = (
    2.0  # share of the torque limit for a motor that stands still; the rest is for what the cable carries
)
_CATCHING_UP = 0.1  # s in which a lasting difference of speed is made up for
_RUNAWAY = 5.0  # times the speed wanted
_SLACK = 0.1  # share of the limit below which a cable carries nothing...
_CARRIES = 0.5  # ...and from which it carries a part of the platform


class Direction(Enum):
    """Which way a cable is wound; the value is the sign of the motor's speed."""

    IN = -1
    OUT = 1


class Winding:
    """The winding of one motor.

    Parameters
    ----------
    motor, cable
        Names.
    direction
        Which way.
    limits
        Speed, torque, tension.
    torque_limit
        Of the motor, N m: with as much a cable that is tight may be held while it is paid out.
    tension
        Of the cable at the beginning, N.

    Attributes
    ----------
    moved
        By how much the motor has turned, rad.
    end
        Why it has ended, in words; empty before.
    """

    def __init__(
        self,
        motor: str,
        cable: str,
        direction: Direction,
        limits: WindingLimits,
        torque_limit: float,
        tension: float,
    ) -> None:
        self.doing = f"{motor} is wound {direction.name.lower()}"
        self.moved = 0.0
        self.end = ""
        self._cable = cable
        self._direction = direction
        self._limits = limits
        push = min(limits.torque, torque_limit)
        self._most = push
        self._least = -push if direction is Direction.IN else -torque_limit
        self._tight = direction is Direction.OUT and tension > limits.tension
        self._gain = _STIFFNESS * limits.torque / limits.speed
        self._carried = 0.0  # N m that the cable has turned out to need
        self._begin: tuple[float, float] | None = None  # time, s, and angle, rad, when the brake was open
        self._time = 0.0

    def torque(self, time: float, angle: float, speed: float, tension: float | None) -> float:
        """Return the torque, N m, of a motor whose brake is open; 0 once `end` says why it is over.

        Parameters
        ----------
        time
            s.
        angle, speed
            Of the motor, rad and rad/s.
        tension
            Of its cable, N; None while it is not known.
        """
        if self._begin is None:
            self._begin, self._time = (time, angle), time
        begin, start = self._begin
        self.moved = angle - start
        self.end = self._why_over(time - begin, speed, tension)
        if self.end:
            return max(self._least, min(self._most, self._carried))
        error = self._direction.value * self._limits.speed - speed
        elapsed, self._time = time - self._time, time
        carried = self._carried + self._gain * error * elapsed / _CATCHING_UP
        self._carried = max(self._least, min(self._most, carried))
        return max(self._least, min(self._most, self._carried + self._gain * error))

    def _why_over(self, elapsed: float, speed: float, tension: float | None) -> str:
        limit = self._limits.tension
        if tension is None:
            return f"the tension of {self._cable} is no longer known"
        if self._direction is Direction.IN and tension > limit:
            return f"{self._cable} is taut and carries {tension:z.0f} N"
        if self._tight and tension < limit:
            return f"{self._cable} carries {tension:z.0f} N and is no longer tight"
        if abs(speed) > _RUNAWAY * self._limits.speed:
            return f"it turned at {speed:z.0f} rad/s"
        return f"{DURATION:g} s are over" if elapsed >= DURATION else ""


def winding_refusal(
    index: int, direction: Direction, tensions: Sequence[float], limits: WindingLimits
) -> str | None:
    """Return why a winch must not be wound, and what to do instead, or `None`.

    Parameters
    ----------
    index
        Of the winch, from 0.
    direction
        Which way.
    tensions
        Of all cables, N; empty while they are not known.
    limits
        Up to which tension a cable is wound.
    """
    cable = f"cable_{index + 1}"
    if not len(tensions) or not math.isfinite(tensions[index]):
        return (
            f"the tension of {cable} is not known, and it would be wound until it breaks: is load_cells running, "
            "and what does /load_cell_states say?"
        )
    tension = tensions[index]
    if direction is Direction.IN:
        if tension > limits.tension:
            return (
                f"{cable} is taut: it carries {tension:z.0f} N, and cables are wound in up to {limits.tension:g} N; "
                "if the lengths do not fit, another cable is slack, or this one too tight: wind_out"
            )
        return None
    if not _CARRIES * limits.tension <= tension <= limits.tension:
        return None
    slack = [k for k, t in enumerate(tensions) if k != index and not t > _SLACK * limits.tension]
    if slack:
        return (
            f"{cable} is not tight, it carries {tension:z.0f} N, and cable_{slack[0] + 1} is slack already: with a "
            f"second one the platform would sink; call /can_drives/motor_{slack[0] + 1}/wind_in first"
        )
    return None
