from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from cspr_kinematics import InvalidInputError, Pose, Robot, Twist, Winch, inverse_kinematics


def test_angles_are_zero_at_home(robot: Robot) -> None:
    np.testing.assert_array_equal(
        robot.winch.motor_angle(inverse_kinematics(robot, robot.home).lengths), np.zeros(8)
    )


def test_a_positive_angle_pays_out(robot: Robot) -> None:
    angle = np.zeros(8)
    angle[2] = 2.0 * np.pi * 30.0  # one turn of the drum
    payed_out = robot.winch.cable_lengths(angle) - robot.winch.home_lengths
    assert payed_out[2] == pytest.approx(2.0 * np.pi * 0.05)
    assert np.count_nonzero(payed_out) == 1


def test_lowering_the_platform_turns_all_motors_forward(robot: Robot) -> None:
    lower = Pose(robot.home.position - [0.0, 0.0, 0.1], robot.home.rotation)
    assert (robot.winch.motor_angle(inverse_kinematics(robot, lower).lengths) > 0.0).all()


def test_inverses(robot: Robot, rng: np.random.Generator) -> None:
    values = rng.normal(size=(4, 5, 8))
    winch = robot.winch
    np.testing.assert_allclose(winch.motor_angle(winch.cable_lengths(values)), values, atol=1e-12)
    np.testing.assert_allclose(winch.motor_speed(winch.cable_speed(values)), values)
    np.testing.assert_allclose(winch.tension(winch.motor_torque(values)), values)


def test_transmission_keeps_power(robot: Robot, rng: np.random.Generator) -> None:
    tensions, rates = rng.uniform(50.0, 3000.0, 8), rng.normal(size=8)
    motor_power = robot.winch.motor_torque(tensions) @ robot.winch.motor_speed(rates)
    assert motor_power == pytest.approx(-tensions @ rates)
    assert robot.winch.motor_torque(np.full(8, 3000.0)) == pytest.approx(-5.0)


def test_power_of_the_motors_is_that_of_the_wrench(robot: Robot, rng: np.random.Generator) -> None:
    pose = Pose.from_euler([0.3, -0.2, 1.2], 0.1, 0.05, -0.1)
    twist = Twist(*rng.normal(size=(2, 3)))
    cables = inverse_kinematics(robot, pose)
    tensions = rng.uniform(50.0, 3000.0, 8)
    torque = robot.winch.motor_torque(tensions)
    speed = robot.winch.motor_speed(cables.jacobian @ twist.vector)
    assert torque @ speed == pytest.approx((cables.wrench_matrix @ tensions) @ twist.vector)


@pytest.mark.parametrize("value", [np.zeros(7), np.full(8, np.nan), "x"])
@pytest.mark.parametrize(
    "method", ["motor_angle", "cable_lengths", "motor_speed", "cable_speed", "motor_torque", "tension"]
)
def test_input_is_checked(robot: Robot, method: str, value: object) -> None:
    with pytest.raises(InvalidInputError):
        getattr(robot.winch, method)(value)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        ((0.0, 30.0, np.ones(8)), "drum_radius"),
        ((0.05, -30.0, np.ones(8)), "gear_ratio"),
        ((0.05, np.inf, np.ones(8)), "gear_ratio"),
        ((0.05, 30.0, np.zeros(8)), "home_lengths"),
        ((0.05, 30.0, 1.0), "home_lengths"),
    ],
)
def test_a_winch_needs_positive_dimensions(arguments: tuple[object, ...], name: str) -> None:
    with pytest.raises(InvalidInputError, match=name):
        Winch(*arguments)


@pytest.mark.parametrize(
    "change",
    [
        {"inertia": 0.0},
        {"torque_limit": -1.0},
        {"speed_limit": np.nan},
        {"coulomb_friction": -0.1},
        {"viscous_friction": -0.1},
    ],
)
def test_a_motor_needs_physical_values(robot: Robot, change: dict[str, float]) -> None:
    with pytest.raises(InvalidInputError, match=next(iter(change))):
        dataclasses.replace(robot.motor, **change)
