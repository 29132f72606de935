"""Margins of the closed loop over the workspace and the range of payloads (docs/stability.md)."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from cspr_control.stability.feedback import MotionFeedback, StaticFeedback
from cspr_control.stability.linear_plant import LinearPlant, linear_plant
from cspr_control.stability.loop_configuration import LoopConfiguration
from cspr_control.stability.payload_path import PayloadLoop
from cspr_control.stability.safe_gains import RATIOS, SafeGains
from cspr_control.stability.sampled_loop import LoopGains, LoopTiming, SampledLoop
from cspr_kinematics import Payload, Pose, Robot
from cspr_msgs_py.vocabulary import PayloadMethod

POSES = 3  # along each edge of the workspace
MOST_LATE = 10  # cycles

REFUSED_LATE = 1
"""Cycles by which torques may come late, as on a busy computer, without the loop becoming unstable."""

REFUSED_GAIN_MARGIN = 2.0
"""Below this margin of the loop through the estimate, gains are refused."""

LARGEST_GAIN = 100.0
TIME_CONSTANTS = tuple(np.geomspace(1.0, 0.002, 7).tolist())  # s, from where it is safe
GAINS = tuple(np.geomspace(1.0, LARGEST_GAIN, 5).tolist())
_PRECISION = 1.02  # of bisected margins, as a ratio

Progress = Callable[[str, float], None]
"""Told what is computed, and the share that is done."""


class Place(NamedTuple):
    """Where a margin is smallest: position of the platform, m, level, and mass of the payload, kg."""

    position: tuple[float, float, float]
    payload: float

    def __str__(self) -> str:
        """Name the place."""
        x, y, z = self.position
        return f"({x:g}, {y:g}, {z:g}) m with {self.payload:g} kg"


class Margin(NamedTuple):
    """A number, and the place where it is worst; None where no place is worse than others."""

    value: float
    place: Place | None


@dataclass(frozen=True)
class StabilityReport:
    """How far the loop is from instability, over poses of the workspace and payloads.

    Attributes
    ----------
    decay
        Of the slowest mode of the whole loop, 1/s; negative if it grows.
    mechanical_decay
        The same of the controllers alone, without the estimate.
    late_cycles
        By how many cycles torques must come late for the loop to be unstable; `MOST_LATE` + 1 if those do not do it.
    smallest_time_constant
        Of the estimate's filter, below which the loop is unstable, s; 0 if it is stable with all of `TIME_CONSTANTS`.
    gain_margin
        By how much what the estimate adds to the set-points may be multiplied; `LARGEST_GAIN` if by more.
    held_stiffness
        Least eigenvalue of the potential's Hessian, moments counting as forces at 1 m, N/m.
    """

    decay: Margin
    mechanical_decay: Margin
    late_cycles: Margin
    smallest_time_constant: Margin
    gain_margin: Margin
    held_stiffness: Margin

    def words(self) -> dict[str, str]:
        """Return each margin by its name as it is shown everywhere; ``> 100`` where what is looked at ends before."""
        ends = {
            "late_cycles": f"> {MOST_LATE}",
            "smallest_time_constant": f"< {TIME_CONSTANTS[-1]:.3g}",
            "gain_margin": f"> {LARGEST_GAIN:g}",
        }
        return {
            name: ends[name]
            if margin.place is None and name in ends
            else f"{margin.value:{'.0f' if name == 'held_stiffness' else '.3g'}}"
            for name, margin in vars(self).items()
        }


@dataclass(frozen=True, eq=False)
class _Loop:
    """The loop at one place, with each state in which the filter of the estimate may be."""

    place: Place
    sampled: SampledLoop
    feedbacks: tuple[MotionFeedback | StaticFeedback, ...]

    def growth(
        self, gains: LoopGains, late: int = 0, gain: float = 1.0, time_constant: float | None = None
    ) -> float:
        """Return by how much the slowest mode grows in the worst of these states, 1/s."""
        feedbacks = self.feedbacks
        if time_constant is not None:
            feedbacks = tuple(feedback.with_time_constant(time_constant) for feedback in feedbacks)
        return max(self.sampled.growth(gains, feedback, late, gain) for feedback in feedbacks)


class LoopScan:
    """A loop at all places, linearised once, for its margins with whatever gains.

    Parameters
    ----------
    loop
        What is scanned.
    progress
        Told what is computed.

    Raises
    ------
    StabilityError
        If the loop cannot be linearised.
    """

    def __init__(self, loop: LoopConfiguration, progress: Progress = lambda what, share: None) -> None:
        self._configuration = loop
        self._progress = progress
        self._loops = []
        places = _places(loop.robot, loop.feedforward.max_payload)
        for number, place in enumerate(places):
            progress("linearising", number / len(places))
            self._loops.append(_loop_at(place, loop))
        progress("linearising", 1.0)

    def report(self) -> StabilityReport:
        """Return the margins with the gains of the configuration."""
        gains = _loop_gains(self._configuration)
        self._progress("decay", 0.0)
        alone = self._worst(lambda loop: loop.sampled.growth(gains, None))
        whole = self._worst(lambda loop: loop.growth(gains))
        self._progress("late cycles", 0.2)
        late = self._first_unstable(range(1, MOST_LATE + 1), lambda loop, late: loop.growth(gains, late))
        self._progress("gain margin", 0.4)
        gain = self._limit(GAINS, lambda loop, gain: loop.growth(gains, gain=gain))
        self._progress("smallest time constant", 0.7)
        constant = self._limit(
            TIME_CONSTANTS, lambda loop, constant: loop.growth(gains, time_constant=constant)
        )
        held = self._worst(lambda loop: -np.linalg.eigvalsh(loop.sampled.plant.held_stiffness(gains.kp))[0])
        self._progress("margins", 1.0)
        return StabilityReport(
            decay=Margin(-whole.value, whole.place),
            mechanical_decay=Margin(-alone.value, alone.place),
            late_cycles=Margin(MOST_LATE + 1, None) if late is None else late,
            smallest_time_constant=Margin(0.0, None) if constant is None else constant,
            gain_margin=Margin(LARGEST_GAIN, None) if gain is None else gain,
            held_stiffness=Margin(-held.value, held.place),
        )

    def safe_gains(self) -> SafeGains:
        """Return at which gains around those of the configuration no verdict would be a refusal."""
        chosen = self._configuration.gains
        rows, columns = (tuple(ratio * gain for ratio in RATIOS) for gain in (chosen.kp, chosen.kd))
        places = list(self._loops)  # where gains before these were unsafe comes first
        safe = []
        for row, kp in enumerate(rows):
            line = []
            for column, kd in enumerate(columns):
                self._progress("safe gains", (row * len(columns) + column) / (len(rows) * len(columns)))
                gains = _loop_gains(replace(self._configuration, gains=replace(chosen, kp=kp, kd=kd)))
                unsafe = next((loop for loop in places if not _is_safe(loop, gains)), None)
                line.append(unsafe is None)
                if unsafe is not None:
                    places.remove(unsafe)
                    places.insert(0, unsafe)
            safe.append(tuple(line))
        self._progress("safe gains", 1.0)
        return SafeGains(rows, columns, tuple(safe))

    def _worst(self, number: Callable[[_Loop], float]) -> Margin:
        """Return the largest of a number over all places."""
        found = [(float(number(loop)), loop.place) for loop in self._loops]
        return Margin(*max(found, key=lambda each: each[0]))

    def _first_unstable(
        self, values: Iterable[float], growth: Callable[[_Loop, Any], float]
    ) -> Margin | None:
        """Return the first of values with which some loop grows, and where it grows most; None if none does."""
        for value in values:
            worst = self._worst(lambda loop, value=value: growth(loop, value))  # type: ignore[misc]
            if worst.value >= 0.0:
                return Margin(value, worst.place)
        return None

    def _limit(self, values: Sequence[float], growth: Callable[[_Loop, float], float]) -> Margin | None:
        """Return the last stable number between the first unstable one of values and the one before, bisected."""
        safe = values[0]
        for value in values:
            unstable = [loop for loop in self._loops if growth(loop, value) >= 0.0]
            if unstable:
                break
            safe = value
        else:
            return None
        limit, place = value, unstable[0].place
        for loop in unstable:
            if limit != value and growth(loop, limit) < 0.0:
                continue  # others are worse
            stable, grows = safe, limit
            while max(stable / grows, grows / stable) > _PRECISION:
                middle = math.sqrt(stable * grows)
                if growth(loop, middle) < 0.0:
                    stable = middle
                else:
                    grows = middle
            limit, place = grows, loop.place
        return Margin(limit, place)


def _places(robot: Robot, max_payload: float) -> list[Place]:
    edges = zip(robot.workspace_min.tolist(), robot.workspace_max.tolist(), strict=True)
    x, y, z = (np.linspace(low, high, POSES).tolist() for low, high in edges)
    return [Place(position, mass) for position in product(x, y, z) for mass in (0.0, max_payload)]


def growth_at(place: Place, loop: LoopConfiguration) -> float:
    """Return by how much the slowest mode of a loop grows at one place, 1/s; negative where everything decays."""
    return _loop_at(place, loop).growth(_loop_gains(loop))


def _loop_at(place: Place, loop: LoopConfiguration) -> _Loop:
    payload = Payload(place.payload, [0.0, 0.0, loop.payload.payload_height])
    pose, method = Pose(place.position, np.eye(3)), loop.feedforward.tension_method
    plant = linear_plant(loop.robot, pose, payload, method)
    timing = LoopTiming(1.0 / loop.control_rate, loop.latency)
    return _Loop(place, SampledLoop(plant, timing), _feedbacks(plant, loop))


def _loop_gains(loop: LoopConfiguration) -> LoopGains:
    """Return what the gains of the motor controllers make of deviations about rest."""
    motor, gains = loop.robot.motor, loop.gains
    slope = motor.coulomb_friction / gains.friction_smoothing_speed + motor.viscous_friction
    return LoopGains(gains.kp, gains.kd, gains.speed_delay, gains.friction_compensation * slope)


def _feedbacks(plant: LinearPlant, loop: LoopConfiguration) -> tuple[MotionFeedback | StaticFeedback, ...]:
    """Return the filter of the chosen method, as it is at rest, and open as after a change of the mass."""
    payload = loop.payload
    closed = PayloadLoop(plant, 1.0 / loop.control_rate, payload.payload_height, loop.feedforward)
    if payload.method is PayloadMethod.STATIC:
        return (StaticFeedback(closed, payload.static),)
    return tuple(MotionFeedback(closed, payload.motion, is_open) for is_open in (False, True))


def _is_safe(loop: _Loop, gains: LoopGains) -> bool:
    """Tell whether the loop at a place has the margins without which gains are refused."""
    cases = ((0, 1.0), (REFUSED_LATE, 1.0), (0, REFUSED_GAIN_MARGIN))
    return all(loop.growth(gains, late, gain) < 0.0 for late, gain in cases)
