"""Positions and speeds that no motor can have: an encoder that slips or loses count, and not its motor, is there.

A controller answers such a step with all the torque that it has, on a motor that has not moved.
"""

from __future__ import annotations

import math


class MotionWatch:
    """The newest believed angle of each motor.

    Parameters
    ----------
    count
        Number of motors (m).
    largest_speed
        That no motor reaches, rad/s.
    period
        Of the control cycle, s. The moments at which two positions were latched are known to a period at best: as
        long counts as the time between them at least.

    Attributes
    ----------
    disbelieved
        Motors, from 0, that have told what cannot be. Nothing of theirs is believed any more until `forget`: what came
        after a step is as wrong as the step.
    """

    def __init__(self, count: int, largest_speed: float, period: float) -> None:
        self._largest_speed = largest_speed
        self._period = period
        self._angles = [math.nan] * count
        self._times = [0.0] * count
        self.disbelieved: set[int] = set()

    def forget(self) -> None:
        """Begin anew: the next angles have nothing to do with those before."""
        self._angles = [math.nan] * len(self._angles)
        self.disbelieved.clear()

    def position_problem(self, index: int, angle: float, time: float) -> str:
        """Note where a motor says that it is; return why that cannot be, or an empty text.

        Parameters
        ----------
        index
            Of the motor.
        angle
            rad.
        time
            Moment at which it was latched, s.
        """
        if index in self.disbelieved:
            return ""
        step, elapsed = angle - self._angles[index], time - self._times[index]
        if abs(step) > self._largest_speed * max(elapsed, self._period):
            self.disbelieved.add(index)
            return f"its position steps by {step:z.2f} rad within {1e3 * elapsed:.0f} ms: no motor is as fast"
        self._angles[index], self._times[index] = angle, time
        return ""

    def speed_problem(self, index: int, speed: float) -> str:
        """Return why a motor cannot have the speed, rad/s, that it tells, or an empty text."""
        if index in self.disbelieved or abs(speed) <= self._largest_speed:
            return ""
        self.disbelieved.add(index)
        return f"its speed is said to be {speed:z.0f} rad/s: no motor is as fast"
