"""Energy and power against MuJoCo, which moves the platform under the cables' pull; the regressor."""

from __future__ import annotations

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
    cable_power,
    combine,
    inertia_matrix,
    inverse_kinematics,
    kinetic_energy,
    potential_energy,
    required_wrench,
    static_wrench,
    wrench_power,
)
from cspr_kinematics.motion.so3 import rotation_from_vector

Motion = Callable[..., tuple[Pose, Twist, Acceleration]]
PAYLOAD = Payload(60.0, [0.2, -0.1, 0.3])


class FreePlatform:
    """MuJoCo's free body with the mass properties of a robot's platform and payload."""

    def __init__(self, body: RigidBody) -> None:
        moments, axes = np.linalg.eigh(body.inertia)
        axes *= np.sign(np.linalg.det(axes))
        numbers = {
            "pos": body.center_of_mass,
            "quat": np.roll(Pose(np.zeros(3), axes).quaternion, 1),
            "diaginertia": moments,
        }
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

    def state(self) -> tuple[Pose, Twist]:
        pose = Pose.from_quaternion(self.data.qpos[:3], np.roll(self.data.qpos[3:7], -1))
        return pose, Twist(self.data.qvel[:3], pose.rotation @ self.data.qvel[3:])


def test_energies_are_those_of_mujoco(cogiro: Robot, random_motion: Motion) -> None:
    pose, twist, _ = random_motion(20)
    kinetic = kinetic_energy(cogiro, pose, twist, PAYLOAD)
    potential = potential_energy(cogiro, pose, PAYLOAD)
    plant = FreePlatform(combine(cogiro.platform, PAYLOAD))
    for k in range(20):
        plant.set(Pose(pose.position[k], pose.rotation[k]), Twist(twist.linear[k], twist.angular[k]))
        np.testing.assert_allclose(plant.data.energy, [potential[k], kinetic[k]], rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys", "cogiro", "six_cables", "twelve_cables"])
def test_the_cables_work_is_the_energy_gained(name: str, request: pytest.FixtureRequest) -> None:
    """MuJoCo moves the platform under A t; what the cables shorten times tension is what its energy gains."""
    robot: Robot = request.getfixturevalue(name)
    plant = FreePlatform(combine(robot.platform, PAYLOAD))
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
        pose, twist = plant.state()
        cables = inverse_kinematics(robot, pose)
        wrench = cables.wrench_matrix @ tensions
        arm = data.xipos[body] - pose.position  # MuJoCo applies it at the centre of mass
        data.xfrc_applied[body, :3] = wrench[:3]
        data.xfrc_applied[body, 3:] = wrench[3:] - np.cross(arm, wrench[:3])
        mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        after = inverse_kinematics(robot, plant.state()[0]).lengths
        work += tensions @ (lengths - after)
        lengths = after
    gained = data.energy.sum() - start
    pose, twist = plant.state()
    ours = kinetic_energy(robot, pose, twist, PAYLOAD) + potential_energy(robot, pose, PAYLOAD)
    assert data.energy.sum() == pytest.approx(float(ours), rel=1e-9)
    assert work == pytest.approx(gained, rel=2e-3, abs=0.05)
    assert abs(gained) > 5.0


def test_power_balance(cogiro: Robot, random_motion: Motion) -> None:
    """The required wrench's power is the rate of kinetic and potential energy along the motion."""
    pose, twist, acceleration = random_motion(30)
    w = required_wrench(cogiro, pose, twist, acceleration, PAYLOAD)
    h = 1e-5

    def energy(sign: float) -> np.ndarray:
        t = sign * h
        turn = twist.angular * t + 0.5 * acceleration.angular * t**2
        moved = Pose(
            pose.position + twist.linear * t + 0.5 * acceleration.linear * t**2,
            rotation_from_vector(turn) @ pose.rotation,
        )
        faster = Twist(twist.linear + acceleration.linear * t, twist.angular + acceleration.angular * t)
        return np.asarray(
            kinetic_energy(cogiro, moved, faster, PAYLOAD) + potential_energy(cogiro, moved, PAYLOAD)
        )

    rate = (energy(1.0) - energy(-1.0)) / (2.0 * h)
    np.testing.assert_allclose(wrench_power(w, twist), rate, rtol=1e-6, atol=1e-3)


def test_cables_and_wrench_have_the_same_power(any_robot: Robot, rng: np.random.Generator) -> None:
    cables = inverse_kinematics(any_robot, any_robot.home)
    tensions = rng.uniform(10.0, 500.0, (4, any_robot.number_of_cables))
    twist = Twist(*rng.normal(size=(2, 3)))
    powers = cable_power(cables, tensions, twist)
    assert powers.shape == tensions.shape
    np.testing.assert_allclose(powers.sum(axis=-1), wrench_power(tensions @ cables.wrench_matrix.T, twist))


def test_wrench_is_linear_in_the_inertial_parameters(cogiro: Robot, random_motion: Motion) -> None:
    motion = random_motion(4, 5)
    Y = balance_regressor(*motion)
    assert Y.shape == (4, 5, 6, 10)
    body = combine(cogiro.platform, PAYLOAD)
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


def test_inertia_matrix_is_positive_definite(cogiro: Robot, random_motion: Motion) -> None:
    pose, _, acceleration = random_motion(10)
    H = inertia_matrix(cogiro, pose, PAYLOAD)
    assert np.linalg.eigvalsh(H).min() > 0.0
    x = np.concatenate((acceleration.linear, acceleration.angular), axis=-1)
    weight = static_wrench(cogiro, pose, PAYLOAD)
    inert = required_wrench(cogiro, pose, Twist.zero(), acceleration, PAYLOAD) - weight
    np.testing.assert_allclose((H @ x[..., None])[..., 0], inert, rtol=1e-9, atol=1e-8)


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


def test_bad_input(robot: Robot) -> None:
    cables, twist = inverse_kinematics(robot, robot.home), Twist.zero()
    with pytest.raises(InvalidInputError, match="wrench"):
        wrench_power(np.full(6, np.nan), twist)
    with pytest.raises(InvalidInputError, match="tensions"):
        cable_power(cables, np.ones(7), twist)
    with pytest.raises(InvalidInputError, match="broadcast"):
        kinetic_energy(robot, Pose(np.zeros((2, 3)), np.eye(3)), Twist(np.zeros((3, 3)), np.zeros(3)))
    with pytest.raises(InvalidInputError, match="broadcast"):
        balance_regressor(
            robot.home, Twist(np.zeros((3, 3)), np.zeros(3)), Acceleration(np.zeros((2, 3)), np.zeros(3))
        )
    for parameters in (np.zeros(9), np.zeros(10), np.ones((2, 10)), np.full(10, np.nan)):
        with pytest.raises(InvalidInputError):
            RigidBody.from_inertial_parameters(parameters)
    with pytest.raises(InvalidInputError, match="payload mass"):
        Payload(-1.0, np.zeros(3))
