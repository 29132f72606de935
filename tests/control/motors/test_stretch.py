"""Set-points that allow for the stretch: without a jump, with the rate that they have."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cspr_control.motors.feedforward import Feedforward, FeedforwardSettings
from cspr_control.motors.stretch import SmoothedStretch
from cspr_control.reference.paper import paper_19
from cspr_kinematics import CableProperties, Motion, Payload, cable_lengths, holding_tensions
from cspr_msgs_py.vocabulary import FeedforwardModel, PayloadSource

PERIOD = 0.004
STILL = np.zeros(8)


def feedforward(robot, payload=200.0, **settings):
    load = Payload(payload, np.zeros(3))
    given = FeedforwardSettings(payload_source=PayloadSource.NOMINAL, nominal_payload=load, **settings)
    return Feedforward(robot, given)


def test_tensions_pass_two_poles(robot):
    """Against the differential equation tau^2 y'' + 2 tau y' + y = u, integrated by scipy."""
    tau, before, after = 0.15, np.full(8, 400.0), np.linspace(300.0, 900.0, 8)
    stretch = SmoothedStretch(robot)
    stretch.rest_at(before)
    lengths = cable_lengths(robot, robot.home)
    times = np.cumsum(np.tile([0.004, 0.003, 0.017, 0.04], 12))
    right = solve_ivp(
        lambda t, y: [*y[8:], *((after - y[:8]) / tau**2 - 2.0 * y[8:] / tau)],
        (0.0, times[-1]), [*before, *STILL], t_eval=times, rtol=1e-10, atol=1e-9,
    )  # fmt: skip
    for step, y in zip(np.diff(times, prepend=0.0), right.y.T, strict=True):
        stretch.follow(after, step, tau)
        motors = stretch.motors(lengths, STILL)
        np.testing.assert_allclose(motors.angle, robot.motor_angles(lengths, y[:8]), atol=1e-7)
        ahead = robot.motor_angles(lengths, y[:8] + 1e-3 * y[8:]) - robot.motor_angles(
            lengths, y[:8] - 1e-3 * y[8:]
        )
        np.testing.assert_allclose(motors.speed, ahead / 2e-3, atol=1e-5)
    np.testing.assert_allclose(motors.angle, robot.motor_angles(lengths, after), atol=0.1)


def test_speed_is_the_rate_of_the_angle_along_a_motion_and_after_a_change_of_load(robot):
    controllers = [Feedforward(robot, FeedforwardSettings(winch_inertia=each)) for each in (True, False)]
    trajectory = paper_19(robot.trajectory_center)
    step, angles, speeds, torques = 1e-4, [], [], []
    for k in range(2000):
        if k in (0, 500):
            for controller in controllers:
                controller.set_estimate(k * step, 200.0 if k else 100.0, np.zeros(3))
        sample = trajectory.sample(1.0 + k * step)
        setpoint, weightless = (controller.compute(k * step, sample) for controller in controllers)
        angles.append(setpoint.angle)
        speeds.append(setpoint.speed)
        torques.append(setpoint.torque - weightless.torque)
    measured = (np.array(angles[2:]) - np.array(angles[:-2])) / (2.0 * step)
    # a change of the input bends the speed within one step
    np.testing.assert_allclose(measured, np.array(speeds[1:-1]), atol=0.01)
    # and winches are given what accelerates them
    inertial = robot.motor.inertia * (np.array(speeds[2:]) - np.array(speeds[:-2])) / (2.0 * step)
    smooth = np.abs(np.arange(1, 1999) - 500) > 1
    np.testing.assert_allclose(np.array(torques[1:-1])[smooth], inertial[smooth], atol=5e-4)
    assert np.abs(inertial[500:520] - inertial[480]).max() > 0.02
    assert np.abs(np.diff(angles, axis=0)).max() < 0.05
    assert np.abs(np.diff(speeds, axis=0)).max() < 0.05


def test_at_rest_motors_hold_the_platform_where_it_should_be(robot):
    setpoint = feedforward(robot).compute(0.0, Motion.at_rest(robot.home))
    lengths = robot.cable_lengths(setpoint.angle, setpoint.tensions)
    np.testing.assert_allclose(lengths, robot.winch.home_lengths, atol=1e-12)
    wound_in = -robot.winch.transmission_ratio * setpoint.angle
    assert (wound_in > 1.5e-3).all()  # 200 kg
    np.testing.assert_array_equal(setpoint.speed, STILL)


def test_set_points_begin_where_the_motors_are_and_go_to_the_stretch_of_the_model(robot):
    controller = feedforward(robot, payload=0.0)
    measured = holding_tensions(robot, robot.home, Payload(200.0, np.zeros(3))).tensions
    held = Motion.at_rest(robot.home)
    controller.following = False
    controller.rest_at(measured)
    angles = [controller.compute(k * PERIOD, held).angle for k in range(10)]
    where = robot.motor_angles(robot.winch.home_lengths, measured)
    np.testing.assert_allclose(angles, np.tile(where, (10, 1)), atol=1e-12)
    controller.following = True
    angles = np.array([where, *(controller.compute(k * PERIOD, held).angle for k in range(10, 500))])
    assert np.abs(np.diff(angles, axis=0)).max() < 0.02  # of 1.1 rad
    np.testing.assert_allclose(angles[-1], feedforward(robot, 0.0).compute(0.0, held).angle, atol=1e-3)
    controller.following = False  # brakes close, and the load changes
    controller.rest_at(measured)
    for k in range(500, 1000):
        np.testing.assert_allclose(controller.compute(k * PERIOD, held).angle, where, atol=1e-12)
    controller.following = True
    np.testing.assert_allclose(controller.compute(1000 * PERIOD, held).angle, where, atol=0.02)


@pytest.mark.parametrize("settings", [{"model": FeedforwardModel.NONE}, {"stretch_compensation": False}])
def test_without_compensation_the_stretch_stays_as_it_was(robot, settings):
    controller = feedforward(robot, **settings)
    held = Motion.at_rest(robot.home)
    np.testing.assert_allclose(controller.compute(0.0, held).angle, 0.0, atol=1e-12)
    measured = np.full(8, 700.0)
    controller.rest_at(measured)
    for k in range(1, 50):
        setpoint = controller.compute(k * PERIOD, held)
    np.testing.assert_allclose(setpoint.angle, robot.motor_angles(robot.winch.home_lengths, measured))


def test_cables_that_do_not_stretch_change_nothing(robot):
    stiff = dataclasses.replace(robot, cables=CableProperties())
    motion = paper_19(robot.trajectory_center).sample(1.0)
    setpoint = feedforward(stiff).compute(0.0, motion)
    lengths = cable_lengths(stiff, motion.pose)
    expected = (lengths - stiff.winch.home_lengths) / stiff.winch.transmission_ratio
    np.testing.assert_array_equal(setpoint.angle, expected)
