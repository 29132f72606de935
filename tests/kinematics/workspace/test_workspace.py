"""The workspace on a grid: against single poses, its volume, its border, its files."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from cspr_kinematics import (
    InvalidInputError,
    KinematicsError,
    Pose,
    Pulleys,
    Robot,
    Task,
    Workspace,
    assess_task,
    explore_workspace,
)
from cspr_kinematics.workspace.plot import PlottingUnavailableError, plot_workspace

TASK = Task(0.0, 200.0)
LOWER, UPPER = [-2.3, -1.3, 0.2], [2.3, 1.3, 2.8]


@pytest.fixture(scope="module")
def explored(robot: Robot) -> Workspace:
    return explore_workspace(robot, TASK, lower=LOWER, upper=UPPER, spacing=0.2)


def ball(radius: float, n: int) -> Workspace:
    axis = np.linspace(-1.0, 1.0, n)
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    margin = radius - np.sqrt(x**2 + y**2 + z**2)
    return Workspace(axis, axis, axis, margin, np.zeros_like(margin), np.ones_like(margin))


def test_grid_equals_single_poses(robot: Robot, explored: Workspace) -> None:
    assert explored.margin.shape == (len(explored.x), len(explored.y), len(explored.z)) == (24, 14, 14)
    assert np.diff(explored.x).max() <= 0.2 + 1e-12
    rng = np.random.default_rng(0)
    for i, j, k in rng.integers(0, [24, 14, 14], (20, 3)):
        single = assess_task(robot, Pose([explored.x[i], explored.y[j], explored.z[k]], np.eye(3)), TASK)
        assert explored.margin[i, j, k] == single.margin
        np.testing.assert_equal(explored.payload_max[i, j, k], float(single.payload_max))
    assert 0.3 < explored.feasible.mean() < 0.9


def test_default_grid_is_the_workspace_of_the_robot(robot: Robot) -> None:
    workspace = explore_workspace(robot, spacing=0.35)
    assert workspace.feasible.all()
    assert workspace.volume == pytest.approx(float(np.prod(robot.workspace_max - robot.workspace_min)))
    assert (workspace.x[0], workspace.z[-1]) == (robot.workspace_min[0], robot.workspace_max[2])


def test_orientations_all_count(robot: Robot) -> None:
    options = {"lower": LOWER, "upper": UPPER, "spacing": 0.6}
    angles = [(0.0, 0.0, 0.0), (0.0, 0.2, 0.0)]
    both = explore_workspace(robot, TASK, orientations=angles, **options)
    level, tilted = (explore_workspace(robot, TASK, orientations=[a], **options) for a in angles)
    np.testing.assert_array_equal(both.margin, np.minimum(level.margin, tilted.margin))
    assert both.volume < level.volume


def test_progress_and_threads(robot: Robot) -> None:
    seen: list[tuple[int, int]] = []
    options = {"lower": LOWER, "upper": UPPER, "spacing": 0.25}
    two = explore_workspace(robot, TASK, threads=2, progress=lambda *done: seen.append(done), **options)
    one = explore_workspace(robot, TASK, **options)
    np.testing.assert_array_equal(one.margin, two.margin)
    assert len(seen) > 3
    assert seen == sorted(seen)
    assert seen[-1] == (two.margin.size, two.margin.size)


def test_poses_out_of_reach_are_not_feasible(robot: Robot) -> None:
    """A grid through the very pose at which cable 3 has no length."""
    there = robot.exit_points[2] - robot.anchor_points[2]
    workspace = explore_workspace(robot, TASK, lower=there - 0.2, upper=there + 0.2, spacing=0.2)
    assert workspace.margin[1, 1, 1] == -np.inf
    assert np.isnan(workspace.payload_max[1, 1, 1])
    assert np.isfinite(workspace.margin).sum() == 26
    assert workspace.volume == 0.0
    assert workspace.distance_to_boundary(there) == -np.inf


def test_pulleys_change_the_workspace(robot: Robot) -> None:
    over = robot.with_geometry(pulleys=Pulleys(0.05))
    options = {"lower": LOWER, "upper": UPPER, "spacing": 0.4}
    plain, pulleys = (explore_workspace(r, TASK, **options) for r in (robot, over))
    place = 3, 2, 4
    position = [axis[i] for axis, i in zip((plain.x, plain.y, plain.z), place, strict=True)]
    assert pulleys.margin[place] == assess_task(over, Pose(position, np.eye(3)), TASK).margin
    assert pulleys.margin[place] != plain.margin[place]
    assert pulleys.volume == pytest.approx(plain.volume, rel=0.05)


@pytest.mark.parametrize(("n", "tolerance"), [(11, 0.05), (31, 0.006)])
def test_volume_of_a_ball(n: int, tolerance: float) -> None:
    assert ball(0.7, n).volume == pytest.approx(4.0 / 3.0 * np.pi * 0.7**3, rel=tolerance)


def test_distance_to_the_border_of_a_ball() -> None:
    workspace = ball(0.7, 31)
    points = np.random.default_rng(1).uniform(-0.55, 0.55, (200, 3))
    radius = np.linalg.norm(points, axis=1)
    error = workspace.distance_to_boundary(points) - (0.7 - radius)
    assert np.abs(error).max() < 0.015
    # Inside, the faces of the grid are a border too.
    assert ball(3.0, 31).distance_to_boundary([0.9, 0.0, 0.0]) == pytest.approx(0.1)
    np.testing.assert_allclose(workspace.margin_at(points), 0.7 - radius, atol=0.02)


def test_distance_to_the_border_of_a_robot(robot: Robot, explored: Workspace) -> None:
    """From the middle of the prototype upwards, the way on which the exact margin reaches zero."""
    low, high = 0.0, 0.6
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        feasible = assess_task(robot, Pose([0.0, 0.0, 2.3 + middle], np.eye(3)), TASK).feasible
        low, high = (middle, high) if feasible else (low, middle)
    assert explored.distance_to_boundary([0.0, 0.0, 2.3]) == pytest.approx(low, abs=0.05)


def test_files(explored: Workspace, tmp_path: Path) -> None:
    explored.save(tmp_path / "workspace.npz")
    loaded = Workspace.load(tmp_path / "workspace.npz")
    for name in ("x", "y", "z", "margin", "payload_min", "payload_max"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(explored, name))
    (tmp_path / "other.npz").write_bytes(b"no arrays")
    for wrong in ("other.npz", "missing.npz"):
        with pytest.raises(InvalidInputError, match="not the file of a workspace"):
            Workspace.load(tmp_path / wrong)


def test_picture(explored: Workspace, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    plot_workspace(explored, tmp_path / "workspace.png", "prototype")
    assert (tmp_path / "workspace.png").read_bytes().startswith(b"\x89PNG")
    plot_workspace(ball(-1.0, 5), tmp_path / "empty.png")


def test_picture_without_matplotlib(
    explored: Workspace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    monkeypatch.setitem(sys.modules, "matplotlib.colors", None)
    with pytest.raises(PlottingUnavailableError, match="matplotlib") as caught:
        plot_workspace(explored, tmp_path / "workspace.png")
    assert isinstance(caught.value, KinematicsError)


@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"spacing": 0.0}, "spacing"),
        ({"spacing": np.nan}, "spacing"),
        ({"spacing": 1e-4}, "spacing"),
        ({"spacing": 1e-12}, "spacing"),
        ({"spacing": 1e-308}, "spacing"),
        ({"lower": [0.0, 0.0]}, "lower"),
        ({"lower": UPPER, "upper": LOWER}, "lower"),
        ({"upper": [np.inf, 1.0, 1.0]}, "upper"),
        ({"orientations": []}, "orientations"),
        ({"orientations": [(0.0, 0.0)]}, "orientations"),
        ({"threads": 0}, "threads"),
        ({"lever": 0.0}, "lever"),
    ],
)
def test_input_is_checked(robot: Robot, options: dict[str, object], name: str) -> None:
    with pytest.raises(InvalidInputError) as caught:
        explore_workspace(robot, TASK, **options)
    assert caught.value.name == name


def test_workspace_is_checked(explored: Workspace) -> None:
    with pytest.raises(InvalidInputError, match="outside the grid"):
        explored.margin_at([0.0, 0.0, 3.0])
    with pytest.raises(InvalidInputError, match="position"):
        explored.distance_to_boundary([0.0, np.nan, 1.0])
    axis = np.linspace(0.0, 1.0, 3)
    with pytest.raises(InvalidInputError, match="margin"):
        Workspace(axis, axis, axis, np.zeros((3, 3)), np.zeros((3, 3, 3)), np.zeros((3, 3, 3)))
    with pytest.raises(InvalidInputError, match="increasing"):
        Workspace(axis[::-1], axis, axis, *np.zeros((3, 3, 3, 3)))
