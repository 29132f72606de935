"""A motor that turns although its brake is closed."""

import pytest

from cspr_drivers.brakes.brake_watch import BrakeWatch

PERIOD = 0.004


class Shaft:
    def __init__(self, angle=0.0):
        self.watch = BrakeWatch(1, 0.5)
        self.time, self.angle = 10.0, angle

    def turn(self, speed, duration, closed=True):
        """Turn at a speed, rad/s, for a time, s; return the largest slip that was told on the way."""
        told = [0.0]
        for _ in range(round(duration / PERIOD)):
            self.time += PERIOD
            self.angle += PERIOD * speed
            told.append(self.watch.observe(0, self.time, self.angle, closed))
        return max(told, key=abs)


def test_motion_with_an_open_brake_is_none():
    assert Shaft().turn(300.0, 1.0, closed=False) == 0.0


@pytest.mark.parametrize("speed", [2.0, -2.0, 60.0])
def test_a_brake_that_slips_is_told_with_how_far_since_it_closed(speed):
    shaft = Shaft(7.0)
    shaft.turn(0.0, 0.1, closed=False)
    assert shaft.turn(0.0, 1.0) == 0.0
    begin = shaft.angle
    assert shaft.turn(speed, 0.4 / abs(speed)) == 0.0
    assert shaft.turn(speed, 3.0) == pytest.approx(shaft.angle - begin)


def test_it_is_told_as_soon_as_it_is_more_than_nothing():
    shaft = Shaft()
    shaft.turn(0.0, 0.1, closed=False)
    assert shaft.turn(0.0, PERIOD) == 0.0
    assert (
        0.5 < shaft.turn(50.0, 0.012) <= 0.5 + 50.0 * PERIOD
    )  # long before a sound brake has stopped its motor


def test_a_brake_that_closes_on_a_motor_in_motion_may_stop_it():
    shaft = Shaft()
    shaft.turn(200.0, 0.1, closed=False)
    assert not any(shaft.turn(speed, PERIOD) for speed in range(200, 0, -20))
    assert shaft.turn(0.0, 100.0) == 0.0
    assert abs(shaft.turn(10.0, 0.1)) > 0.5


def test_an_encoder_that_steps_and_stands_still_is_no_slip():
    shaft = Shaft()
    shaft.turn(0.0, 1.0)
    shaft.angle += 1.5
    assert shaft.turn(0.0, 100.0) == 0.0


def test_what_creeps_in_days_is_no_slip():
    assert Shaft().turn(0.005, 200.0) == 0.0


def test_a_brake_that_held_in_the_end_is_told_until_it_is_cleared():
    shaft = Shaft()
    shaft.turn(0.0, 1.0)
    shaft.turn(10.0, 0.2)
    assert shaft.watch.moving(shaft.time) == [0]
    assert shaft.turn(0.0, 1.0) == pytest.approx(2.0)
    assert shaft.watch.moving(shaft.time) == []
    shaft.watch.clear()
    assert shaft.turn(0.0, 1.0) == 0.0
    assert abs(shaft.turn(10.0, 1.0)) > 0.5


def test_a_drive_that_takes_over_ends_it():
    shaft = Shaft()
    shaft.turn(10.0, 1.0)
    assert shaft.turn(10.0, 1.0, closed=False) == 0.0
