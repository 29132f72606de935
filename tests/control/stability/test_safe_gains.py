"""The map of gains: exact at its points, whole cells between them, nothing outside."""

from dataclasses import replace

import pytest

from cspr_control.errors import StabilityError
from cspr_control.motors.motor_control import MotorGains
from cspr_control.stability.safe_gains import SafeGains

GAINS = MotorGains(kp=2.0, kd=0.1, speed_delay=0.0, friction_compensation=1.0, friction_smoothing_speed=1.0)
MAP = SafeGains(
    (1.0, 2.0, 4.0), (0.05, 0.1, 0.2), ((True, True, True), (True, True, False), (False, True, False))
)


@pytest.mark.parametrize(
    ("kp", "kd"), [(2.0, 0.1), (1.0, 0.2), (1.5, 0.07), (1.0, 0.15), (4.0, 0.1), (3.0, 0.1)]
)
def test_within_safe_cells(kp, kd):
    MAP.require(replace(GAINS, kp=kp, kd=kd))


@pytest.mark.parametrize(
    ("kp", "kd", "said"),
    [
        (2.0, 0.2, "with this kp, kd from 0.05 to 0.1 is"),
        (1.5, 0.11, "with this kp, kd from 0.05 to 0.1 is"),
        (3.0, 0.07, "with this kp, kd from 0.1 to 0.1 is"),
        (4.1, 0.1, "kp from 1 to 4 and kd from 0.05 to 0.2"),
        (2.0, 0.04, "outside of what has been computed"),
        (0.0, 0.1, "outside of what has been computed"),
    ],
)
def test_beyond_them(kp, kd, said):
    with pytest.raises(StabilityError, match=f"kp = {kp:g} N m/rad with kd = {kd:g}.*{said}"):
        MAP.require(replace(GAINS, kp=kp, kd=kd))


def test_a_kp_for_which_there_is_no_kd():
    unsafe = replace(MAP, safe=((False,) * 3,) * 3)
    with pytest.raises(StabilityError, match="no kd is with this kp"):
        unsafe.require(GAINS)
