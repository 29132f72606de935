"""The wrench of the equations against MuJoCo, which was written by others from other equations; the regressor."""

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
    balance_regressor,
    inverse_kinematics,
    required_wrench,
    static_wrench,
)

Motion = Callable[..., tuple[Pose, Twist, Acceleration]]
PAYLOAD = Payload(60.0, [0.2, -0.1, 0.3])
INERTIA = np.array([[9.0, 0.7, -1.1], [0.7, 7.5, 0.4], [-1.1, 0.4, 5.0]])


@pytest.fixture
def lopsided(robot: Robot) -> Robot:
    return dataclasses.replace(robot, platform=RigidBody(153.0, [0.2, -0.1, 0.3], INERTIA))


class FreePlatform:
    """MuJoCo's free body with the mass properties of a robot's platform and payload.

    Its free joint has the linear velocity in world and the angular one in body axes, and so it has their
    derivatives and forces.
    """

    def __init__(self, body: RigidBody) -> None:
        # principal moments and axes, because MuJoCo 3.2 finds those of a full tensor to eight digits only
        moments, axes = np.linalg.eigh(body.inertia)
        axes *= np.sign(np.linalg.det(axes))
        quaternion = np.roll(Pose(np.zeros(3), axes).quaternion, 1)
        numbers = {"pos": body.center_of_mass, "quat": quaternion, "diaginertia": moments}
        attributes = " ".join(f'{k}="{" ".join(repr(float(x)) for x in v)}"' for k, v in numbers.items())
        self.model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option gravity="0 0 {GRAVITY[2]}" timestep="1e-3" integrator="RK4">'
            f'<flag energy="enable"/></option><worldbody><body name="platform"><freejoint/>'
            f'<inertial mass="{body.mass!r}" {attributes}/></body></worldbody></mujoco>'
        )
        self.data = mujoco.MjData(self.model)

    def set(self, pose: Pose, twist: Twist) -> None:
        data = self.data
        data.qpos[:3], data.qpos[3:] = pose.position, np.roll(pose.quaternion, 1)
        data.qvel[:3], data.qvel[3:] = twist.linear, pose.rotation.T @ twist.angular
        mujoco.mj_forward(self.model, data)

    def pose(self) -> Pose:
        return Pose.from_quaternion(self.data.qpos[:3], np.roll(self.data.qpos[3:7], -1))

    def wrench(self, pose: Pose, twist: Twist, acceleration: Acceleration) -> np.ndarray:
        """Force and moment (6,) that the body needs for a motion, by MuJoCo's inverse dynamics."""
        data, Q = self.data, pose.rotation
        self.set(pose, twist)
        data.qacc[:3], data.qacc[3:] = acceleration.linear, Q.T @ acceleration.angular
        mujoco.mj_inverse(self.model, data)
        return np.concatenate((data.qfrc_inverse[:3], Q @ data.qfrc_inverse[3:]))


def combined(body: RigidBody, payload: Payload) -> RigidBody:
    """Body and point mass as one body: inertias about the common centre, by the theorem of parallel axes."""
    mass = body.mass + payload.mass
    offset = payload.center_of_mass - body.center_of_mass
    center = body.center_of_mass + payload.mass / mass * offset
    reduced = body.mass * payload.mass / mass
    return RigidBody(
        mass, center, body.inertia + reduced * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    )


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
    plant = FreePlatform(lopsided.platform)
    expected = [plant.wrench(*member(motion, k)) for k in range(200)]
    assert_same_wrench(required_wrench(lopsided, *motion), np.array(expected))


def test_wrench_with_payload_agrees_with_mujoco(lopsided: Robot, random_motion: Motion) -> None:
    motion = random_motion(50)
    payload = Payload(200.0, [-0.1, 0.25, -0.4])
    plant = FreePlatform(combined(lopsided.platform, payload))
    expected = [plant.wrench(*member(motion, k)) for k in range(50)]
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
    with pytest.raises(InvalidInputError, match="broadcast"):
        balance_regressor(robot.home, motion[1], Acceleration(np.zeros((2, 3)), np.zeros(3)))


def test_wrenches_turn_with_the_base_about_the_vertical(cogiro: Robot, random_motion: Motion) -> None:
    """Gravity leaves one freedom of the base frame: turning it about the vertical, and moving it."""
    pose, twist, acceleration = random_motion(10)
    S = Pose.from_euler(np.zeros(3), 0.7, 0.0, 0.0).rotation
    turned = required_wrench(
        cogiro,
        Pose(pose.position @ S.T + [1.0, 2.0, 3.0], S @ pose.rotation),
        Twist(twist.linear @ S.T, twist.angular @ S.T),
        Acceleration(acceleration.linear @ S.T, acceleration.angular @ S.T),
        PAYLOAD,
    )
    plain = required_wrench(cogiro, pose, twist, acceleration, PAYLOAD)
    np.testing.assert_allclose(turned[:, :3], plain[:, :3] @ S.T, rtol=1e-9, atol=1e-8)
    np.testing.assert_allclose(turned[:, 3:], plain[:, 3:] @ S.T, rtol=1e-9, atol=1e-8)


@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys", "cogiro", "six_cables", "twelve_cables"])
def test_the_cables_work_is_the_energy_gained(name: str, request: pytest.FixtureRequest) -> None:
    """MuJoCo moves the platform under A t; what the cables shorten times tension is what its energy gains."""
    robot: Robot = request.getfixturevalue(name)
    plant = FreePlatform(combined(robot.platform, PAYLOAD))
    model, data = plant.model, plant.data
    home = robot.home
    plant.set(home, Twist([0.2, -0.1, 0.3], [0.3, 0.2, -0.4]))
    A = inverse_kinematics(robot, home).wrench_matrix
    holding = np.linalg.pinv(A) @ static_wrench(robot, home, PAYLOAD)
    body = model.body("platform").id
    work, lengths = 0.0, inverse_kinematics(robot, home).lengths
    start = data.energy.sum()
    for step in range(150):
        # tensions constant over a step, so that its work is exactly tension times shortening
        tensions = holding * (1.2 + 0.3 * np.sin(0.05 * step + np.arange(robot.number_of_cables)))
        pose = plant.pose()
        cables = inverse_kinematics(robot, pose)
        wrench = cables.wrench_matrix @ tensions
        arm = data.xipos[body] - pose.position  # MuJoCo applies it at the centre of mass
        data.xfrc_applied[body, :3] = wrench[:3]
        data.xfrc_applied[body, 3:] = wrench[3:] - np.cross(arm, wrench[:3])
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        after = inverse_kinematics(robot, plant.pose()).lengths
        work += tensions @ (lengths - after)
        lengths = after
    gained = data.energy.sum() - start
    assert work == pytest.approx(gained, rel=2e-3, abs=0.05)
    assert abs(gained) > 5.0


def test_wrench_is_linear_in_the_inertial_parameters(cogiro: Robot, random_motion: Motion) -> None:
    motion = random_motion(4, 5)
    Y = balance_regressor(*motion)
    assert Y.shape == (4, 5, 6, 10)
    body = combined(cogiro.platform, PAYLOAD)
    np.testing.assert_allclose(
        Y @ body.inertial_parameters, required_wrench(cogiro, *motion, PAYLOAD), rtol=1e-9, atol=1e-7
    )
    np.testing.assert_allclose(
        body.inertial_parameters,
        cogiro.platform.inertial_parameters + PAYLOAD.inertial_parameters,
        atol=1e-12,
    )


def test_the_parameters_come_back_from_wrenches(cogiro: Robot, random_motion: Motion) -> None:
    motion = random_motion(20)
    stacked = balance_regressor(*motion).reshape(-1, 10)
    w = required_wrench(cogiro, *motion).ravel()
    found, _, rank, _ = np.linalg.lstsq(stacked, w, rcond=None)
    assert rank == 10
    body = RigidBody.from_inertial_parameters(found)
    assert body.mass == pytest.approx(cogiro.platform.mass)
    np.testing.assert_allclose(body.center_of_mass, cogiro.platform.center_of_mass, atol=1e-10)
    np.testing.assert_allclose(body.inertia, cogiro.platform.inertia, atol=1e-7)


def test_at_rest_only_mass_and_horizontal_moments_show() -> None:
    Y = balance_regressor(Pose(np.zeros(3), np.eye(3)), Twist.zero(), Acceleration.zero())
    assert np.linalg.matrix_rank(Y) == 3
    assert not Y[:, 3:].any()
