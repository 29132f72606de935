"""Whether the torque of each motor fits the tension of its cable, right after the brakes have opened."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cspr_control.estimation.sync_pairs import SyncPair
from cspr_kinematics import Robot

FloatArray = NDArray[np.float64]

_SETTLING = 0.3  # s after enabling until the motors hold
_DURATION = 0.3  # s of averaging
_FEWEST = 10  # samples
_FRICTION = 1.5  # times the dry friction that robot.yaml states: at rest its direction is not known
_LEAST = 10.0  # N; what neither friction nor accuracy explain
_TURNED = 0.2  # rad, and
_TIGHTER = 20.0  # N by which a cable must change for its motor's direction to be told


class HoldingCheck:
    """Compares torques and tensions of a robot that holds its pose, once for each enabling, within a second.

    What holds at rest is known to the dry friction, so that this finds what is wrong by more: a scale, a rated torque,
    motors or cells that are interchanged where tensions differ. Less is left to the verification, which averages
    friction out.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    accuracy
        Share by which torque and tension may disagree, besides friction.

    Attributes
    ----------
    before
        What was measured last while the brakes were closed, if anything was.
    problem
        What does not fit, in words; empty if nothing is known against it.
    """

    def __init__(self, robot: Robot, accuracy: float) -> None:
        self._accuracy = accuracy
        self._ratio = robot.winch.transmission_ratio
        self._friction = _FRICTION * robot.motor.coulomb_friction / self._ratio
        self.before: SyncPair | None = None
        self._newest: SyncPair | None = None
        self._since = np.inf
        self._torques, self._tensions = np.zeros((2, robot.number_of_cables))
        self._samples = 0
        self.problem = ""

    def observe_braked(self, pair: SyncPair) -> None:
        """Take what a SYNC brought while the brakes were closed."""
        self.before = self._newest = pair
        self.problem = ""
        self._since, self._samples = np.inf, 0
        self._torques[:] = self._tensions[:] = 0.0

    def observe_enabled(self, time: float, pair: SyncPair, holding: bool) -> bool:
        """Take what a SYNC brought while enabled, at a monotonic time, s; return whether there is a problem now.

        Parameters
        ----------
        time, pair
            When, and what.
        holding
            Whether the motors are to stand still.
        """
        self._newest = pair
        self._since = min(self._since, time)
        elapsed = time - self._since
        if self._samples < 0 or elapsed < _SETTLING or pair.torques.shape != self._torques.shape:
            return False
        if holding and elapsed < _SETTLING + _DURATION:
            self._samples += 1
            self._torques += pair.torques
            self._tensions += pair.tensions
            return False
        if self._samples >= _FEWEST:
            self.problem = self._contradiction()
        self._samples = -1
        return bool(self.problem)

    def _contradiction(self) -> str:
        told, measured = -self._torques / (self._ratio * self._samples), self._tensions / self._samples
        limits = self._friction + self._accuracy * np.abs(measured) + _LEAST
        beyond = np.abs(told - measured) - limits
        k = int(beyond.argmax())
        if not beyond[k] > 0.0:
            return ""
        all_alike = bool((beyond > 0.0).all())
        cause = (
            "gear_ratio or drum_radius (robot.yaml), polarity, rated_torque or scale of the load cells (can.yaml)"
            if all_alike
            else f"rated_torque of motor_{k + 1} or scale of its load cell (can.yaml), drives or cells interchanged"
        )
        return (
            f"motor_{k + 1} holds {told[k]:z.0f} N by its torque, cable_{k + 1} carries {measured[k]:z.0f} N, allowed "
            f"difference {limits[k]:.0f} N{', and so do the others' if all_alike else ''}: {cause}"
        )

    def turned_wrongly(self, time: float) -> str:
        """Return which motor has wound in, as it says, a cable that became slacker; or empty.

        Only right after the brakes have opened, when nothing else moves the platform.
        """
        before, newest = self.before, self._newest
        if before is None or newest is None or not 0.0 <= time - self._since <= _SETTLING:
            return ""
        turned, tighter = newest.motor_angles - before.motor_angles, newest.tensions - before.tensions
        wrong = (turned * tighter > 0.0) & (np.abs(turned) > _TURNED) & (np.abs(tighter) > _TIGHTER)
        if not wrong.any():
            return ""
        k = int(np.where(wrong, np.abs(turned), 0.0).argmax())
        way = "in" if turned[k] < 0.0 else "out"
        change = "lost" if tighter[k] < 0.0 else "gained"
        return (
            f"motor_{k + 1} winds {way} and its cable has {change} {abs(tighter[k]):.0f} N: is its polarity (can.yaml) "
            "wrong?"
        )
