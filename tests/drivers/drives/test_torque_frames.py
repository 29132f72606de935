import math

import pytest

from cspr_drivers.drives.motor_feedback import PositionDifference
from cspr_drivers.drives.torque_frames import CommandFault, command_fault


@pytest.mark.parametrize(
    ("torque", "age", "fault"),
    [
        (0.0, 0.0, None),
        (10.0, 0.05, None),
        (-10.0, 0.0, None),
        (math.nan, 0.0, CommandFault.NOT_FINITE),
        (math.inf, 0.0, CommandFault.NOT_FINITE),
        (-math.inf, 0.0, CommandFault.NOT_FINITE),
        (10.001, 0.0, CommandFault.OUT_OF_RANGE),
        (-10.001, 0.0, CommandFault.OUT_OF_RANGE),
        (1.0, 0.051, CommandFault.STALE),
        (1.0, -0.004, CommandFault.AHEAD),
    ],
)
def test_what_is_wrong_with_a_command(torque, age, fault):
    assert command_fault(torque, 10.0, age, 0.05) is fault


def test_speed_is_taken_over_the_time_that_passed():
    speed = PositionDifference()
    assert speed.update(10.0, (1.0, 2.0)) is None
    assert speed.update(10.004, (1.004, 1.998)) == pytest.approx([1.0, -0.5])
    assert speed.update(10.012, (1.012, 1.998)) == pytest.approx([1.0, 0.0])  # one cycle was lost between
