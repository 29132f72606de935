import pytest

from cspr_drivers.canopen.units import velocity_unit
from cspr_drivers.drives.motor_feedback import PositionDifference


def test_the_difference_is_over_the_time_that_passed():
    speed = PositionDifference()
    assert speed.update(1.0, [0.0, 1.0]) is None
    assert speed.update(1.004, [0.004, 1.0]) == pytest.approx([1.0, 0.0])
    assert speed.update(1.009, [0.014, 0.995]) == pytest.approx([2.0, -1.0])


def test_the_filter_approaches_a_ramp_as_a_first_order_lag():
    speed = PositionDifference(time_constant=0.02)
    period = 0.0005
    speed.update(0.0, [0.0])
    speed.update(period, [0.0])
    for step in range(2, 2 + round(0.02 / period)):
        (value,) = speed.update(step * period, [3.0 * (step - 1) * period])
    assert value == pytest.approx(3.0 * (1.0 - 0.3679), rel=0.02)  # 1 - 1/e after one time constant


def test_after_a_jump_of_the_zero_the_speed_begins_anew():
    speed = PositionDifference()
    speed.update(0.0, [0.0])
    speed.update(0.1, [0.1])
    speed.clear()
    assert speed.update(0.2, [1000.0]) is None
    assert speed.update(0.3, [1000.1]) == pytest.approx([1.0])


@pytest.mark.parametrize(
    ("code", "unit"),
    [
        # CiA 303-2: prefix, numerator, denominator, reserved.
        (0x00B4_4700, 0.104720),  # revolutions a minute
        (0xFDB4_4700, 1.04720e-4),  # thousandths of them
        (0x00B4_0300, 6.283185),  # revolutions a second
        (0x00B5_0300, 6.283185 / 4096),  # increments a second
        (0x0010_0300, 1.0),  # rad/s
        (0x0000_0000, None),
        (0x0001_4700, None),  # metres a minute
    ],
)
def test_units_of_velocity(code, unit):
    found = velocity_unit(code, 4096)
    assert found is None if unit is None else found == pytest.approx(unit, rel=1e-5)
