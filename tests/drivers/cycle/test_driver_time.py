"""The driver's stamps of the SYNCs, counted by a clock that began elsewhere."""

import random

import pytest

from cspr_drivers.cycle.driver_time import DriverTime

PERIOD = 4_000_000
DELAY = 150_000  # ns from the driver's stamp to the SYNC


@pytest.mark.parametrize("difference", [0, -3_600_000_000_000, 7_123_456_789])
def test_stamps_are_those_of_the_driver_whatever_is_late(difference):
    time, draw = DriverTime(), random.Random(1)
    for cycle in range(1000):
        driver = 1_700_000_000_000_000_000 + cycle * PERIOD
        here = time.sync(driver - difference + DELAY)
        if cycle > 10:
            assert here == driver
        # the driver's stamp of this SYNC or, as often, of the one before
        time.heard(driver - draw.randint(0, 1) * PERIOD)


def test_nothing_is_known_before_the_driver_is_heard():
    time = DriverTime()
    time.heard(5)
    assert time.sync(123) == 123


def test_a_driver_that_begins_anew_is_followed():
    time = DriverTime()
    for start in (10**18, 5 * 10**17):
        for cycle in range(300):
            here = time.sync(7 + cycle * PERIOD)
            time.heard(start + cycle * PERIOD)
        assert here == start + 299 * PERIOD
