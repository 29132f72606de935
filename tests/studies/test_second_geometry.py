"""The second geometry: that it is what the search finds, and does all that the paper says of its simulations."""

import numpy as np
import pytest
from studies.geometries import SHIPPED
from studies.geometry_search import (
    CABLES_APART,
    CABLES_FROM_PLATFORM,
    HEIGHTS,
    LEAST_TENSION,
    assignments,
    search,
)
from studies.simulation_statements import simulation_statements

from cspr_kinematics import Pose, inverse_kinematics


def test_every_statement_about_the_simulations_holds(tension_results):
    statements = simulation_statements(tension_results["second"])
    assert [one.claim for one in statements if not one.agrees] == []


def test_the_shipped_geometry_does_what_does_not_depend_on_it(tension_results):
    statements = simulation_statements(tension_results["shipped"])
    failed = [one.claim for one in statements if one.agrees is False]
    assert all("2, 3, 6 and 7" in claim or "these cables" in claim for claim in failed)
    assert len(failed) == 2


def test_the_cables_that_stand_out_do_so_by_a_formula_of_its_own(second, tension_results):
    """By the share of a force along x that falls to each cable of the level platform at the trajectories' centre."""
    pose = Pose(second.robot.trajectory_center, np.eye(3))
    wrench_matrix = inverse_kinematics(second.robot, pose).wrench_matrix
    share = np.abs(np.linalg.lstsq(wrench_matrix, np.eye(6)[0], rcond=None)[0])
    assert sorted(np.argsort(share)[4:] + 1) == [2, 3, 6, 7]
    assert share[[1, 2, 5, 6]].min() > 2.0 * share[[0, 3, 4, 7]].max()


def test_it_holds_the_paper_s_loads_without_touching_cables(second, tension_results):
    suitability = tension_results["second"].suitability
    assert suitability.least_tension >= LEAST_TENSION > second.robot.tension_min.max()
    assert suitability.largest_tension <= second.robot.tension_max.min()
    assert suitability.between_cables >= CABLES_APART
    assert suitability.to_platform >= CABLES_FROM_PLATFORM


def test_its_workspace_is_what_the_file_says(second):
    robot = second.robot
    axes = [np.linspace(*ends, 9) for ends in zip(robot.workspace_min, robot.workspace_max, strict=True)]
    points = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3)
    level = Pose(points, np.broadcast_to(np.eye(3), (len(points), 3, 3)))
    weight = np.linalg.pinv(inverse_kinematics(robot, level).wrench_matrix)[..., 2] * 9.81
    assert 153.0 * weight.min() >= robot.tension_min.max()
    assert 353.0 * weight.max() <= robot.tension_max.min()


def test_only_the_geometry_differs(second):
    robot, shipped = second.robot, SHIPPED.robot
    np.testing.assert_array_equal(robot.exit_points[:, :2], shipped.exit_points[:, :2])
    assert robot.platform.mass == shipped.platform.mass
    assert robot.motor == shipped.motor
    for points in (robot.exit_points, robot.anchor_points):
        np.testing.assert_allclose(points[4:], points[:4] * [-1.0, -1.0, 1.0])  # half a turn


def test_it_is_the_best_that_the_search_finds_at_its_heights(second):
    anchors = assignments()
    assert len(anchors) == len(np.unique(anchors, axis=0)) == 384
    robot = second.robot
    best = min(search([robot.exit_points[:4, 2].tolist()], anchors), key=lambda one: one.preference)
    np.testing.assert_array_equal(best.exit_points, robot.exit_points)
    np.testing.assert_array_equal(best.anchor_points, robot.anchor_points)
    assert best.ratio > 3.0


@pytest.mark.parametrize("lowered", [None, 0, 1, 2, 3])
def test_other_exit_points_at_the_height_of_the_shipped_ones_are_not_better(second, lowered):
    anchors, robot = assignments(), second.robot
    (chosen,) = search([robot.exit_points[:4, 2].tolist()], robot.anchor_points[None])
    heights = [HEIGHTS[2] if k == lowered else HEIGHTS[0] for k in range(4)]
    others = list(search([heights], anchors))
    assert all(chosen.preference <= one.preference for one in others)
    if lowered is None:
        assert others == []
