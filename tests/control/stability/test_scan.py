"""Margins over the workspace: that they are limits, and that they are the worst ones."""

from dataclasses import replace

import numpy as np
import pytest

from cspr_control.stability import scan as scan_module
from cspr_control.stability.scan import LoopScan, Place, growth_at
from cspr_control.stability.verdict import verdict
from cspr_msgs_py.vocabulary import Level, PayloadMethod


@pytest.fixture(scope="module", autouse=True)
def corners():
    """Let scans look at the corners of the workspace alone, where most margins are smallest."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scan_module, "POSES", 2)
        yield


@pytest.fixture(scope="module")
def reports(loop):
    """Of the shipped loop, and with light motors."""
    robot = loop.robot
    light = replace(
        loop,
        robot=replace(robot, motor=replace(robot.motor, inertia=0.1 * robot.motor.inertia)),
        gains=replace(loop.gains, kd=0.03),
    )
    return {each: LoopScan(each).report() for each in (loop, light)}


def test_the_shipped_loop_has_its_margins(loop, reports):
    report = reports[loop]
    assert verdict(report, loop).level is Level.OK
    assert report.late_cycles.value == 3  # two are borne
    assert 1.5 < report.decay.value < 3.0
    assert report.mechanical_decay.value == pytest.approx(report.decay.value, rel=0.2)
    assert report.gain_margin.value > 4.0
    assert report.held_stiffness.value > 1000.0


def test_light_motors_are_refused(reports):
    (light,) = [each for each in reports if each.gains.kd == 0.03]
    judged = verdict(reports[light], light)
    assert judged.refused
    assert "unstable when torques come 1 cycle late" in judged.text


@pytest.mark.parametrize(
    ("place", "limit"),
    [
        (Place((0.0, 0.0, 1.0), 200.0), 0.032),
        (Place((1.4, 0.7, 2.0), 300.0), 0.091),
        (Place((0.0, 0.7, 2.0), 300.0), 0.144),
    ],
)
def test_the_limits_of_the_static_estimate_with_light_motors(loop, place, limit):
    """Those that docs/tuning.md names."""

    def growth(time_constant):
        motor = replace(loop.robot.motor, inertia=1.5e-4)
        static = replace(loop.payload.static, time_constant=time_constant)
        payload = replace(loop.payload, method=PayloadMethod.STATIC, static=static)
        robot, gains = replace(loop.robot, motor=motor), replace(loop.gains, kd=0.03)
        return growth_at(place, replace(loop, robot=robot, gains=gains, payload=payload))

    assert growth(1.05 * limit) < 0.0 < growth(0.95 * limit)


def test_margins_are_limits(reports):
    """Growth changes its sign there, at the place that is named, and is stable a little before."""
    for loop, report in reports.items():
        scan = LoopScan(loop)
        gains = scan_module._loop_gains(loop)
        at = {each.place: each for each in scan._loops}

        def growth(place, gain=1.0, late=0, time_constant=None, at=at, gains=gains):
            found = at[place]
            return found.growth(gains, late, gain, time_constant)

        gain = report.gain_margin
        if gain.place is None:
            assert all(growth(place, gain=gain.value) < 0.0 for place in at)
        else:
            assert growth(gain.place, gain=gain.value / 1.03) < 0.0 <= growth(gain.place, gain=gain.value)
        late = report.late_cycles
        assert growth(late.place, late=late.value - 1) < 0.0 <= growth(late.place, late=late.value)
        assert all(growth(place, late=late.value - 1) < 0.0 for place in at)
        constant = report.smallest_time_constant
        if constant.place is not None:
            assert growth(constant.place, time_constant=constant.value) >= 0.0
            assert all(growth(place, time_constant=constant.value * 1.05) < 0.0 for place in at)
        worst = max(at, key=growth)
        assert report.decay.place == worst
        assert report.decay.value == pytest.approx(-growth(worst))
        assert growth_at(worst, loop) == growth(worst)


def test_the_map_tells_what_a_scan_would(loop, monkeypatch):
    monkeypatch.setattr(scan_module, "RATIOS", (1.0, 4.0))
    shares = []
    safe = LoopScan(loop, lambda what, share: shares.append(share)).safe_gains()
    assert (safe.kp, safe.kd) == ((2.0, 8.0), (0.1, 0.4))
    for column, kd in enumerate(safe.kd):
        other = replace(loop, gains=replace(loop.gains, kd=kd))
        assert safe.safe[0][column] != verdict(LoopScan(other).report(), other).refused
    assert np.all((np.array(shares) >= 0.0) & (np.array(shares) <= 1.0))
    assert safe.safe[0] == (True, False)
