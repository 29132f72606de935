"""Paths of cables against constructions that know nothing of the formulas: hulls, differences, plain geometry."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from cspr_kinematics import (
    CableReachError,
    InvalidInputError,
    KinematicsError,
    Pose,
    Pulleys,
    Robot,
    cable_lengths,
    home_lengths,
    inverse_kinematics,
)
from cspr_kinematics.robot._cable_paths import ON_SWIVEL_AXIS, PATH_EXISTS, cable_path

UP = (0.0, 0.0, 1.0)
STEP = 1e-5


def path(point: np.ndarray, radius: float, axis: tuple[float, ...] = UP) -> tuple[float, float, np.ndarray]:
    """Length, free length and direction of a cable from the origin over a pulley to `point`."""
    fault, length, free, *direction = cable_path(*map(float, point), radius, *axis)
    assert fault in (PATH_EXISTS, ON_SWIVEL_AXIS)
    return length, free, np.array(direction)


def hull_length(s: float, h: float, radius: float) -> float:
    """Length of a string from the origin over a disc to (s, h), by the convex hull of finely many points.

    The string comes from far below the origin, passes over the disc of centre (radius, 0) and is pulled down
    at (s, h): it is the upper part of the boundary of the convex hull of its ends and the disc.
    """
    angle = np.linspace(0.0, 2.0 * np.pi, 40_000, endpoint=False)
    start, end = np.array([0.0, -50.0]), np.array([s, h])
    disc = np.stack((radius - radius * np.cos(angle), radius * np.sin(angle)), axis=-1)
    hull = ConvexHull(np.concatenate(([start, end], disc)))
    closing = np.linalg.norm(end - start)
    return float(hull.area - closing - 50.0)  # the "area" of a plane hull is its perimeter


@given(st.floats(0.0, 2.0 * np.pi), st.floats(0.3, 4.0), st.floats(-4.0, -0.2), st.floats(0.01, 0.12))
def test_length_is_that_of_a_taut_string(turn: float, s: float, h: float, radius: float) -> None:
    point = np.array([s * np.cos(turn), s * np.sin(turn), h])
    length, _, _ = path(point, radius)
    assert length == pytest.approx(hull_length(s, h, radius), abs=2e-8)


@given(
    st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    st.floats(0.01, 0.3),
    st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1),
)
def test_the_cable_is_tangent_to_a_pulley_that_swivels(
    point: tuple[float, ...], radius: float, axis: tuple[float, ...]
) -> None:
    d, k = np.array(point), np.array(axis) / np.linalg.norm(axis)
    across = d - (d @ k) * k
    s = np.linalg.norm(across)
    fault, length, free, *direction = cable_path(*point, radius, *k)
    if np.hypot(s - radius, d @ k) < radius * (1.0 + 1e-9) or s < 1e-3:
        return
    assert fault == PATH_EXISTS
    u, e = np.array(direction), across / s
    center, contact = radius * e, d + free * np.array(direction)
    assert np.linalg.norm(u) == pytest.approx(1.0)
    assert np.linalg.norm(contact - center) == pytest.approx(radius, abs=1e-9)
    assert (contact - center) @ u == pytest.approx(0.0, abs=1e-9)
    assert np.cross(e, k) @ contact == pytest.approx(0.0, abs=1e-9)
    # it leaves in the sense of turning in which it came: from -e over k
    sense = np.cross(contact - center, -u)
    assert sense @ np.cross(-e, k) > 0.0
    wrap = (length - free) / radius
    np.testing.assert_allclose(contact, center + radius * (-np.cos(wrap) * e + np.sin(wrap) * k), atol=1e-9)
    assert 0.0 <= wrap < 2.0 * np.pi


@pytest.mark.parametrize("name", ["robot", "robot_with_pulleys", "twelve_cables"])
def test_cables_say_where_they_leave_their_pulleys(name: str, request: pytest.FixtureRequest) -> None:
    robot: Robot = request.getfixturevalue(name)
    pose = Pose.from_euler(robot.home.position + np.array([[0.1, -0.2, 0.1], [0.0, 0.0, 0.0]]), 0.1, 0.2, 0.3)
    cables, m = inverse_kinematics(robot, pose), robot.number_of_cables
    anchors = pose.position[:, None] + robot.anchor_points @ pose.rotation.swapaxes(-1, -2)
    np.testing.assert_allclose(cables.anchor_points, anchors, atol=1e-12)
    wrapped = cables.lengths - cables.free_lengths
    for k, i in np.ndindex(2, m):
        radius, axis = robot.pulleys.radii(m)[i], robot.pulleys.axes(m)[i]
        offset = cables.tangent_points[k, i] - robot.exit_points[i]
        along = offset @ axis
        across = np.linalg.norm(offset - along * axis)
        # on the circle about the pulley's centre, which lies `radius` across the axis from the exit point
        assert np.hypot(across - radius, along) == pytest.approx(radius, abs=1e-9)
        chord = np.hypot(across, along)
        arc = 2.0 * np.arcsin(min(1.0, 0.5 * chord / radius)) * radius if radius else 0.0
        assert wrapped[k, i] == pytest.approx(arc, abs=1e-9)  # less than half a turn here
    straight = np.linalg.norm(cables.tangent_points - anchors, axis=-1)
    np.testing.assert_allclose(cables.lengths, wrapped + straight, atol=1e-12)


def test_radius_zero_is_the_fixed_point_and_the_limit(robot: Robot, random_pose: Callable[..., Pose]) -> None:
    pose = random_pose(20)
    fixed = inverse_kinematics(robot, pose)
    same = inverse_kinematics(robot.with_geometry(pulleys=Pulleys(0.0, [0.0, 1.0, 1.0])), pose)
    for name in ("lengths", "directions", "wrench_matrix"):
        np.testing.assert_array_equal(getattr(same, name), getattr(fixed, name))
    errors = []
    for radius in (1e-2, 1e-4, 1e-6, 1e-9):
        cables = inverse_kinematics(robot.with_geometry(pulleys=Pulleys(radius)), pose)
        errors.append(np.abs(cables.lengths - fixed.lengths).max())
        np.testing.assert_allclose(cables.directions, fixed.directions, atol=10.0 * radius + 1e-14)
    assert all(error < 4.0 * radius for error, radius in zip(errors, (1e-2, 1e-4, 1e-6, 1e-9), strict=True))


def test_lengths_do_not_change_when_the_anchor_circles_the_axis() -> None:
    angles = np.linspace(-2.0 * np.pi, 2.0 * np.pi, 401)
    lengths = [path(np.array([0.7 * np.cos(a), 0.7 * np.sin(a), -1.5]), 0.05)[0] for a in angles]
    np.testing.assert_allclose(lengths, lengths[0], atol=1e-14)


@pytest.mark.parametrize("height", [-2.0, -0.5, 0.5])
def test_lengths_are_continuous_where_the_pulley_turns_over(height: float) -> None:
    """Across the axis the pulley turns half around; the direction jumps, the length does not."""
    x = np.linspace(-0.02, 0.02, 2001)
    lengths = np.array([path(np.array([v, 1e-12, height]), 0.05)[0] for v in x])
    assert np.abs(np.diff(lengths)).max() < 1.01 * (x[1] - x[0])
    np.testing.assert_allclose(lengths, lengths[::-1], atol=1e-14)


def test_lengths_are_continuous_over_all_wraps() -> None:
    """Around the pulley at a constant distance the wrap runs from nothing to most of a turn."""
    angles = np.linspace(0.01, 1.75 * np.pi, 3000)
    center, reach = 0.05, 0.2
    points = np.stack((center - reach * np.cos(angles), 0.0 * angles, reach * np.sin(angles)), axis=-1)
    points = points[points[:, 0] > 0.0]
    lengths = np.array([path(p, 0.05)[0] for p in points])
    near = np.linalg.norm(np.diff(points, axis=0), axis=1) < 1e-3
    assert np.abs(np.diff(lengths))[near].max() < 1e-3


def test_an_axis_downwards_mirrors_one_upwards() -> None:
    up, down = path(np.array([1.0, 0.4, -2.0]), 0.06), path(np.array([1.0, 0.4, 2.0]), 0.06, (0.0, 0.0, -1.0))
    assert up[0] == pytest.approx(down[0])
    np.testing.assert_allclose(up[2] * [1.0, 1.0, -1.0], down[2])


@pytest.mark.parametrize("name", ["robot_with_pulleys", "twelve_cables"])
def test_jacobian_by_finite_differences(
    name: str, request: pytest.FixtureRequest, rng: np.random.Generator
) -> None:
    robot: Robot = request.getfixturevalue(name)
    pose = Pose.from_euler(
        rng.uniform(robot.workspace_min, robot.workspace_max, (40, 3)), *rng.uniform(-0.5, 0.5, (3, 40))
    )
    differences = np.empty((40, robot.number_of_cables, 6))
    for axis in range(6):
        change = np.zeros(6)
        change[axis] = STEP
        ahead, behind = (
            Pose(
                pose.position + s * change[:3],
                Rotation.from_rotvec(s * change[3:]).as_matrix() @ pose.rotation,
            )
            for s in (1.0, -1.0)
        )
        differences[..., axis] = (cable_lengths(robot, ahead) - cable_lengths(robot, behind)) / (2.0 * STEP)
    np.testing.assert_allclose(inverse_kinematics(robot, pose).jacobian, differences, atol=2e-9)


def test_results_do_not_depend_on_the_base_frame(
    twelve_cables: Robot, random_pose: Callable[..., Pose], rng: np.random.Generator
) -> None:
    """Moving and turning the base, swivel axes with it, turns directions and wrenches and leaves lengths."""
    S, offset = Rotation.random(random_state=np.random.RandomState(5)).as_matrix(), rng.normal(size=3)
    robot = twelve_cables
    pulleys = Pulleys(robot.pulleys.radius, robot.pulleys.swivel_axis @ S.T)
    pose = Pose.from_euler(rng.uniform(robot.workspace_min, robot.workspace_max, (10, 3)), 0.1, -0.2, 0.3)
    moved = Pose(pose.position @ S.T + offset, S @ pose.rotation)
    whole = dataclasses.replace(
        robot,
        workspace_min=np.full(3, -100.0),
        workspace_max=np.full(3, 100.0),
    ).with_geometry(
        exit_points=robot.exit_points @ S.T + offset,
        pulleys=pulleys,
        home=Pose(S @ robot.home.position + offset, S @ robot.home.rotation),
    )
    plain, turned = inverse_kinematics(robot, pose), inverse_kinematics(whole, moved)
    np.testing.assert_allclose(turned.lengths, plain.lengths, atol=1e-12)
    np.testing.assert_allclose(turned.directions, plain.directions @ S.T, atol=1e-12)
    np.testing.assert_allclose(whole.winch.home_lengths, robot.winch.home_lengths, atol=1e-12)


def test_relabelling_cables_relabels_lengths(twelve_cables: Robot, rng: np.random.Generator) -> None:
    robot = twelve_cables
    order = rng.permutation(12)
    other = robot.with_geometry(
        exit_points=robot.exit_points[order],
        anchor_points=robot.anchor_points[order],
        pulleys=Pulleys(robot.pulleys.radius[order], robot.pulleys.swivel_axis[order]),
    )
    plain, permuted = inverse_kinematics(robot, robot.home), inverse_kinematics(other, robot.home)
    np.testing.assert_allclose(permuted.lengths, plain.lengths[order], atol=1e-14)
    np.testing.assert_allclose(permuted.wrench_matrix, plain.wrench_matrix[:, order], atol=1e-14)


def test_a_cable_that_cannot_reach_its_pulley_is_named(robot_with_pulleys: Robot) -> None:
    robot = robot_with_pulleys
    inside = robot.exit_points[3] + [0.05, 0.0, 0.01] - robot.anchor_points[3]
    poses = Pose(np.stack((robot.home.position, inside)), np.eye(3))
    for call in (inverse_kinematics, cable_lengths):
        with pytest.raises(CableReachError, match=r"cable 4: it cannot reach its pulley.*\[1\]") as caught:
            call(robot, poses)
        assert caught.value.cable == 4
        assert caught.value.index == (1,)
        np.testing.assert_allclose(caught.value.position, inside)
        np.testing.assert_allclose(caught.value.rotation, np.eye(3))
        assert isinstance(caught.value, KinematicsError)


def test_an_anchor_on_the_swivel_axis_has_a_length_and_no_direction(robot_with_pulleys: Robot) -> None:
    robot = robot_with_pulleys
    below = Pose(robot.exit_points[0] - [0.0, 0.0, 1.0] - robot.anchor_points[0], np.eye(3))
    beside = Pose(below.position + np.array([1e-7, 0.0, 0.0]), np.eye(3))
    np.testing.assert_allclose(cable_lengths(robot, below), cable_lengths(robot, beside), atol=2e-7)
    with pytest.raises(CableReachError, match="cable 1: its anchor point lies on the swivel axis"):
        inverse_kinematics(robot, below)


def test_home_lengths_are_those_of_the_pulleys(robot_with_pulleys: Robot) -> None:
    robot = robot_with_pulleys
    lengths = home_lengths(robot.exit_points, robot.anchor_points, robot.home, robot.pulleys)
    np.testing.assert_array_equal(lengths, robot.winch.home_lengths)
    np.testing.assert_allclose(robot.winch.motor_angle(cable_lengths(robot, robot.home)), 0.0, atol=1e-12)
    straight = home_lengths(robot.exit_points, robot.anchor_points, robot.home)
    assert np.all(lengths > straight)


def test_surveyed_points_take_home_lengths_over_the_same_pulleys(
    robot_with_pulleys: Robot, rng: np.random.Generator
) -> None:
    """What a simulation does: other points than the controller believes in, same pulleys, own zero."""
    believed = robot_with_pulleys
    exits = believed.exit_points + 1e-3 * rng.normal(size=(8, 3))
    lengths = home_lengths(exits, believed.anchor_points, believed.home, believed.pulleys)
    winch = dataclasses.replace(believed.winch, home_lengths=lengths)
    true = dataclasses.replace(believed, exit_points=exits, winch=winch)
    np.testing.assert_allclose(cable_lengths(true, true.home), lengths)
    np.testing.assert_array_equal(believed.with_geometry(exit_points=exits).winch.home_lengths, lengths)
    with pytest.raises(InvalidInputError, match="home_lengths must be the cable lengths"):
        dataclasses.replace(believed, exit_points=exits)
