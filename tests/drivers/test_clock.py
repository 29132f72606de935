"""The machine's clock in slow motion, and the time stamps that the kernel gives to frames."""

import time

import pytest

from cspr_drivers.clock import COMPUTER, SlowClock


def test_in_real_time_the_computers_stamps_are_the_machines():
    assert COMPUTER.of_computer(1.7e9) == 1.7e9


def test_in_slow_motion_a_stamp_of_the_computer_is_the_machines_time_of_that_moment():
    clock = SlowClock(0.25)
    for _ in range(3):
        before, stamp, after = clock.system(), time.time(), clock.system()
        assert before - 1e-3 <= clock.of_computer(stamp) <= after + 1e-3
        time.sleep(0.02)
    assert clock.of_computer(stamp + 1.0) - clock.of_computer(stamp) == pytest.approx(0.25, abs=1e-6)
