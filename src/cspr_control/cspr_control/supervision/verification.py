"""What a slow motion to and fro tells of the configuration: what is interchanged, and what pulls by another ratio.

Motor angles and tensions at many places must fit the robot as it is described: lengths fit a pose, stretch included,
and nothing is left of the balance that no load explains. Where they do not, each single mistake of wiring or files is
tried in turn (drives, cells, points interchanged in pairs, one polarity): the one with which all fits is named. Each
place is passed in both directions, so that dry friction averages out of the torques, and each motor's torque tells the
ratio by which it pulls.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspr_control.estimation.sync_pairs import SyncPair
from cspr_control.supervision.balance_check import Balance, BalanceSettings
from cspr_kinematics import KinematicsError, Robot

FloatArray = NDArray[np.float64]

_EVERY = 10  # cycles, of which one is kept
_PLACES = 60  # at which the robot is compared with what is tried
_TURNING = 2.0  # rad/s of the motor above which the direction of dry friction is known
_FEWEST = 50  # samples of a motor that turns
_SPARE = [0, 1, 5]  # F_x, F_y, M_z
_LENGTH_SHARE = 1.0 / 15.0  # of length_uncertainty that errors leave over so short a way
_LARGEST = 1e4  # squared deviations, from which it does not matter how wrong something is
_FITS = 5.0  # mean squared deviations of a robot that is as described; a sound one leaves 2 to 3
_EXPLAINS = 0.5  # share of what is left up to which something is an explanation
_AS_WELL = 2.0  # times as much is left by what explains as well, to within what can be told


class Verdict(NamedTuple):
    """What a verification found.

    Attributes
    ----------
    findings
        What is wrong, in words; empty if nothing is.
    remark
        What it has not explained.
    """

    findings: str
    remark: str = ""


class _Mistake(NamedTuple):
    """A mistake that is tried: its name, and the order and signs that take it back, where it is one of these."""

    words: str
    angles: FloatArray | None = None
    tensions: NDArray[np.intp] | None = None
    exits: NDArray[np.intp] | None = None
    anchors: NDArray[np.intp] | None = None
    order: NDArray[np.intp] | None = None


def _mistakes(m: int) -> Iterator[_Mistake]:
    for k in range(m):
        yield _Mistake(f"polarity of motor_{k + 1} (can.yaml)", angles=np.where(np.arange(m) == k, -1.0, 1.0))
    for i, j in combinations(range(m), 2):
        order = np.arange(m)
        order[[i, j]] = j, i
        pair = f"{i + 1} and {j + 1} interchanged"
        yield _Mistake(f"drives {pair} (can.yaml)", order=order)
        yield _Mistake(f"load cells {pair} (can.yaml)", tensions=order)
        yield _Mistake(f"exit points {pair} (robot.yaml)", exits=order)
        yield _Mistake(f"anchor points {pair} (robot.yaml)", anchors=order)


class Verification:
    """Collects what a verification measures, then judges it bit by bit.

    Parameters
    ----------
    robot
        The robot as the controller believes it to be.
    settings
        Load and accuracies.
    first
        What was measured before the brakes opened; gives the limit of the torques.
    speed
        Of the platform, m/s; gives that of the motors.

    Attributes
    ----------
    torque_limit, speed_limit
        Beyond which a motor stops the verification, N m and rad/s.
    """

    def __init__(self, robot: Robot, settings: BalanceSettings, first: SyncPair, speed: float) -> None:
        self._robot = robot
        self._settings = settings
        self._kept: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]] = []
        self._seen = 0
        ratio = robot.winch.transmission_ratio
        self.torque_limit = 1.5 * ratio * float(first.tensions.max()) + 2.0 * robot.motor.coulomb_friction
        self.speed_limit = 2.0 * speed / ratio

    def observe(self, pair: SyncPair, speeds: FloatArray) -> str:
        """Take what a SYNC brought, and the motors' speeds (m,), rad/s; return which limit is exceeded, or nothing."""
        self._seen += 1
        if self._seen % _EVERY == 1:
            self._kept.append((pair.motor_angles, speeds, pair.torques, pair.tensions))
        for values, limit, unit, what in (
            (pair.torques, self.torque_limit, "N m", "torque"),
            (speeds, self.speed_limit, "rad/s", "speed"),
        ):
            k = int(np.abs(values).argmax())
            if not abs(values[k]) <= limit:
                return f"motor_{k + 1}: {what} of {values[k]:.3g} {unit}, limit {limit:.3g} {unit} while it is verified"
        return ""

    def judge(self) -> Iterator[Verdict | None]:
        """Yield None while there is more to try, a few milliseconds of work each, and then the verdict."""
        torques = self._wrong_torques()
        left = self._left(_Mistake(""))
        yield None
        if left <= _FITS or not self._kept:
            yield Verdict(torques)
            return
        tried: list[tuple[float, str]] = []
        for mistake in _mistakes(self._robot.number_of_cables):
            tried.append((self._left(mistake), mistake.words))
            yield None
        best = min(tried)[0]
        if best > _EXPLAINS * left:
            remark = (
                f"angles and tensions fit the robot {np.sqrt(left / _FITS):.1f} times less well than they should, and "
                "nothing interchanged explains that: calibrate home pose, exit and anchor points, pulleys"
            )
            yield Verdict(torques, remark)
            return
        alike = [words for each, words in sorted(tried) if each <= _AS_WELL * max(best, 1.0)]
        yield Verdict("; ".join(filter(None, (" or ".join(alike[:4]), torques))))

    def _left(self, mistake: _Mistake) -> float:
        """Return the mean squared deviations of lengths and balance without a mistake."""
        robot, kept = self._robot, self._kept
        try:
            balance = Balance(self._described_otherwise(mistake))
        except KinematicsError:
            return np.inf
        m = robot.number_of_cables
        lengths, spare = [], []
        for place in np.unique(np.linspace(0, len(kept) - 1, min(_PLACES, len(kept))).astype(int)):
            angles, _, _, tensions = kept[place]
            if mistake.angles is not None:
                angles = angles * mistake.angles
            if mistake.order is not None:
                angles = angles[mistake.order]
            if mistake.tensions is not None:
                tensions = tensions[mistake.tensions]
            excess = balance.excess(angles, tensions)
            if excess is None:
                lengths.append(_LARGEST)
                spare.append(_LARGEST)
                continue
            errors = balance.follower.errors / (_LENGTH_SHARE * robot.length_deviation)
            tolerance = balance.tolerance(tensions, self._settings.cell_accuracy) / 3.0
            lengths.append(min(float(errors @ errors) / max(m - 6, 1), _LARGEST))
            spare.append(min(float(np.square(excess / tolerance)[_SPARE].mean()), _LARGEST))
        return float(np.mean(lengths) + np.mean(spare)) if lengths else 0.0

    def _described_otherwise(self, mistake: _Mistake) -> Robot:
        robot = self._robot
        if mistake.exits is not None:
            return robot.with_geometry(exit_points=robot.exit_points[mistake.exits])
        if mistake.anchors is not None:
            return robot.with_geometry(anchor_points=robot.anchor_points[mistake.anchors])
        return robot

    def _wrong_torques(self) -> str:
        """Return which motors pull by another ratio than robot.yaml says, or nothing."""
        if len(self._kept) < _FEWEST:
            return ""
        _, speeds, torques, tensions = (np.array(each) for each in zip(*self._kept, strict=True))
        told = -torques / self._robot.winch.transmission_ratio
        ratios = np.ones(speeds.shape[1])
        for k in range(len(ratios)):
            turning = np.abs(speeds[:, k]) > _TURNING
            both = [np.count_nonzero(way * speeds[:, k] > _TURNING) for way in (1, -1)]
            if min(both) < _FEWEST // 2:
                continue
            columns = np.column_stack((tensions[turning, k], np.sign(speeds[turning, k])))
            ratios[k] = np.linalg.lstsq(columns, told[turning, k], rcond=None)[0][0]
        wrong = np.abs(ratios - 1.0) > self._settings.torque_accuracy
        if not wrong.any():
            return ""
        if wrong.all():
            mean = float(ratios.mean())
            return (
                f"torques tell {mean:.2f} of the tensions of all cables, friction averaged out: gear_ratio or "
                f"drum_radius (robot.yaml; a gear_ratio of {self._robot.winch.gear_ratio / mean:.3g} would fit), "
                "scale of all load cells (can.yaml)"
            )
        said = ", ".join(f"{ratios[k]:.2f} of cable_{k + 1}" for k in np.flatnonzero(wrong))
        return f"torques tell {said}, friction averaged out: rated_torque, scale of the load cell (can.yaml)"
