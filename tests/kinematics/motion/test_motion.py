"""Twist and acceleration against differences of the poses themselves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cspr_kinematics import (
    InvalidInputError,
    Motion,
    Pose,
    PoseSpline,
    motion_from_euler,
    motion_from_quaternion,
)

STEP = 1e-4
ZERO = np.zeros(3)


def rotation_rate(ahead: np.ndarray, behind: np.ndarray, step: float) -> np.ndarray:
    """Angular velocity (3,) in base between two near rotations, by the skew part of their quotient."""
    difference = ahead @ np.swapaxes(behind, -1, -2)
    return np.array(
        [
            difference[2, 1] - difference[1, 2],
            difference[0, 2] - difference[2, 0],
            difference[1, 0] - difference[0, 1],
        ]
    ) / (2.0 * step)


def assert_consistent(motion_at: object, time: float) -> None:
    """Twist and acceleration at `time` are the differences of poses and twists around it."""
    now, ahead, behind = (motion_at(time + dt) for dt in (0.0, STEP, -STEP))  # type: ignore[operator]
    np.testing.assert_allclose(
        now.twist.linear, (ahead.pose.position - behind.pose.position) / (2.0 * STEP), atol=1e-5
    )
    np.testing.assert_allclose(
        now.twist.angular, rotation_rate(ahead.pose.rotation, behind.pose.rotation, 2.0 * STEP), atol=1e-5
    )
    for name in ("linear", "angular"):
        difference = (getattr(ahead.twist, name) - getattr(behind.twist, name)) / (2.0 * STEP)
        np.testing.assert_allclose(getattr(now.acceleration, name), difference, atol=1e-5)


COEFFICIENTS = st.lists(st.floats(-1.0, 1.0), min_size=12, max_size=12)


@given(COEFFICIENTS, st.floats(-1.0, 1.0))
def test_euler_angles(coefficients: list[float], time: float) -> None:
    c = np.array(coefficients).reshape(4, 3)

    def motion_at(t: float) -> Motion:
        x = c[0] + c[1] * t + c[2] * np.sin(t) + c[3] * t**2
        v = c[1] + c[2] * np.cos(t) + 2.0 * c[3] * t
        a = -c[2] * np.sin(t) + 2.0 * c[3]
        return motion_from_euler(x, v, a, x, v, a)

    assert_consistent(motion_at, time)


@given(COEFFICIENTS, st.floats(-1.0, 1.0))
def test_quaternions_of_any_norm(coefficients: list[float], time: float) -> None:
    c = np.array(coefficients).reshape(3, 4)

    def motion_at(t: float) -> Motion:
        q = np.array([0.0, 0.0, 0.0, 4.0]) + c[0] * np.sin(t) + c[1] * t + c[2] * t**2
        qd = c[0] * np.cos(t) + c[1] + 2.0 * c[2] * t
        qdd = -c[0] * np.sin(t) + 2.0 * c[2]
        return motion_from_quaternion(ZERO, ZERO, ZERO, q, qd, qdd)

    assert_consistent(motion_at, time)


def test_a_turn_about_a_fixed_axis_by_hand() -> None:
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    half, rate, growth = 0.35, 0.8, -0.3
    q = np.append(np.sin(half) * axis, np.cos(half))
    along = np.append(np.cos(half) * axis, -np.sin(half))
    motion = motion_from_quaternion(
        ZERO, ZERO, ZERO, q, 0.5 * rate * along, 0.5 * growth * along - 0.25 * rate**2 * q
    )
    np.testing.assert_allclose(motion.twist.angular, rate * axis, atol=1e-15)
    np.testing.assert_allclose(motion.acceleration.angular, growth * axis, atol=1e-15)


def test_euler_and_quaternion_agree(rng: np.random.Generator) -> None:
    angles, rates, growths = rng.uniform(-1.0, 1.0, (3, 20, 3))
    by_angles = motion_from_euler(ZERO, ZERO, ZERO, angles, rates, growths)

    def quaternion(t: float) -> np.ndarray:
        q = Pose.from_euler(ZERO, *np.moveaxis(angles + rates * t + 0.5 * growths * t**2, -1, 0)).quaternion
        return np.asarray(q)

    h = 1e-3
    q = [quaternion(k * h) for k in (-2, -1, 0, 1, 2)]
    rate = (q[0] - 8.0 * q[1] + 8.0 * q[3] - q[4]) / (12.0 * h)
    growth = (-q[0] + 16.0 * q[1] - 30.0 * q[2] + 16.0 * q[3] - q[4]) / (12.0 * h**2)
    by_quaternion = motion_from_quaternion(ZERO, ZERO, ZERO, q[2], rate, growth)
    np.testing.assert_allclose(by_quaternion.pose.rotation, by_angles.pose.rotation, atol=1e-14)
    np.testing.assert_allclose(by_quaternion.twist.angular, by_angles.twist.angular, atol=1e-9)
    np.testing.assert_allclose(by_quaternion.acceleration.angular, by_angles.acceleration.angular, atol=1e-6)


def test_a_spline_through_samples() -> None:
    times = np.linspace(0.0, 4.0, 81)

    def exact(t: np.ndarray) -> Motion:
        angles = np.stack((3.0 * t, 0.4 * np.sin(t), 0.3 * np.cos(2.0 * t)), axis=-1)
        rates = np.stack((3.0 + 0.0 * t, 0.4 * np.cos(t), -0.6 * np.sin(2.0 * t)), axis=-1)
        growths = np.stack((0.0 * t, -0.4 * np.sin(t), -1.2 * np.cos(2.0 * t)), axis=-1)
        return motion_from_euler(angles, rates, growths, angles, rates, growths)

    spline = PoseSpline(times, exact(times).pose)
    samples = spline(times)
    np.testing.assert_allclose(samples.pose.rotation, exact(times).pose.rotation, atol=1e-12)
    between = np.linspace(0.5, 3.5, 203)
    found, expected = spline(between), exact(between)
    for part, tolerance in (("twist", 1e-6), ("acceleration", 1e-4)):
        for name in ("linear", "angular"):
            np.testing.assert_allclose(
                getattr(getattr(found, part), name), getattr(getattr(expected, part), name), atol=tolerance
            )
    assert_consistent(lambda t: spline(t), 1.2345)


def test_batches_and_bad_input() -> None:
    motion = motion_from_euler(np.zeros((4, 1, 3)), ZERO, ZERO, np.zeros((5, 3)), ZERO, ZERO)
    assert motion.pose.batch_shape == (4, 5)
    with pytest.raises(InvalidInputError, match="angle_rates"):
        motion_from_euler(ZERO, ZERO, ZERO, ZERO, [0.0, np.nan, 0.0], ZERO)
    with pytest.raises(InvalidInputError, match="broadcast"):
        motion_from_euler(ZERO, ZERO, ZERO, np.zeros((2, 3)), np.zeros((3, 3)), ZERO)
    with pytest.raises(InvalidInputError, match="no rotation"):
        motion_from_quaternion(ZERO, ZERO, ZERO, np.zeros(4), np.zeros(4), np.zeros(4))
    poses = Pose(np.zeros((5, 3)), np.eye(3))
    for times in ([0.0, 1.0, 1.0, 2.0, 3.0], [0.0, 1.0], np.zeros((5, 1))):
        with pytest.raises(InvalidInputError, match="times"):
            PoseSpline(times, poses)
    with pytest.raises(InvalidInputError, match="outside the samples"):
        PoseSpline(np.arange(5.0), poses)(4.5)
    assert PoseSpline(np.arange(5.0), poses)(2.5).pose.batch_shape == ()
