"""The machine's clock in slow motion, and the time stamps that the kernel gives to frames."""

import time

import pytest

from cspr_drivers import clock


@pytest.fixture
def slow():
    clock.set_speed(0.25)
    yield
    clock.set_speed(1.0)


def test_in_real_time_the_computers_stamps_are_the_machines():
    assert clock.of_computer(1.7e9) == 1.7e9


def test_in_slow_motion_a_stamp_of_the_computer_is_the_machines_time_of_that_moment(slow):
    for _ in range(3):
        before, stamp, after = clock.time(), time.time(), clock.time()
        assert before - 1e-3 <= clock.of_computer(stamp) <= after + 1e-3
        time.sleep(0.02)
    assert clock.of_computer(stamp + 1.0) - clock.of_computer(stamp) == pytest.approx(0.25, abs=1e-6)
