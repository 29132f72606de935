"""Whether the lengths of the cables fit a pose at every SYNC: m lengths for six degrees of freedom.

An encoder that is wrong by d leaves d times a column of P = I - J J^+ in the lengths, whatever the motors make of it,
for the stretch under the tensions of the same SYNC is in the lengths as well. Columns may be parallel (those of the
prototype are, of every other cable), so that lengths alone rarely tell whose encoder it is.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cspr_control.estimation.sync_pairs import SyncPairs
from cspr_control.supervision.checks import SupervisionLimits
from cspr_kinematics import GRAVITY, CableFollower, Robot
from cspr_msgs_py.wire.cdr import NANOSECONDS
from cspr_msgs_py.wire.joint_state import JointStateSample

FloatArray = NDArray[np.float64]

_LONGEST_STEP = 0.02  # s; over a longer gap, nothing is known of how fast a cable was stretched
_AS_WELL = 0.9  # share of what the best motor explains from which another explains the misfit as well
_BEHIND = 3.0  # times as far behind its set-point as the next one is the motor whose encoder is wrong
_SAG_SHARE = 0.5  # of the error of one cable in what is left of all lengths, at most
_LEAST_BEHIND = 0.1  # rad; less does the give of a sound loop
_STANDING = (
    0.1  # rad by which a set-point goes on while an encoder shows the very same angle: a sound one has noise
)


class LengthCheck:
    """Follows the platform by motor angles and tensions of every SYNC, and watches what is left of the lengths.

    A heavy cable of little tension sags: half the largest sag comes on top of `length_misfit`, up to `slack_misfit`.
    While a cell shows less than `slack_tension`, for `slack_hold` afterwards, and where nothing has been heard of the
    cells for as long, cables count as slack, and `slack_misfit` is the limit, unless `length_misfit` is more. A misfit
    beyond it counts when it has lasted for `misfit_cycles`; at once where cables are taut and an encoder stands still
    whose set-point does not.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    limits
        With `length_misfit`, `slack_misfit`, m, `misfit_cycles`, `slack_tension`, N, and `slack_hold`, s.

    Attributes
    ----------
    misfit
        Largest difference between a cable's length and its path at the pose that fits all best, m, at the newest
        SYNC; infinite where none does, not-a-number before the first.
    largest
        The same, the largest since `values` was asked for.
    absent
        Why there is no such check, for a robot that has none; else empty.
    """

    def __init__(self, robot: Robot, limits: SupervisionLimits) -> None:
        m = robot.number_of_cables
        self.misfit = self.largest = math.nan
        self.absent = (
            "" if m > 6 else "the lengths of six cables always fit a pose, so a wrong encoder shows in none"
        )
        self._robot = robot
        self._limits = limits
        self._follower = CableFollower(robot)
        self._pairs = SyncPairs()
        self._unpaired: JointStateSample | None = None  # motor states whose tensions have not come
        self._tensions = robot.home_tensions
        self._taut_since = math.inf  # s, monotonic; infinite while a cable is slack
        self._heard = -math.inf  # s, of the tensions
        self._stamp = 0  # of the newest SYNC, ns
        self._angles, self._behind = np.full(
            (2, m), math.nan
        )  # shown last, and how far behind when they changed, rad
        self._still = np.zeros(m, dtype=bool)
        self._limit = limits.length_misfit
        across = robot.cables.for_each(m).mass_per_metre * GRAVITY[2]  # N/m, of a level cable
        self._sag = (
            _SAG_SHARE * across**2 / 24.0
        )  # times length^3 / tension^2: a flat parabola longer than its chord
        self._exceeded = 0  # cycles in a row
        # The first computation is slower than the others; it must not fall into a control cycle.
        self._follower.follow(np.zeros(m), robot.home_tensions)

    def observe_motors(self, time: float, sample: JointStateSample, following_errors: FloatArray) -> bool:
        """Take motor states at a monotonic time, s; return whether the lengths have fitted too badly from now on.

        Where no tensions of their own SYNC came, states before these count with the last ones.

        Parameters
        ----------
        time, sample
            When they came, and what.
        following_errors
            Of the motors by these states (m,), rad.
        """
        begun = False
        if self._unpaired is not None:
            begun = self._check(time, self._unpaired.stamp_ns, self._unpaired.position)
        if sample.position.shape == self._angles.shape:
            self._behind = np.where(sample.position != self._angles, following_errors, self._behind)
            self._angles = sample.position
            with np.errstate(invalid="ignore"):  # of what is no number nothing is said
                self._still = np.abs(following_errors - self._behind) > _STANDING
        self._unpaired = None
        if (pair := self._pairs.motors(sample)) is None:
            self._unpaired = sample
            return begun
        return self._check(time, pair.stamp, pair.motor_angles) or begun

    def observe_tensions(self, time: float, sample: JointStateSample) -> bool:
        """Take tensions at a monotonic time, s; return whether the lengths have fitted too badly from now on."""
        self._heard, self._tensions = time, sample.effort
        taut = bool((sample.effort >= self._limits.slack_tension).all())
        self._taut_since = min(self._taut_since, time) if taut else math.inf
        if (pair := self._pairs.tensions(sample.stamp_ns, sample.effort)) is None:
            return False
        self._unpaired = None
        return self._check(time, pair.stamp, pair.motor_angles)

    def problem(self, following_errors: FloatArray) -> str:
        """Return how badly the lengths fit, and what may be wrong, if they do for too long; else nothing.

        Parameters
        ----------
        following_errors
            Of the motors (m,), rad.
        """
        limits = self._limits
        if self._exceeded < limits.misfit_cycles:
            return ""
        misfit = (
            f"misfit of {1e3 * self.misfit:.2f} mm"
            if self.misfit < math.inf
            else "they contradict each other"
        )
        return f"{misfit}, limit {1e3 * self._limit:.2f} mm: {self._suspects(following_errors)}"

    def values(self) -> dict[str, str]:
        """Return what diagnostics say: misfits and limit, m."""
        if self.absent:
            return {"absent_check": self.absent}
        largest, self.largest = self.largest, self.misfit
        return {
            "length_misfit": f"{self.misfit:.6f}",
            "length_misfit_max": f"{largest:.6f}",
            "length_misfit_limit": f"{self._limit:.6f}",
        }

    def _check(self, time: float, stamp: int, angles: FloatArray) -> bool:
        if self.absent:
            return False
        limits, step = self._limits, (stamp - self._stamp) / NANOSECONDS
        self._stamp = stamp
        self.misfit = self._fit(angles, step if 0.0 < step <= _LONGEST_STEP else math.inf)
        self.largest = max(self.misfit, self.largest if self.largest >= 0.0 else 0.0)
        taut = time - self._taut_since >= limits.slack_hold >= time - self._heard
        self._still &= taut  # a winch that is blocked stands still as well, and slackens cables
        sag = float((self._sag * self._follower.lengths**3 / self._tensions**2).max()) if taut else math.inf
        self._limit = max(limits.length_misfit, min(limits.length_misfit + sag, limits.slack_misfit))
        before, self._exceeded = self._exceeded, 0 if self.misfit <= self._limit else self._exceeded + 1
        if self._exceeded and self._still.any() and self._still[self._explaining()].any():
            self._exceeded = max(self._exceeded, limits.misfit_cycles)
        return before < limits.misfit_cycles <= self._exceeded

    def _fit(self, angles: FloatArray, step: float) -> float:
        m, follower = self._robot.number_of_cables, self._follower
        if not angles.shape == self._tensions.shape == (m,) or not math.isfinite(angles @ self._tensions):
            return math.inf
        follower.follow(angles, self._tensions, step)
        if follower.misfit == math.inf:
            follower.begin_at(self._robot.home)
            follower.follow(angles, self._tensions)
        return follower.misfit

    def _suspects(self, following_errors: FloatArray) -> str:
        """Return whose encoder or cable may be wrong, by what tells most: standstill, slack, set-points, lengths."""
        suspected = self._explaining()
        still = [k for k in suspected if self._still[k]]
        if len(still) == 1:
            return f"encoder of motor_{still[0] + 1} stands still while its set-point goes on"
        slack = [k for k in suspected if not self._tensions[k] >= self._limits.slack_tension]
        if slack:
            said = "cable_{0} carries {1:z.0f} N, motor_{0} is {2:z.1f} rad behind"
            return ", ".join(said.format(k + 1, self._tensions[k], following_errors[k]) for k in slack)
        behind = sorted(suspected, key=lambda k: -abs(following_errors[k]))
        first, second = (abs(following_errors[k]) for k in (behind + behind)[:2])
        if first >= _LEAST_BEHIND and (len(behind) == 1 or first >= _BEHIND * second):
            k = behind[0]
            return f"encoder of motor_{k + 1}, which shows {following_errors[k]:z.2f} rad less than wanted"
        names = ", ".join(f"motor_{k + 1}" for k in suspected)
        return f"encoder or cable of {'one of ' if len(suspected) > 1 else ''}{names}"

    def _explaining(self) -> list[int]:
        """Return the motors, from 0, each of whose lengths alone explains the misfit, and as well as any other."""
        if not self.misfit < math.inf:
            return list(range(self._robot.number_of_cables))
        J, errors = self._follower.jacobian, self._follower.errors
        left = 1.0 - np.einsum(
            "ij,ji->i", J, np.linalg.pinv(J)
        )  # diagonal of P: what shows of an error of one's own
        explained = errors**2 / np.maximum(left, 1e-9)
        return [int(k) for k in np.flatnonzero(explained >= _AS_WELL * explained.max())]
