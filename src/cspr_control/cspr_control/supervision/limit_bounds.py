"""How large the supervisor's limits may be: by the height that the platform loses before it is stopped.

A motor that does not hold its cable lets the platform fall at worst. Motors that go on with what they have keep the
balance but for a little, as drives do that hear no more commands. Where only the payload is misjudged, the motors
follow their positions all the same.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

from cspr_control.errors import SettingError
from cspr_control.supervision.checks import MonitoredInput, SupervisionLimits

_FREE_FALL = 9.81  # m/s^2
_UNBALANCED = 0.1  # m/s^2, as for the drivers' limits
_MISJUDGED = 0.01  # m/s^2
_HIDDEN = 0.25  # largest share of what a cable may carry that a load cell or a motor may be off unnoticed

_WHILE_UNBALANCED = ("tension_min_time", "tension_max_time", "slack_hold")
_WHILE_MISJUDGED = ("tension_difference_time", "stuck_time")
_WHILE_THE_CABLE_IS_OFF = ("following_error", "starting_error")
_OF_LENGTHS = ("length_misfit", "slack_misfit")


class _Bound(NamedTuple):
    """A limit, its value, and how much it may be at most and why."""

    name: str
    value: float
    most: float
    why: str


def require_bounded(limits: SupervisionLimits) -> None:
    """Refuse limits that cost more height than `allowed_drop`.

    Raises
    ------
    SettingError
        For the first that is too large, with what it may be at most and why.
    """
    for name, value, most, why in _bounds(limits):
        if value > most * (1.0 + 1e-9):
            raise SettingError(f"{name} is {value:g}; it must be at most {most:.3g}: {why}")


def _bounds(limits: SupervisionLimits) -> Iterator[_Bound]:
    drop = limits.allowed_drop
    costs = f"costs allowed_drop = {drop:g} m"
    cable = drop / limits.transmission_ratio
    for name in _WHILE_THE_CABLE_IS_OFF:
        yield _Bound(name, getattr(limits, name), cable, f"a cable that is longer by as much {costs}")
    for name in _OF_LENGTHS:
        yield _Bound(name, getattr(limits, name), drop, f"a cable that is longer by as much {costs}")
    falling, unbalanced, misjudged = (
        math.sqrt(2.0 * drop / acceleration) for acceleration in (_FREE_FALL, _UNBALANCED, _MISJUDGED)
    )
    yield _Bound("following_error_time", limits.following_error_time, falling, f"a free fall then {costs}")
    fastest = limits.transmission_ratio * limits.motor_speed
    why = f"a cable that runs at the speed limit of its motor, {fastest:.3g} m/s, then {costs}"
    yield _Bound("motor_speed_time", limits.motor_speed_time, drop / fastest, why)
    why = f"motors that keep their torque leave {_UNBALANCED:g} m/s^2 unbalanced, which then {costs}"
    for name in _WHILE_UNBALANCED:
        yield _Bound(name, getattr(limits, name), unbalanced, why)
    for source, age in limits.max_ages.items():
        if source is not MonitoredInput.DRIVE_STATES:  # the driver has stopped the drives by then
            yield _Bound(f"max_age.{source.name.lower()}", age, unbalanced, why)
    why = f"a payload that is misjudged for so long {costs}"
    for name in _WHILE_MISJUDGED:
        yield _Bound(name, getattr(limits, name), misjudged, why)
    most = _HIDDEN * min(limits.tension_max)
    why = "a quarter of the smallest tension_max of the robot, or a motor that lets go of more is not noticed"
    yield _Bound("tension_difference", limits.tension_difference, most, why)
