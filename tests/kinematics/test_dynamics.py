"""The wrench of the equations against MuJoCo, which was written by others from other equations."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from cspr_kinematics import (
    GRAVITY,
    Acceleration,
    InvalidInputError,
    Payload,
    Pose,
    RigidBody,
    Robot,
    Twist,
    combine,
    required_wrench,
    static_wrench,
)

Motion = Callable[..., tuple[Pose, Twist, Acceleration]]
INERTIA = np.array([[9.0, 0.7, -1.1], [0.7, 7.5, 0.4], [-1.1, 0.4, 5.0]])


@pytest.fixture
def lopsided(robot: Robot) -> Robot:
    return dataclasses.replace(robot, platform=RigidBody(153.0, [0.2, -0.1, 0.3], INERTIA))


def mujoco_wrench(body: RigidBody, motion: tuple[Pose, Twist, Acceleration]) -> np.ndarray:
    """Force and moment (6,) that a free body needs for a motion, by MuJoCo's inverse dynamics.

    MuJoCo's free joint has the linear velocity in world and the angular one in body axes, and so it has
    their derivatives and forces.
    """
    pose, twist, acceleration = motion
    # principal moments and axes, because MuJoCo 3.2 finds those of a full tensor to eight digits only
    moments, axes = np.linalg.eigh(body.inertia)
    axes *= np.sign(np.linalg.det(axes))
    quaternion = np.roll(Pose(np.zeros(3), axes).quaternion, 1)
    numbers = {"pos": body.center_of_mass, "quat": quaternion, "diaginertia": moments}
    attributes = " ".join(f'{k}="{" ".join(repr(float(x)) for x in v)}"' for k, v in numbers.items())
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 {GRAVITY[2]}"/><worldbody><body><freejoint/>'
        f'<inertial mass="{body.mass!r}" {attributes}/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    Q = pose.rotation
    data.qpos[:3], data.qpos[3:] = pose.position, np.roll(pose.quaternion, 1)
    data.qvel[:3], data.qvel[3:] = twist.linear, Q.T @ twist.angular
    data.qacc[:3], data.qacc[3:] = acceleration.linear, Q.T @ acceleration.angular
    mujoco.mj_inverse(model, data)
    return np.concatenate((data.qfrc_inverse[:3], Q @ data.qfrc_inverse[3:]))


def member(motion: tuple[Pose, Twist, Acceleration], k: int) -> tuple[Pose, Twist, Acceleration]:
    pose, twist, acceleration = motion
    return (
        Pose(pose.position[k], pose.rotation[k]),
        Twist(twist.linear[k], twist.angular[k]),
        Acceleration(acceleration.linear[k], acceleration.angular[k]),
    )


def assert_same_wrench(actual: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(actual, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())


def test_wrench_agrees_with_mujoco_at_random_states(lopsided: Robot, random_motion: Motion) -> None:
    motion = random_motion(200)
    expected = [mujoco_wrench(lopsided.platform, member(motion, k)) for k in range(200)]
    assert_same_wrench(required_wrench(lopsided, *motion), np.array(expected))


def test_wrench_with_payload_agrees_with_mujoco(lopsided: Robot, random_motion: Motion) -> None:
    motion = random_motion(50)
    payload = Payload(200.0, [-0.1, 0.25, -0.4])
    both = combine(lopsided.platform, payload)
    expected = [mujoco_wrench(both, member(motion, k)) for k in range(50)]
    assert_same_wrench(required_wrench(lopsided, *motion, payload), np.array(expected))


def test_wrench_at_rest_is_the_static_one(lopsided: Robot, random_motion: Motion) -> None:
    pose, _, _ = random_motion(20)
    payload = Payload(40.0, [0.1, 0.2, 0.3])
    at_rest = required_wrench(lopsided, pose, Twist.zero(), Acceleration.zero(), payload)
    np.testing.assert_allclose(static_wrench(lopsided, pose, payload), at_rest, atol=1e-11)


def test_hanging_platform_by_hand(robot: Robot) -> None:
    level = Pose([0.0, 0.0, 1.0], np.eye(3))
    weight = 9.81 * 253.0
    np.testing.assert_allclose(
        static_wrench(robot, level, Payload(100.0, [0.1, -0.2, 0.3])),
        [0.0, 0.0, weight, -0.2 * 981.0, -0.1 * 981.0, 0.0],
        atol=1e-10,
    )


def test_external_wrench_is_taken_off(
    lopsided: Robot, random_motion: Motion, rng: np.random.Generator
) -> None:
    motion = random_motion(5)
    external = rng.normal(size=(5, 6))
    for function, arguments in ((required_wrench, motion), (static_wrench, motion[:1])):
        with_it = function(lopsided, *arguments, external_wrench=external)
        np.testing.assert_allclose(with_it, function(lopsided, *arguments) - external)


def test_batches_equal_loops_and_broadcast(lopsided: Robot, random_motion: Motion) -> None:
    motion = random_motion(12)
    payload = Payload(30.0, [0.1, 0.0, 0.2])
    batch = required_wrench(lopsided, *motion, payload)
    singles = [required_wrench(lopsided, *member(motion, k), payload) for k in range(12)]
    np.testing.assert_allclose(batch, singles, rtol=1e-12)
    pose = member(motion, 0)[0]
    fixed_pose = required_wrench(lopsided, pose, *motion[1:])
    assert fixed_pose.shape == (12, 6)
    np.testing.assert_allclose(fixed_pose[3], required_wrench(lopsided, pose, *member(motion, 3)[1:]))
    assert static_wrench(lopsided, pose, external_wrench=np.zeros((4, 6))).shape == (4, 6)


def test_input_is_checked(robot: Robot, random_motion: Motion) -> None:
    motion = random_motion(3)
    with pytest.raises(InvalidInputError, match="external_wrench"):
        required_wrench(robot, *motion, external_wrench=[0.0, 0.0, np.nan, 0.0, 0.0, 0.0])
    with pytest.raises(InvalidInputError, match="external_wrench"):
        static_wrench(robot, motion[0], external_wrench=np.zeros(5))
    with pytest.raises(InvalidInputError, match="broadcast"):
        required_wrench(robot, motion[0], Twist(np.zeros((2, 3)), np.zeros((2, 3))), motion[2])
    with pytest.raises(InvalidInputError, match="broadcast"):
        static_wrench(robot, motion[0], external_wrench=np.zeros((2, 6)))
