"""The machine's clock, in slow motion too, and what time stamps mean on it."""

import time

import pytest

from cspr_drivers.clock import Clock, SlowClock


class SetByHand(Clock):
    """A clock on a computer whose time of day somebody sets."""

    step = 0.0

    def time_of_day(self):
        return time.time() + self.step


@pytest.mark.parametrize("clock", [Clock(), SlowClock(0.25)])
def test_a_frame_is_as_old_as_the_machine_says(clock):
    for _ in range(3):
        before, stamp, after = clock.monotonic(), time.time(), clock.monotonic()
        assert before - 1e-3 <= clock.moment(stamp) <= after + 1e-3
        assert clock.stamp(before) == pytest.approx(stamp, abs=1e-3)
        time.sleep(0.02)


def test_in_slow_motion_a_second_of_the_computer_is_less_for_the_machine():
    clock = SlowClock(0.25)
    stamp = time.time()
    assert clock.moment(stamp + 1.0) - clock.moment(stamp) == pytest.approx(0.25, abs=1e-3)


@pytest.mark.parametrize("step", [-3600.0, 0.5])
def test_ros_time_goes_on_when_the_time_of_day_is_set(step):
    clock = SetByHand()
    before = clock.system_ns()
    clock.step = step
    assert 0 <= clock.system_ns() - before < 1e9
    assert clock.moment(clock.time_of_day()) == pytest.approx(clock.monotonic(), abs=1e-3)
    assert clock.time_of_day_set_by() == pytest.approx(step, abs=1e-3)
