import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspr_control.errors import TrajectoryError
from cspr_control.reference.paper import paper_19, paper_19_tilt
from cspr_control.reference.player import SECOND, TrajectoryPlayer
from cspr_control.reference.point_to_point import PointToPoint
from cspr_control.reference.smooth import SmoothTrajectory
from cspr_control.reference.trajectory import Hold
from cspr_kinematics import Pose
from cspr_msgs_py.parameters.table import defaults
from cspr_msgs_py.vocabulary import TrajectoryPhase

CYCLE = 4_000_000  # ns
BEGIN = 1_700_000_000 * SECOND + 123
TIMES = {name: defaults("trajectory_publisher")[name] for name in ("dwell", "stop_time", "max_gap")}


@pytest.fixture
def player(robot, limits):
    player = TrajectoryPlayer(limits, dwell=0.5, stop_time=0.4, max_gap=math.inf)
    player.hold(robot.home)
    player.sample(BEGIN)
    return player


def run(player, begin, end):
    times = range(begin, end, CYCLE)
    return [player.sample(time) for time in times], times[-1] if times else begin


def positions(points):
    return np.array([point.pose.position for point in points])


def test_idle_without_a_pose(limits, robot):
    player = TrajectoryPlayer(limits, **TIMES)
    assert player.phase is TrajectoryPhase.IDLE
    assert player.sample(BEGIN) is None
    with pytest.raises(TrajectoryError, match="no pose"):
        player.start(Hold(robot.home, 1.0))


def test_whole_run_has_no_jump_of_position(player, robot):
    trajectory = paper_19_tilt(robot.trajectory_center)
    player.start(trajectory)
    assert player.phase is TrajectoryPhase.APPROACH
    assert player.trajectory_name == "paper-19-tilt"
    assert player.end_time - player.start_time == 10 * SECOND
    phases = []
    points = []
    for time in range(BEGIN, player.end_time + SECOND, CYCLE):
        points.append(player.sample(time))
        if not phases or phases[-1] is not player.phase:
            phases.append(player.phase)
            if player.phase is TrajectoryPhase.RUNNING:
                assert 0 <= time - player.start_time < CYCLE
    assert phases == [TrajectoryPhase.APPROACH, TrajectoryPhase.RUNNING, TrajectoryPhase.FINISHED]
    path = positions(points)
    np.testing.assert_array_equal(path[0], robot.home.position)
    assert np.abs(np.diff(path, axis=0)).max() <= 0.401 * CYCLE / SECOND
    np.testing.assert_array_equal(path[-1], trajectory.sample(10.0).pose.position)
    np.testing.assert_array_equal(points[-1].twist.linear, np.zeros(3))


def test_approach_starts_and_ends_at_rest_and_dwells(player, robot):
    trajectory = paper_19(robot.trajectory_center)
    player.start(trajectory)
    points, _ = run(player, BEGIN, player.start_time)
    speeds = np.linalg.norm([p.twist.linear for p in points], axis=1)
    accelerations = np.array([p.acceleration.linear for p in points])
    assert speeds[0] == 0.0
    assert np.abs(np.diff(accelerations, axis=0)).max() < 0.02
    dwelling = int(0.5 * SECOND / CYCLE) - 1
    np.testing.assert_array_equal(speeds[-dwelling:], 0.0)
    np.testing.assert_array_equal(points[-1].pose.position, trajectory.sample(0.0).pose.position)


def test_reference_runs_on_the_stamps_of_the_start(player, robot):
    trajectory = paper_19(robot.trajectory_center)
    player.start(trajectory)
    time = player.start_time + 3 * SECOND
    player.sample(player.start_time)
    np.testing.assert_allclose(
        player.sample(time).pose.position, trajectory.sample(3.0).pose.position, atol=1e-12
    )


def test_a_start_on_the_way_is_refused(player, robot):
    player.start(paper_19(robot.trajectory_center))
    with pytest.raises(TrajectoryError, match="under way"):
        player.start(Hold(robot.home, 1.0))


@pytest.mark.parametrize("moment", [0.5, 1.7, 2.49, 4.9, 9.9])
@pytest.mark.parametrize("smooth", [False, True])
def test_stop_slows_down_along_the_path(player, robot, moment, smooth):
    trajectory = paper_19_tilt(robot.trajectory_center)
    if smooth:
        trajectory = SmoothTrajectory(trajectory, 0.5)
    player.start(trajectory)
    stop_at = player.start_time + round(moment * SECOND)
    before, last = run(player, player.start_time, stop_at)
    player.stop()
    assert player.phase is TrajectoryPhase.STOPPING
    after, _ = run(player, last + CYCLE, last + SECOND)
    assert player.phase is TrajectoryPhase.HOLD
    path = positions(before[-2:] + after)
    assert np.abs(np.diff(path, axis=0)).max() <= 0.42 * CYCLE / SECOND
    reached = trajectory.sample(min((last - player.start_time) / SECOND + 0.2, trajectory.duration))
    np.testing.assert_allclose(after[-1].pose.position, reached.pose.position, atol=1e-9)
    np.testing.assert_array_equal(after[-1].twist.linear, np.zeros(3))
    if moment == 1.7:  # away from corners and ends the velocity is continuous as well
        speeds = np.array([p.twist.linear for p in before[-2:] + after])
        assert np.abs(np.diff(speeds, axis=0)).max() < 0.02


FINE = SECOND // 2000
"""Step of differences, ns."""


def assert_derivatives(player, moment):
    """The twist is what the pose changes by, the acceleration what the twist changes by, both without a jump."""
    before, now, after = (player.sample(moment + step) for step in (-FINE, 0, FINE))
    span = 2.0 * FINE / SECOND
    turn = Rotation.from_matrix(after.pose.rotation @ before.pose.rotation.T).as_rotvec() / span
    move = (after.pose.position - before.pose.position) / span
    np.testing.assert_allclose(now.twist.vector, np.hstack((move, turn)), atol=1e-5)
    # half a step of the largest jump of the third derivative, where one quintic follows another
    change = (after.twist.vector - before.twist.vector) / span
    np.testing.assert_allclose(now.acceleration.vector, change, atol=4e-3)
    np.testing.assert_allclose(now.acceleration.vector, before.acceleration.vector, atol=2e-2)


@given(
    st.sampled_from(["move", "smooth-19-tilt"]),
    st.floats(0.01, 1.0),
    st.floats(0.3, 1.0),
    st.integers(0, 2**32 - 1),
)
def test_derivatives_agree_in_every_phase(robot, limits, kind, share, stop_time, seed):
    """Approaching, resting, running, and coming to rest from any of them at any moment, or not at all."""
    rng = np.random.default_rng(seed)
    center, tilt = robot.trajectory_center, rng.uniform(-0.2, 0.2, (2, 3))
    first, last = (Pose.from_euler(center + rng.uniform(-0.3, 0.3, 3), *angles) for angles in tilt)
    trajectory = PointToPoint(first, last, limits)
    if kind != "move":
        trajectory = SmoothTrajectory(paper_19_tilt(center), rng.uniform(0.5, 2.0))
    player = TrajectoryPlayer(limits, dwell=0.1, stop_time=stop_time, max_gap=math.inf)
    player.hold(robot.home)
    player.sample(BEGIN)
    player.start(trajectory)
    stop = BEGIN + round(share * 1.05 * (player.end_time - BEGIN))
    for moment in (BEGIN + FINE, player.start_time, player.end_time, stop - 2 * FINE):
        if BEGIN < moment <= stop - 2 * FINE:
            assert_derivatives(player, moment)
    player.stop()  # at the newest sample, one step before
    for part in np.linspace(0.0, 1.0, 12):
        assert_derivatives(player, stop + round(part * stop_time * SECOND) - (part == 1.0) * FINE)
    assert player.phase.at_rest
    np.testing.assert_array_equal(player.sample(stop + SECOND).acceleration.vector, np.zeros(6))


def test_stop_during_approach_and_dwell(player, robot):
    player.start(paper_19(robot.trajectory_center))
    _, last = run(player, BEGIN, BEGIN + SECOND)
    player.stop()
    points, last = run(player, last + CYCLE, last + SECOND)
    assert player.phase is TrajectoryPhase.HOLD
    assert np.abs(np.diff(positions(points), axis=0)).max() < 0.2 * CYCLE / SECOND
    player.start(paper_19(robot.trajectory_center))
    player.sample(player.start_time - CYCLE)
    player.stop()
    held = player.sample(player.start_time)
    assert player.phase is TrajectoryPhase.HOLD
    np.testing.assert_allclose(held.pose.position, [0.5, 0.3, 1.0])


def test_stop_at_rest_changes_nothing(player):
    player.stop()
    assert player.phase is TrajectoryPhase.HOLD


def test_time_that_goes_back_does_not_move_the_reference_back(player, robot):
    player.start(paper_19(robot.trajectory_center))
    player.sample(player.start_time)
    later = player.sample(player.start_time + SECOND)
    again = player.sample(player.start_time + SECOND // 2)
    np.testing.assert_array_equal(later.pose.position, again.pose.position)


@pytest.mark.parametrize(
    ("gap", "interruption"),
    [(SECOND, "no motor states came for 1.000 s"), (-SECOND, "the clock went back by 1.000 s")],
)
def test_motion_ends_where_it_was_when_time_jumps(robot, limits, gap, interruption):
    player = TrajectoryPlayer(limits, **{**TIMES, "dwell": 0.0})
    player.hold(robot.home)
    player.sample(BEGIN)
    player.start(paper_19(robot.trajectory_center))
    points, last = run(player, BEGIN, BEGIN + 2 * SECOND)
    assert player.interruption == ""
    after = player.sample(last + gap)
    assert player.phase is TrajectoryPhase.HOLD
    assert interruption in player.interruption
    np.testing.assert_array_equal(after.pose.position, points[-1].pose.position)
    np.testing.assert_array_equal(after.twist.linear, np.zeros(3))
    player.start(paper_19(robot.trajectory_center))
    assert 0 < player.start_time - (last + gap) < 20 * SECOND
    assert player.interruption == ""


def test_start_before_the_first_sample_is_refused(robot, limits):
    player = TrajectoryPlayer(limits, **TIMES)
    player.hold(robot.home)
    with pytest.raises(TrajectoryError, match="no pose"):
        player.start(Hold(robot.home, 1.0))


def test_a_trajectory_out_of_all_reach_is_refused(player, robot):
    player.hold(Pose(robot.home.position + np.array([1e300, 0.0, 0.0]), robot.home.rotation))
    player.sample(BEGIN)
    with np.errstate(over="ignore"), pytest.raises(TrajectoryError, match="out of reach"):
        player.start(Hold(robot.home, 1.0))
