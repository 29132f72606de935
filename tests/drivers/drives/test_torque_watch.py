import pytest

from cspr_drivers.config.can_file import TorqueCheck
from cspr_drivers.drives.torque_watch import TorqueWatch

CYCLE = 0.004


class Drive:
    """Motor 2 of two, answered for once a cycle."""

    def __init__(self):
        self.watch = TorqueWatch(2, TorqueCheck(difference=1.0, time=0.02))
        self.time = 0.0

    def cycles(self, count, told, applied, operates=True):
        words = ""
        for _ in range(count):
            self.time += CYCLE
            self.watch.told(1, told)
            words = words or self.watch.answered(1, applied, self.time, operates)
        return words


@pytest.fixture
def drive():
    return Drive()


def test_a_drive_that_runs_away_is_found_when_the_time_is_over(drive):
    assert drive.cycles(10, -1.2, -1.2) == ""
    assert drive.cycles(5, -1.2, 10.0) == ""
    assert drive.cycles(1, -1.2, 10.0) == "applies 10.00 N m instead of -1.20 N m"


def test_a_small_difference_and_one_that_passes_are_none(drive):
    assert drive.cycles(100, -1.2, -2.1) == ""
    for _ in range(10):
        assert drive.cycles(5, -1.2, 0.5) == ""
        assert drive.cycles(1, -1.2, -1.2) == ""


def test_an_answer_that_fits_the_command_before_is_right(drive):
    """A torque that swings from limit to limit, and a drive that is one command behind."""
    told = -8.0
    for _ in range(50):
        told = -told
        assert drive.cycles(1, told, -told) == ""


def test_a_drive_that_does_not_operate_is_not_judged_and_begins_anew(drive):
    assert drive.cycles(100, -1.2, 0.0, operates=False) == ""
    assert drive.cycles(5, -1.2, 0.0) == ""
    assert drive.cycles(1, -1.2, -1.2) == ""
