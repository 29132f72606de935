"""Distances between cables and to the platform against a general-purpose minimiser."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from cspr_kinematics import InvalidInputError, Pose, Pulleys, Robot, cable_interference, inverse_kinematics
from cspr_kinematics.workspace._interference import segment_box_distance_kernel, segment_distance_kernel

triples = st.tuples(*[st.floats(-2.0, 2.0).map(lambda v: round(v, 3))] * 3).map(np.array)


@given(triples, triples, triples, triples)
def test_distance_of_segments(a: np.ndarray, u: np.ndarray, b: np.ndarray, v: np.ndarray) -> None:
    found = segment_distance_kernel(a, u, b, v)

    def squared(s: np.ndarray) -> float:
        return float(((a + s[0] * u - b - s[1] * v) ** 2).sum())

    shares = np.linspace(0.0, 1.0, 21)
    start = min((squared(np.array([s, t])), s, t) for s in shares for t in shares)[1:]
    best = np.sqrt(minimize(squared, start, bounds=[(0.0, 1.0)] * 2, tol=1e-14).fun)
    assert found <= best + 1e-6
    assert found >= best - 1e-3


@given(triples, triples, st.floats(0.0, 0.5))
def test_distance_to_a_box(start: np.ndarray, span: np.ndarray, first: float) -> None:
    half = np.array([0.5, 0.3, 0.8])
    found = segment_box_distance_kernel(start, span, first, half)
    points = start + np.linspace(first, 1.0, 5001)[:, None] * span
    sampled = np.linalg.norm(np.maximum(np.abs(points) - half, 0.0), axis=1).min()
    assert found <= sampled + 1e-12
    assert found >= sampled - np.linalg.norm(span) / 5000


def test_pairs_and_their_distances(robot: Robot) -> None:
    cables = inverse_kinematics(robot, robot.home)
    result = cable_interference(robot, robot.home)
    assert len(result.pairs) == 28
    ends = robot.home.position + cables.arms
    share = np.linspace(0.0, 1.0, 201)[:, None]
    lines = [ends[i] + share * cables.lengths[i] * cables.directions[i] for i in range(8)]
    for (i, j), distance in zip(result.pairs - 1, result.pair_distances, strict=True):
        sampled = np.linalg.norm(lines[i][:, None] - lines[j][None], axis=-1).min()
        assert distance <= sampled + 1e-12
        assert distance >= sampled - 0.03
    assert result.between_cables == result.pair_distances.min()
    assert result.to_platform == result.platform_distances.min() > 0.0
    assert not result.pair_distances.flags.writeable


def test_the_nearest_pair_along_a_trajectory(robot: Robot) -> None:
    angles = np.linspace(0.0, 1.2, 40)
    pose = Pose.from_euler(np.tile(robot.home.position, (40, 1)), angles, 0.0 * angles, 0.0 * angles)
    result = cable_interference(robot, pose)
    assert result.pair_distances.shape == (40, 28)
    assert result.platform_distances.shape == (40, 8)
    nearest = result.nearest
    everything = np.concatenate((result.pair_distances, result.platform_distances), axis=1)
    assert nearest.distance == everything.min()
    assert everything[nearest.index].min() == nearest.distance
    alone = cable_interference(
        robot, Pose(pose.position[nearest.index], pose.rotation[nearest.index])
    ).nearest
    assert (alone.first, alone.second, alone.index) == (nearest.first, nearest.second, ())
    # Turned far enough the cables cross the platform.
    assert result.to_platform[0] > 0.0
    assert result.to_platform[-1] == 0.0


def test_cables_that_meet_by_design_are_no_pair(robot: Robot) -> None:
    anchors = robot.anchor_points.copy()
    anchors[1] = anchors[0]
    shared = robot.with_geometry(anchor_points=anchors)
    assert [1, 2] not in cable_interference(shared, shared.home).pairs.tolist()
    assert len(cable_interference(shared, shared.home).pairs) == 27


def test_the_base_frame_does_not_matter(robot: Robot) -> None:
    pose = Pose.from_euler([0.2, 0.1, 1.2], 0.3, 0.1, -0.1)
    turn = Pose.from_euler([1.0, -2.0, 0.5], 0.7, 0.2, 0.4)
    moved = robot.with_geometry(
        exit_points=robot.exit_points @ turn.rotation.T + turn.position,
    )
    there = Pose(turn.rotation @ pose.position + turn.position, turn.rotation @ pose.rotation)
    before, after = cable_interference(robot, pose), cable_interference(moved, there)
    np.testing.assert_allclose(after.pair_distances, before.pair_distances, atol=1e-9)
    np.testing.assert_allclose(after.platform_distances, before.platform_distances, atol=1e-9)


def test_cables_end_where_they_leave_their_pulleys(robot: Robot) -> None:
    """Of two cables side by side, both over a pulley, the upper ends come nearest to each other."""
    over = robot.with_geometry(pulleys=Pulleys(0.05))
    cables = inverse_kinematics(over, robot.home)
    ends = cables.tangent_points
    result = cable_interference(over, robot.home)
    distance = float(result.pair_distances[(result.pairs == [1, 2]).all(axis=1)][0])
    assert distance == pytest.approx(np.linalg.norm(ends[0] - ends[1]), rel=0.2)
    assert distance != pytest.approx(cable_interference(robot, robot.home).pair_distances[0], abs=1e-4)


def test_a_box_of_ones_own(cogiro: Robot) -> None:
    """The published platform spans its anchor points; a smaller box inside it is missed."""
    inner = cable_interference(cogiro, cogiro.home, box_size=[0.2, 0.2, 0.2], box_center=[0.0, 0.0, 0.5])
    assert inner.to_platform > 0.2


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"box_size": [0.1, 0.0, 0.1]}, "box_size"),
        ({"box_size": np.ones((2, 3))}, "box_size"),
        ({"box_center": [np.nan, 0.0, 0.0]}, "box_center"),
        ({"anchor_zone": -0.1}, "anchor_zone"),
    ],
)
def test_input_is_checked(robot: Robot, options: dict[str, object], name: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        cable_interference(robot, robot.home, **options)
    assert caught.value.name == name
    with pytest.raises(InvalidInputError, match="no pose"):
        _ = cable_interference(robot, Pose(np.zeros((0, 3)), np.eye(3))).nearest
