import math
from dataclasses import replace

import pytest

from cspr_control.errors import SettingError
from cspr_control.motors.motor_control import MotorController, MotorGains, Refusal
from cspr_kinematics import Motor

MOTOR = Motor(
    inertia=0.001, torque_limit=5.0, speed_limit=400.0, coulomb_friction=0.05, viscous_friction=0.0002
)
GAINS = MotorGains(kp=3.0, kd=0.1, speed_delay=0.0, friction_compensation=1.0, friction_smoothing_speed=2.0)
STAMP = 1_700_000_000_000_000_000


@pytest.fixture
def controller():
    return MotorController(MOTOR, GAINS, setpoint_timeout=0.05)


def test_control_law(controller):
    controller.set_setpoint(10.0, STAMP, angle=1.0, speed=4.0, torque=-0.7)
    torque = controller.command(10.004, STAMP, angle=0.9, speed=3.0)
    friction = 0.05 * math.tanh(2.0) + 0.0002 * 4.0
    assert torque == pytest.approx(3.0 * 0.1 + 0.1 * 1.0 - 0.7 + friction)
    assert controller.last_refusal is None


def test_setpoint_is_carried_to_the_time_of_the_state(controller):
    controller.set_setpoint(10.0, STAMP, angle=1.0, speed=50.0, torque=0.0)
    early = controller.command(10.0, STAMP - 1_000_000, angle=0.95, speed=50.0)
    late = controller.command(10.0, STAMP + 2_000_000, angle=1.10, speed=50.0)
    friction = 0.05 * math.tanh(25.0) + 0.01
    assert early == pytest.approx(friction)
    assert late == pytest.approx(friction)


def test_a_measured_speed_is_compared_with_the_desired_one_of_its_time(controller):
    """Along a constant acceleration, the motor exactly on its way, the speed from positions 4 ms apart."""
    controller.set_gains(replace(GAINS, speed_delay=0.002, friction_compensation=0.0))
    acceleration, period = 900.0, 0.004
    for cycle in range(3):
        time = cycle * period
        stamp = STAMP + cycle * 4_000_000
        angle, before = (0.5 * acceleration * t**2 for t in (time, time - period))
        controller.set_setpoint(10.0 + time, stamp, angle, acceleration * time, torque=0.3)
        torque = controller.command(10.0 + time, stamp, angle, (angle - before) / period)
        if cycle:
            assert torque == pytest.approx(0.3)
    # what no motor can follow is no acceleration
    controller.set_setpoint(10.0, stamp + 4_000_000, 0.0, 200.0, torque=0.3)
    assert controller.command(10.0, stamp + 4_000_000, 0.0, 200.0) == pytest.approx(0.3)
    controller.set_setpoint(10.0, stamp + 8_000_000, 0.0, math.nan, torque=0.3)
    assert controller.command(10.0, stamp + 8_000_000, 0.0, 200.0) is None
    controller.set_setpoint(10.0, stamp + 12_000_000, 0.0, 200.0, torque=0.3)
    assert controller.command(10.0, stamp + 12_000_000, 0.0, 200.0) == pytest.approx(0.3)


@pytest.mark.parametrize(("torque", "limited"), [(9.0, 5.0), (-9.0, -5.0)])
def test_torque_is_limited_and_counted(controller, torque, limited):
    controller.set_setpoint(10.0, STAMP, 0.0, 0.0, torque)
    assert controller.command(10.0, STAMP, 0.0, 0.0) == limited
    assert controller.saturations == 1


@pytest.mark.parametrize("position", range(5))
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_nothing_that_is_not_finite_becomes_a_torque(controller, position, value):
    values = [0.1, 0.2, 0.3, 0.1, 0.2]
    values[position] = value
    controller.set_setpoint(10.0, STAMP, *values[:3])
    assert controller.command(10.0, STAMP, *values[3:]) is None
    assert controller.refusals[Refusal.NOT_FINITE] == 1
    assert controller.last_refusal is Refusal.NOT_FINITE


def test_no_torque_without_a_setpoint(controller):
    assert controller.command(10.0, STAMP, 0.0, 0.0) is None
    assert controller.last_refusal is Refusal.NO_SETPOINT


@pytest.mark.parametrize(
    ("time", "stamp"), [(10.051, STAMP), (10.0, STAMP + 51_000_000), (10.0, STAMP - 51_000_000)]
)
def test_no_torque_from_a_stale_setpoint(controller, time, stamp):
    controller.set_setpoint(10.0, STAMP, 0.0, 0.0, 0.0)
    assert controller.command(10.0, STAMP, 0.0, 0.0) is not None
    assert controller.command(time, stamp, 0.0, 0.0) is None
    assert controller.refusals[Refusal.STALE_SETPOINT] == 1


@pytest.mark.parametrize("later", [0, -4_000_000, 4_000_000])
def test_a_setpoint_of_somebody_else_is_not_used(controller, later):
    """For the same moment, for one before, or where the motor cannot be."""
    controller.set_setpoint(10.0, STAMP, angle=1.0, speed=0.0, torque=0.4)
    controller.set_setpoint(10.001, STAMP + later, angle=60.0, speed=0.0, torque=0.0)
    assert controller.unused_setpoints == 1
    assert controller.command(10.002, STAMP, angle=1.0, speed=0.0) == pytest.approx(0.4)


def test_a_step_that_the_motor_can_follow_is_used(controller):
    farthest = 400.0 * 0.004 + 5.0 / 3.0
    controller.set_setpoint(10.0, STAMP, 0.0, 0.0, 0.0)
    controller.set_setpoint(10.004, STAMP + 4_000_000, 0.99 * farthest, 0.0, 0.0)
    controller.set_setpoint(10.008, STAMP + 8_000_000, 2.01 * farthest, 0.0, 0.0)
    assert controller.unused_setpoints == 1


@pytest.mark.parametrize("stamp", [STAMP - 3_600_000_000_000, STAMP + 60_000_000])
def test_a_setpoint_after_a_gap_is_used_whatever_it_is(controller, stamp):
    """The drivers have been started again, or the platform turned out to be elsewhere."""
    controller.set_setpoint(10.0, STAMP, 0.0, 0.0, 0.0)
    controller.set_setpoint(10.06, stamp, 60.0, 0.0, 0.3)
    assert controller.unused_setpoints == 0
    assert controller.command(10.06, stamp, 60.0, 0.0) == pytest.approx(0.3)


def test_gains_change_between_two_commands(controller):
    controller.set_setpoint(10.0, STAMP, 1.0, 0.0, 0.0)
    controller.set_gains(replace(GAINS, kp=1.0, kd=0.0, friction_compensation=0.0))
    assert controller.command(10.0, STAMP, 0.5, 3.0) == pytest.approx(0.5)


def test_derivative_gain_must_fit_inertia_and_rate():
    replace(GAINS, kd=0.49).require_sampled_stability(0.001, 0.004)
    with pytest.raises(SettingError, match=r"must stay below 0\.5"):
        replace(GAINS, kd=0.5).require_sampled_stability(0.001, 0.004)


def test_sampled_stability_limit_is_the_real_one():
    inertia, period = 0.001, 0.004
    for share, stable in ((0.98, True), (1.02, False)):
        gain, speed = share * 2.0 * inertia / period, 1.0
        for _ in range(300):
            speed -= gain * speed / inertia * period
        assert (abs(speed) < 1.0) == stable
