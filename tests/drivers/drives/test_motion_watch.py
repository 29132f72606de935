import pytest

from cspr_drivers.drives.motion_watch import MotionWatch


@pytest.fixture
def watch():
    watch = MotionWatch(2, largest_speed=1000.0, period=0.004)
    assert watch.position_problem(0, 300.0, 1.0) == ""  # wherever it begins
    return watch


def test_a_motor_may_be_as_fast_as_a_motor_can_be(watch):
    assert watch.position_problem(0, 303.9, 1.004) == ""
    assert watch.position_problem(0, 300.0, 1.008) == ""
    assert watch.position_problem(0, 330.0, 1.048) == ""  # after answers that did not come
    assert watch.speed_problem(0, -999.0) == ""


def test_a_sync_that_is_early_by_the_computers_clock_accuses_nobody(watch):
    assert watch.position_problem(0, 301.8, 1.0001) == ""


def test_a_step_is_told_once_and_its_motor_believed_no_more(watch):
    assert watch.position_problem(0, 331.4, 1.004) == (
        "its position steps by 31.40 rad within 4 ms: no motor is as fast"
    )
    assert watch.disbelieved == {0}
    assert watch.position_problem(0, 331.4, 1.008) == ""
    assert watch.position_problem(0, 300.0, 1.012) == ""  # not when it is back, either
    assert watch.speed_problem(0, 5000.0) == ""
    assert watch.disbelieved == {0}
    assert watch.position_problem(1, 0.0, 1.012) == ""
    assert watch.position_problem(1, -4.1, 1.016) == (
        "its position steps by -4.10 rad within 4 ms: no motor is as fast"
    )


def test_after_a_reset_it_begins_where_the_encoder_is(watch):
    watch.position_problem(0, 331.4, 1.004)
    watch.forget()
    assert watch.position_problem(0, 331.4, 1.008) == ""
    assert watch.disbelieved == set()
    assert watch.position_problem(0, 300.0, 1.012) != ""


def test_a_speed_is_checked_too(watch):
    assert watch.speed_problem(1, -1500.0) == "its speed is said to be -1500 rad/s: no motor is as fast"
    assert watch.disbelieved == {1}
