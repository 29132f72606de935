"""Limits of the supervisor may cost 20 mm of height, by what a platform falls or sinks in a simulation of that."""

import pytest

from cspr_control.errors import SettingError
from cspr_control.parameters.settings import supervision_limits
from cspr_control.supervision.checks import SupervisionLimits
from cspr_msgs_py.parameters.table import defaults

STEP = 1e-5  # s
RATIO = 0.05 / 30.0  # m/rad


def sunk(acceleration, time, speed=0.0):
    """Return by how much a platform sinks, m, one small step after the other."""
    height = 0.0
    for _ in range(round(time / STEP)):
        speed += acceleration * STEP
        height += speed * STEP
    return height


def settings(robot, **values) -> SupervisionLimits:
    return supervision_limits(robot, defaults("supervisor") | {"length_misfit": 3e-4} | values)


@pytest.mark.parametrize(
    ("name", "most", "lost"),
    [
        ("following_error", 12.0, lambda most: most * RATIO),
        ("starting_error", 12.0, lambda most: most * RATIO),
        ("following_error_time", 0.0639, lambda most: sunk(9.81, most)),
        ("motor_speed_time", 0.0267, lambda most: sunk(0.0, most, speed=450.0 * RATIO)),
        ("tension_min_time", 0.632, lambda most: sunk(0.1, most)),
        ("max_age.setpoint", 0.632, lambda most: sunk(0.1, most)),
        ("max_age.cable_tensions", 0.632, lambda most: sunk(0.1, most)),
        ("tension_difference_time", 2.0, lambda most: sunk(0.01, most)),
        ("stuck_time", 2.0, lambda most: sunk(0.01, most)),
        ("slack_misfit", 0.02, lambda most: most),
    ],
)
def test_what_costs_more_than_20_mm_is_refused_with_the_bound(robot, name, most, lost):
    assert lost(most) == pytest.approx(0.02, rel=0.01)
    settings(robot, **{name: 0.99 * most})
    with pytest.raises(SettingError) as refused:
        settings(robot, **{name: 1.01 * most})
    assert str(refused.value).startswith(f"{name} is {1.01 * most:g}; it must be at most {most:.3g}: ")
    settings(robot, **{name: 1.01 * most, "allowed_drop": 0.03})


def test_what_would_hide_a_motor_that_lets_go_is_refused(robot):
    with pytest.raises(
        SettingError, match="tension_difference is 800; it must be at most 750: a quarter of the"
    ):
        settings(robot, tension_difference=800.0)
