"""The ropes' weight, against elastic catenaries solved by their own equations."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.optimize import fsolve

from cspr_kinematics import (
    CableProperties,
    Pose,
    Robot,
    holding_tensions,
    inverse_kinematics,
    rope_wrench,
    static_wrench,
)

GRAVITY = 9.81


def force_at_the_platform(span: np.ndarray, upper: float, stiffness: float, weight: float) -> np.ndarray:
    """Force (3,) of an elastic catenary on its lower end, from its tension at the upper end.

    With the horizontal pull H and the vertical pull V at the lower end, a rope of natural length L and weight w a
    metre has its upper end at x = H L / EA + (H / w)(asinh((V + w L) / H) - asinh(V / H)) and
    z = (V L + w L^2 / 2) / EA + (hypot(H, V + w L) - hypot(H, V)) / w.
    """
    x, z = float(np.hypot(span[0], span[1])), float(span[2])
    chord = float(np.hypot(x, z))

    def misfit(unknown: np.ndarray) -> list[float]:
        L, H, V = unknown[0], unknown[1], unknown[2]
        top = V + weight * L
        across = H * L / stiffness + H / weight * (np.arcsinh(top / H) - np.arcsinh(V / H))
        up = (V * L + 0.5 * weight * L * L) / stiffness
        up += (np.hypot(H, top) - np.hypot(H, V)) / weight
        return [across - x, up - z, np.hypot(H, top) / upper - 1.0]

    start = [chord, upper * x / chord, upper * z / chord - 0.5 * weight * chord]
    _, H, V = fsolve(misfit, start, xtol=1e-13)
    return np.array([H * span[0] / x, H * span[1] / x, V])


@pytest.mark.parametrize("place", [[0.0, 0.0, 1.0], [1.2, 0.6, 1.8], [1.2, 0.6, 0.4]])
def test_what_the_cells_show_is_the_wrench_on_the_platform_and_that_of_the_ropes(
    robot: Robot, place: list[float]
) -> None:
    heavy = dataclasses.replace(robot, cables=CableProperties(1.2e6, mass_per_metre=np.linspace(0.1, 0.3, 8)))
    pose = Pose.from_euler(place, 0.1, -0.05, 0.08)
    cables = inverse_kinematics(heavy, pose)
    tensions = np.linspace(300.0, 900.0, 8)
    spans = cables.tangent_points - cables.anchor_points
    forces = np.array(
        [
            force_at_the_platform(span, tension, 1.2e6, mass * GRAVITY)
            for span, tension, mass in zip(spans, tensions, heavy.cables.mass_per_metre, strict=True)
        ]
    )
    given = np.concatenate((forces.sum(axis=0), np.cross(cables.arms, forces).sum(axis=0)))
    weight = rope_wrench(heavy, cables)
    assert weight[2] > 20.0
    np.testing.assert_allclose(cables.wrench_matrix @ tensions - weight, given, atol=0.05)


def test_ropes_without_weight_change_nothing(robot: Robot) -> None:
    light = dataclasses.replace(robot, cables=CableProperties(1.2e6))
    poses = Pose.from_euler(np.array([[0.0, 0.0, 1.0], [0.3, 0.2, 1.4]]), 0.0, 0.0, 0.0)
    np.testing.assert_array_equal(rope_wrench(light, inverse_kinematics(light, poses)), np.zeros((2, 6)))


def test_a_batch_is_each_pose_alone(robot: Robot) -> None:
    poses = Pose.from_euler(np.array([[0.0, 0.0, 1.0], [0.3, 0.2, 1.4]]), 0.1, 0.0, -0.1)
    batch = rope_wrench(robot, inverse_kinematics(robot, poses))
    for k in range(2):
        alone = inverse_kinematics(robot, Pose(poses.position[k], poses.rotation[k]))
        np.testing.assert_allclose(batch[k], rope_wrench(robot, alone), rtol=1e-12)


def test_holding_tensions_carry_the_platform_and_half_of_each_rope(robot: Robot) -> None:
    held = holding_tensions(robot, robot.home)
    cables = inverse_kinematics(robot, robot.home)
    wrench = cables.wrench_matrix @ held.tensions - rope_wrench(robot, cables)
    np.testing.assert_allclose(wrench, static_wrench(robot, robot.home), atol=1e-9)
    assert held.feasible
