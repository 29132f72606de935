"""What margins mean: which parameter, which value, which margin, and what to do."""

from dataclasses import replace

import pytest

from cspr_control.stability.scan import Margin, Place
from cspr_control.stability.verdict import verdict
from cspr_msgs_py.vocabulary import Level

PLACE = Place((0.0, 0.7, 2.0), 300.0)


@pytest.mark.parametrize(
    ("margins", "level", "said"),
    [
        ({}, Level.OK, ["stable until torques come 3 cycles late", "gain margin 17"]),
        ({"late_cycles": Margin(11, None)}, Level.OK, ["torques come > 10 cycles late"]),
        ({"gain_margin": Margin(100.0, None)}, Level.OK, ["gain margin > 100"]),
        ({"late_cycles": Margin(2, PLACE)}, Level.WARN, ["2 cycles late", "lower kd"]),
        (
            {"late_cycles": Margin(1, PLACE)},
            Level.ERROR,
            ["kd is 0.1 N m s/rad", "1 cycle late", "0.7, 2) m with 300"],
        ),
        (
            {"gain_margin": Margin(3.9, PLACE)},
            Level.WARN,
            ["gain margin", "3.9", "should be 4", "raise time_constant"],
        ),
        ({"gain_margin": Margin(1.9, PLACE)}, Level.ERROR, ["time_constant", "1.9", "should be 2"]),
        (
            {"decay": Margin(-0.5, PLACE)},
            Level.ERROR,
            ["loop through the estimate is unstable", "stable above 0.002 s", "raise time_constant"],
        ),
        (
            {"mechanical_decay": Margin(-2.0, PLACE)},
            Level.ERROR,
            ["the loop is unstable", "by 2 1/s", "control_rate"],
        ),
    ],
)
def test_verdict(loop, report, margins, level, said):
    judged = verdict(replace(report, **margins), loop)
    assert judged.level is level
    assert judged.refused == (level is Level.ERROR)
    for words in said:
        assert words in str(judged)
