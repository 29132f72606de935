"""Whether what the load cells carry is the platform and a load: six equations at each enabling, without motion.

A load explains three of the six components of the wrench A t: its weight, and the moments about x and y. The sideways
forces and the moment about z are spare, and vanish for sound cells at the pose that the lengths tell. The weight lies
between that of the platform and that of platform and largest payload, or is what the operator declares. So cells or
points that are interchanged, a wrong home pose or mass contradict the balance before a brake opens, as far as the
tensions differ enough there: what shows only in motion is left to the verification.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspr_control.estimation.sync_pairs import SyncPair
from cspr_kinematics import GRAVITY, CableFollower, Robot

FloatArray = NDArray[np.float64]

_g = -float(GRAVITY[2])  # m/s^2
_MEAN_TIME = 0.1  # s, of the averaging
_SWINGING = (
    2.0  # s within which a load that swings leaves nothing sideways once: half a period of 4 m of rope
)
_CELL_OFFSET = 1.0  # N; standard deviation of what taring leaves
_DEVIATIONS = 3.0  # standard deviations that are tolerated
_SPARE = {0: "force along x", 1: "force along y", 5: "moment about z"}
SUSPECTS = (
    "load cells (can.yaml) or exit or anchor points (robot.yaml) interchanged or wrong, another home pose"
)
"""What may be wrong where the spare equations do not hold, in words."""


@dataclass(frozen=True)
class BalanceSettings:
    """The parameters of `BalanceCheck`, with meanings and units in `cspr_msgs_py.parameters.table`."""

    declared_load: float
    max_payload: float
    cell_accuracy: float
    weight_accuracy: float
    torque_accuracy: float

    def load_range(self) -> tuple[float, float]:
        """Return the smallest and largest load that may hang from the platform, kg."""
        if self.declared_load >= 0.0:
            return self.declared_load, self.declared_load
        return 0.0, self.max_payload


class Balance:
    """What tensions (m,), N, at motor angles (m,), rad, say of the weight and of what no load explains.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.

    Attributes
    ----------
    follower
        Pose and pull of the cables.
    """

    def __init__(self, robot: Robot) -> None:
        self.follower = CableFollower(robot)
        self._robot = robot

    def excess(self, motor_angles: FloatArray, tensions: FloatArray) -> FloatArray | None:
        """Return what the cables pull (6,) less what holds the platform alone, N and N m; None without a pose."""
        robot, follower = self._robot, self.follower
        if not motor_angles.shape == tensions.shape == (robot.number_of_cables,):
            return None
        if not math.isfinite(motor_angles @ tensions):
            return None
        if not follower.follow(motor_angles, tensions):
            follower.begin_at(robot.home)
            if not follower.follow(motor_angles, tensions):
                return None
        weight = np.array([0.0, 0.0, robot.platform.mass * _g])
        moment = np.cross(follower.rotation @ robot.platform.center_of_mass, weight)
        return np.asarray(follower.wrench - np.concatenate((weight, moment)))

    def tolerance(self, tensions: FloatArray, accuracy: float) -> FloatArray:
        """Return what cells that are off by a share of their tension leave of each component (6,)."""
        each = accuracy * np.abs(tensions) + _CELL_OFFSET
        return np.asarray(_DEVIATIONS * np.sqrt(self.follower.jacobian.T**2 @ each**2))


class BalanceCheck:
    """Averages the balance of a robot at rest, brakes closed, and says what contradicts it.

    A component that has been within its tolerance within the last seconds is not held against a robot: a load that
    swings on a rope pulls sideways.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    settings
        May be replaced at any time.
    """

    def __init__(self, robot: Robot, settings: BalanceSettings) -> None:
        self.settings = settings
        self._robot = robot
        self._balance = Balance(robot)
        self._reach = 0.5 * math.hypot(*robot.platform_size[:2])
        self._tolerance = np.full(6, math.inf)
        self._within = np.full(6, -math.inf)  # when each component last was, s
        self.clear()
        # The first computation is slower than the others; it must not fall into a control cycle.
        self._balance.excess(np.zeros(robot.number_of_cables), robot.home_tensions)

    def clear(self) -> None:
        """Begin anew: the robot has moved."""
        self._samples = 0
        self._time = -math.inf
        self._mean = np.zeros(6)

    def observe(self, time: float, pair: SyncPair) -> None:
        """Take what a SYNC brought, at a monotonic time, s."""
        excess = self._balance.excess(pair.motor_angles, pair.tensions)
        if excess is None:
            return
        if time - self._time > _SWINGING:
            self.clear()
        self._samples += 1
        # the mean of the first samples, until its weight falls to that of the low-pass
        weight = max(1.0 / self._samples, -math.expm1((self._time - time) / _MEAN_TIME))
        self._time = time
        self._mean += weight * (excess - self._mean)
        self._tolerance = self._balance.tolerance(pair.tensions, self.settings.cell_accuracy)
        self._within[self._beyond() <= 0.0] = time

    def _beyond(self) -> FloatArray:
        """Return by how much each component (6,) is beyond its tolerance; not positive where it is within."""
        lowest, highest = self.settings.load_range()
        weight = self._mean[2]
        beyond = np.abs(self._mean) - self._tolerance
        allowed = self._tolerance[2] + self.settings.weight_accuracy * (
            self._robot.platform.mass * _g + max(weight, 0.0)
        )
        beyond[2] = max(lowest * _g - weight, weight - highest * _g) - allowed
        beyond[3:5] -= self._reach * max(weight, 0.0) + self._tolerance[2] * self._reach
        return np.asarray(beyond)

    @property
    def load(self) -> float:
        """What hangs from the platform, kg, as the cells carry it now; not-a-number before the first SYNC."""
        return float(self._mean[2]) / _g if self._samples else math.nan

    def problem(self, time: float, weight_alone: bool = False) -> str:
        """Return which equation does not hold, by how much, and what would explain it; empty where all do.

        Parameters
        ----------
        time
            Monotonic, s.
        weight_alone
            Whether what is left sideways is of no account: a verification is there to find out why.
        """
        if not self._samples:
            return ""
        late = np.flatnonzero(time - self._within > _SWINGING)
        if not late.size:
            return ""
        mean, limit = self._mean, self._tolerance
        if 2 in late:
            return self._wrong_weight()
        if weight_alone:
            return ""
        worst = max(late.tolist(), key=lambda k: float(abs(mean[k]) / limit[k]))
        if worst in _SPARE:
            unit = "N" if worst < 3 else "N m"
            return (
                f"the load cells leave a {_SPARE[worst]} of {mean[worst]:.1f} {unit} that no load explains, limit "
                f"{limit[worst]:.1f} {unit}: {SUSPECTS}; or something pushes the platform"
            )
        return (
            f"the load cells leave a moment about {'xy'[worst - 3]} of {mean[worst]:.1f} N m, as of a load of "
            f"{self.load:.1f} kg beside the platform: {SUSPECTS}"
        )

    def _wrong_weight(self) -> str:
        settings, mass = self.settings, self._robot.platform.mass
        lowest, highest = settings.load_range()
        expected = f"{mass + lowest:.1f} kg"
        if highest > lowest:
            expected = f"between {expected} and {mass + highest:.1f} kg"
        carried = mass + self.load
        cause = "another platform.mass or home pose (robot.yaml), another scale or tare of the load cells"
        if settings.declared_load >= 0.0:
            expected += f", platform and declared_load of {settings.declared_load:g} kg"
            cause = f"another load than is declared; {cause}"
        elif self.load < 0.0:
            cause = f"a platform that stands on something; {cause}"
        return f"the load cells carry {carried:.1f} kg where it should be {expected}: {cause}"
