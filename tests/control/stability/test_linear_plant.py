"""The linearised plant against the equations of motion that MuJoCo solves."""

from dataclasses import replace
from functools import partial

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from cspr_control.errors import StabilityError
from cspr_control.stability.linear_plant import linear_plant
from cspr_kinematics import CableProperties, Payload, Pose, inverse_kinematics, static_wrench


def drawn_pose(robot, rng):
    lower, upper = robot.workspace_min, robot.workspace_max
    return Pose.from_euler(lower + (upper - lower) * rng.random(3), *rng.uniform(-0.1, 0.1, 3))


def accelerations(plant, x, torque):
    """What MuJoCo makes of a state as `LinearPlant` has it: derivative of it, and tensions."""
    data, model, m = plant._data, plant._model, len(torque)
    rest = data.qpos.copy()
    turn = np.empty(9)
    mujoco.mju_quat2Mat(turn, rest[3:7])
    turn = turn.reshape(3, 3)
    angle = np.linalg.norm(x[3:6])
    added = np.array([1.0, 0.0, 0.0, 0.0])
    if angle:
        mujoco.mju_axisAngle2Quat(added, x[3:6] / angle, angle)
    data.qpos[:3] += x[:3]
    mujoco.mju_mulQuat(data.qpos[3:7], added, rest[3:7])
    data.qpos[7:] += x[12 : 12 + m]
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, data.qpos[3:7])
    matrix = matrix.reshape(3, 3)
    data.qvel[:3], data.qvel[3:6], data.qvel[6:] = x[6:9], matrix.T @ x[9:12], x[12 + m :]
    plant._torque_input[:] = torque
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    plant._apply_forces()
    mujoco.mj_forward(model, data)
    qacc = data.qacc.copy()
    derivative = np.concatenate((x[6:12], qacc[:3], matrix @ qacc[3:6], x[12 + m :], qacc[6:]))
    data.qpos[:] = rest
    data.qvel[:] = 0.0
    return derivative, plant.tensions()


def test_derivatives_are_those_of_the_simulated_machine(machine, robot, rng):
    for mass in (0.0, 80.0, 300.0):
        made = machine(drawn_pose(robot, rng), mass)
        plant = made.plant()
        linear = linear_plant(made.robot, made.robot.home, Payload.none())
        torque = made.robot.winch.motor_torque(linear.tensions)
        np.testing.assert_allclose(plant.tensions(), linear.tensions, rtol=1e-6)
        for column in range(len(linear.F)):
            step = 1e-6 * np.eye(len(linear.F))[column]
            plus, minus = accelerations(plant, step, torque), accelerations(plant, -step, torque)
            scale = 1e-5 * np.abs(linear.F).max(axis=1) + 1e-6
            np.testing.assert_array_less(np.abs((plus[0] - minus[0]) / 2e-6 - linear.F[:, column]), scale)
            np.testing.assert_allclose(
                (plus[1] - minus[1]) / 2e-6, linear.C[:, column], atol=1e-5 * np.abs(linear.C).max()
            )
        for motor, step in enumerate(1e-3 * np.eye(len(torque))):
            rest = np.zeros(len(linear.F))
            plus, minus = accelerations(plant, rest, torque + step), accelerations(plant, rest, torque - step)
            np.testing.assert_allclose((plus[0] - minus[0]) / 2e-3, linear.B[:, motor], atol=1e-3)


def test_tensions_carry_heavy_ropes(machine, robot, rng):
    for mass in (0.0, 300.0):
        made = machine(drawn_pose(robot, rng), mass, ropes=0.16)
        linear = linear_plant(made.robot, made.robot.home, Payload.none())
        held = made.plant().tensions()
        np.testing.assert_allclose(linear.tensions, held, atol=0.5)
        np.testing.assert_allclose(linear.wrench_matrix @ (linear.tensions - held), 0.0, atol=0.1)


def test_a_payload_is_part_of_the_platform(machine, robot, rng):
    home = drawn_pose(robot, rng)
    heavy, light = machine(home, 100.0), machine(home, 0.0)
    linear = linear_plant(light.robot, home, Payload(100.0, np.zeros(3)))
    same = linear_plant(heavy.robot, home, Payload.none())
    for name in ("F", "B", "C", "tensions", "mass_matrix"):
        np.testing.assert_allclose(getattr(linear, name), getattr(same, name), rtol=1e-9, atol=1e-9)


def test_the_step_is_that_of_the_differential_equation(machine, robot):
    made = machine(robot.home, 100.0)
    linear = linear_plant(made.robot, robot.home, Payload.none())
    P, G = linear.between(1e-6)
    n = len(linear.F)
    np.testing.assert_allclose(P, np.eye(n) + 1e-6 * linear.F, atol=1e-6 * np.abs(linear.F).max() * 0.01)
    np.testing.assert_allclose(G[-8:], 1e-6 * linear.B[-8:], rtol=1e-3, atol=1e-9)
    once, twice = linear.between(0.002), linear.between(0.004)
    np.testing.assert_allclose(once[0] @ once[0], twice[0], atol=1e-9)
    np.testing.assert_allclose(once[0] @ once[1] + once[1], twice[1], atol=1e-9)


def test_held_stiffness_is_what_a_displaced_platform_feels(machine, robot, rng):
    """The wrench on a displaced platform whose motors have come to rest, from the law of each cable."""
    kp, mass = 2.0, 150.0
    made = machine(drawn_pose(robot, rng), mass)
    robot, home, cables = made.robot, made.robot.home, made.robot.cables
    linear = linear_plant(robot, home, Payload.none())
    r, EA, dead = robot.winch.transmission_ratio, cables.axial_stiffness, cables.dead_length
    free = (inverse_kinematics(robot, home).lengths + dead) / (1.0 + linear.tensions / EA)

    def wrench(displacement):
        turn = Rotation.from_rotvec(displacement[3:]).as_matrix()
        pose = Pose(home.position + displacement[:3], turn @ home.rotation)
        there = inverse_kinematics(robot, pose)

        def left(cable, angle):  # of the torque at a motor that has turned
            pull = EA[cable] * ((there.lengths[cable] + dead[cable]) / (free[cable] + r * angle) - 1.0)
            return kp * angle - r * (pull - linear.tensions[cable])

        angles = np.array([brentq(partial(left, cable), -1.0, 1.0, xtol=1e-14) for cable in range(8)])
        pulls = linear.tensions + kp * angles / r
        return there.wrench_matrix @ pulls - static_wrench(robot, pose)

    steps = 1e-5 * np.eye(6)
    stiffness = -np.array([(wrench(step) - wrench(-step)) / 2e-5 for step in steps]).T
    np.testing.assert_allclose(linear.held_stiffness(kp), stiffness, atol=1e-4 * np.abs(stiffness).max())


def test_what_does_not_stretch_cannot_be_judged(machine, robot):
    made = machine(robot.home, 0.0)
    stiff = replace(made.robot, cables=CableProperties().for_each(8))
    with pytest.raises(StabilityError, match=r"axial_stiffness in robot\.yaml"):
        linear_plant(stiff, robot.home, Payload.none())
