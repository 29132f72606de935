import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cspr_control.errors import TrajectoryError
from cspr_control.reference import catalogue
from cspr_control.reference.catalogue import INWARD_SPEED, make_trajectory
from cspr_control.reference.motion_check import require_possible
from cspr_control.reference.paper import TILT, paper_18, paper_19, paper_19_tilt
from cspr_control.reference.path_time import rest_to_rest, slowing_to_rest
from cspr_control.reference.point_to_point import PointToPoint
from cspr_control.reference.quintic import PEAK_ACCELERATION, PEAK_SPEED, quintic, quintic_integral
from cspr_control.reference.smooth import SmoothTrajectory
from cspr_control.reference.strokes import STROKES
from cspr_kinematics import KinematicsError, Pose
from cspr_msgs_py.vocabulary import TrajectoryName

CENTER = np.array([0.0, 0.0, 1.0])
STEP = 1e-4
MILLIMETRE = 1e-3
SWITCHES = {"paper-18": 10.0, "paper-19": 5.0, "paper-19-tilt": 5.0}
"""Where the velocity jumps, s."""


def rotation_vector(after, before):
    return Rotation.from_matrix(after @ before.T).as_rotvec()


def assert_derivatives(trajectory, time):
    before, now, after = (trajectory.sample(time + dt) for dt in (-STEP, 0.0, STEP))
    span = 2.0 * STEP
    linear = (after.pose.position - before.pose.position) / span
    angular = rotation_vector(after.pose.rotation, before.pose.rotation) / span
    np.testing.assert_allclose(now.twist.linear, linear, atol=1e-7)
    np.testing.assert_allclose(now.twist.angular, angular, atol=1e-7)
    linear = (after.twist.linear - before.twist.linear) / span
    angular = (after.twist.angular - before.twist.angular) / span
    np.testing.assert_allclose(now.acceleration.linear, linear, atol=1e-6)
    np.testing.assert_allclose(now.acceleration.angular, angular, atol=1e-6)


def test_a_name_that_nothing_makes_is_refused_in_words(robot, settings, monkeypatch):
    monkeypatch.delitem(catalogue._PRINTED, TrajectoryName.PAPER_18)
    with pytest.raises(TrajectoryError, match=r"paper-18 is not in cspr_control\.reference\.catalogue"):
        make_trajectory(TrajectoryName.PAPER_18, robot, robot.home, settings)


@pytest.mark.parametrize("name", list(TrajectoryName), ids=lambda name: name.value)
def test_velocity_and_acceleration_are_derivatives(name, robot, settings):
    trajectory = make_trajectory(name, robot, robot.home, settings)
    joins = [SWITCHES[trajectory.name]] if trajectory.name in SWITCHES else []
    if name is TrajectoryName.STROKES_Z:
        # where the acceleration turns about at zero, so that a difference across it is no derivative
        joins = np.linspace(0.0, trajectory.duration, STROKES + 1)
    for time in np.linspace(2 * STEP, trajectory.duration - 2 * STEP, 41):
        if all(abs(time - join) > 2 * STEP for join in joins):
            assert_derivatives(trajectory, time)


def test_strokes_join_without_a_step_in_acceleration(robot, settings):
    strokes = make_trajectory(TrajectoryName.STROKES_Z, robot, robot.home, settings)
    for join in np.linspace(0.0, strokes.duration, STROKES + 1):
        before, after = strokes.sample(join - 1e-7), strokes.sample(join + 1e-7)
        np.testing.assert_allclose(before.acceleration.linear, after.acceleration.linear, atol=1e-5)
        np.testing.assert_allclose(before.twist.linear, after.twist.linear, atol=1e-9)
        np.testing.assert_allclose(before.pose.position, after.pose.position, atol=1e-9)


def test_strokes_go_up_and_down_at_three_metres_a_second_squared(robot, settings):
    strokes = make_trajectory(TrajectoryName.STROKES_Z, robot, robot.home, settings)
    motions = [strokes.sample(time) for time in np.linspace(0.0, strokes.duration, 5000)]
    heights = np.array([motion.pose.position[2] for motion in motions])
    accelerations = np.array([motion.acceleration.linear[2] for motion in motions])
    assert (heights.min(), heights.max()) == pytest.approx((0.85, 1.15), abs=1e-5)
    assert np.abs(accelerations).max() == pytest.approx(3.0, abs=1e-3)
    assert int((np.diff(np.sign(heights - 1.0)) != 0).sum()) == 12
    assert strokes.duration == pytest.approx(9.1, abs=0.05)


@pytest.mark.parametrize(
    ("make", "times", "positions", "velocities"),
    [
        (
            paper_18,
            (0.0, 5.0, 10.0, 20.0),
            ((500, 300, 0), (0, 0, 100), (500, -300, 200), (400, -100, 100)),
            ((-200, -60, 20), (0, -60, 20), (200, -60, 20), (-10, 20, -10)),
        ),
        (
            paper_19,
            (0.0, 2.5, 5.0, 10.0),
            ((500, 300, 0), (0, 0, 100), (500, -300, 200), (400, -100, 100)),
            ((-400, -120, 40), (0, -120, 40), (400, -120, 40), (-20, 40, -20)),
        ),
    ],
)
def test_values_of_the_paper(make, times, positions, velocities):
    trajectory = make(CENTER)
    assert trajectory.duration == times[-1]
    for time, position, velocity in zip(times, positions, velocities, strict=True):
        point = trajectory.sample(time)
        np.testing.assert_allclose(
            point.pose.position, CENTER + np.multiply(position, MILLIMETRE), atol=1e-12
        )
        np.testing.assert_allclose(point.twist.linear, np.multiply(velocity, MILLIMETRE), atol=1e-12)


@pytest.mark.parametrize(("make", "switch", "acceleration"), [(paper_18, 10.0, 0.04), (paper_19, 5.0, 0.16)])
def test_velocity_jumps_at_the_switch_and_position_does_not(make, switch, acceleration):
    trajectory = make(CENTER)
    before, after = trajectory.sample(switch), trajectory.sample(switch + 1e-9)
    np.testing.assert_allclose(before.pose.position, after.pose.position, atol=1e-8)
    assert np.linalg.norm(before.twist.linear - after.twist.linear) > 0.2
    np.testing.assert_allclose(before.acceleration.linear, [acceleration, 0.0, 0.0])
    np.testing.assert_array_equal(after.acceleration.linear, np.zeros(3))


def test_tilt_is_five_degrees_about_x_and_y_at_the_switch():
    trajectory = paper_19_tilt(CENTER)
    assert math.radians(5.0) == TILT
    np.testing.assert_allclose(trajectory.sample(5.0).pose.euler, [0.0, TILT, TILT], atol=1e-12)
    for time in (0.0, 5.0, 10.0):
        np.testing.assert_allclose(trajectory.sample(time).twist.angular, 0.0, atol=1e-12)
        np.testing.assert_allclose(trajectory.sample(time).acceleration.angular, 0.0, atol=1e-12)
    np.testing.assert_allclose(trajectory.sample(10.0).pose.rotation, np.eye(3), atol=1e-12)
    level = paper_19(CENTER)
    np.testing.assert_array_equal(level.sample(3.3).pose.position, trajectory.sample(3.3).pose.position)


@pytest.mark.parametrize("make", [paper_18, paper_19, paper_19_tilt])
def test_smooth_trajectory_follows_the_path_from_rest_to_rest(make):
    path = make(CENTER)
    smooth = SmoothTrajectory(path, blend_time=0.8)
    assert smooth.duration == pytest.approx(path.duration + 1.6)
    for time in (0.0, smooth.switch_time, smooth.duration):
        point = smooth.sample(time)
        for vector in (
            point.twist.linear,
            point.twist.angular,
            point.acceleration.linear,
            point.acceleration.angular,
        ):
            np.testing.assert_allclose(vector, 0.0, atol=1e-12)
    for time in (0.0, path.duration):
        np.testing.assert_allclose(
            smooth.sample(time * smooth.duration / path.duration).pose.position,
            path.sample(time).pose.position,
            atol=1e-12,
        )
    # Away from the blends the path is followed at its own pace, half a blend time late.
    np.testing.assert_allclose(smooth.sample(3.4).pose.position, path.sample(3.0).pose.position, atol=1e-12)
    np.testing.assert_allclose(smooth.sample(3.4).twist.linear, path.sample(3.0).twist.linear, atol=1e-12)


@pytest.mark.parametrize("make", [paper_18, paper_19_tilt])
def test_smooth_trajectory_has_no_jumps(make):
    smooth = SmoothTrajectory(make(CENTER), blend_time=1.0)
    times = np.arange(0.0, smooth.duration, 5e-3)
    points = [smooth.sample(time) for time in times]
    for values, largest in (
        ([p.twist.linear for p in points], 6e-3),
        ([p.acceleration.linear for p in points], 2e-2),
        ([p.acceleration.angular for p in points], 2e-2),
    ):
        assert np.abs(np.diff(values, axis=0)).max() < largest


@pytest.mark.parametrize("blend_time", [0.0, -1.0, 5.1, math.nan])
def test_blend_time_must_fit(blend_time):
    with pytest.raises(TrajectoryError, match="blend time"):
        SmoothTrajectory(paper_19(CENTER), blend_time)


def test_point_to_point_keeps_its_limits_and_reaches_its_goal(limits, settings, robot):
    move = PointToPoint(robot.home, settings.goal, limits)
    times = np.linspace(0.0, move.duration, 501)
    points = [move.sample(time) for time in times]
    reached = [
        (limits.speed, max(np.linalg.norm(p.twist.linear) for p in points)),
        (limits.acceleration, max(np.linalg.norm(p.acceleration.linear) for p in points)),
        (limits.angular_speed, max(np.linalg.norm(p.twist.angular) for p in points)),
        (limits.angular_acceleration, max(np.linalg.norm(p.acceleration.angular) for p in points)),
    ]
    ratios = [value / limit for limit, value in reached]
    assert max(ratios) == pytest.approx(1.0, abs=1e-3)
    np.testing.assert_array_equal(points[0].pose.position, robot.home.position)
    np.testing.assert_array_equal(points[-1].pose.position, settings.goal.position)
    np.testing.assert_allclose(points[-1].pose.rotation, settings.goal.rotation)
    np.testing.assert_allclose(
        move.sample(move.duration - 1e-9).pose.rotation, settings.goal.rotation, atol=1e-8
    )


def test_point_to_point_without_distance_takes_no_time(robot, limits):
    move = PointToPoint(robot.home, robot.home, limits)
    assert move.duration == 0.0
    np.testing.assert_array_equal(move.sample(-1.0).pose.position, robot.home.position)


def test_times_outside_the_trajectory_count_as_its_ends(robot, settings):
    for name in TrajectoryName:
        trajectory = make_trajectory(name, robot, robot.home, settings)
        for outside, inside in ((-1.0, 0.0), (trajectory.duration + 1.0, trajectory.duration)):
            np.testing.assert_array_equal(
                trajectory.sample(outside).pose.position, trajectory.sample(inside).pose.position
            )


OUT = np.array([0.0, 0.1, 0.0])  # m beyond the workspace


def move(robot, settings, start, goal):
    """Make a move between two positions, level."""
    chosen = replace(settings, goal=Pose(goal, np.eye(3)))
    return make_trajectory(TrajectoryName.MOVE, robot, Pose(start, np.eye(3)), chosen)


def test_a_move_from_outside_leads_back_slowly(robot, settings):
    start = robot.home.position * (1, 0, 1) + robot.workspace_max * (0, 1, 0) + OUT
    for goal in (robot.home.position, start - 0.5 * OUT):
        trajectory = move(robot, settings, start, goal)
        times = np.linspace(0.0, trajectory.duration, 200)
        speeds = [np.linalg.norm(trajectory.sample(time).twist.linear) for time in times]
        assert 0.0 < max(speeds) <= INWARD_SPEED


def test_a_move_from_outside_goes_no_further_out(robot, settings):
    start = robot.home.position * (1, 0, 1) + robot.workspace_max * (0, 1, 0) + OUT
    aside = robot.home.position * (0, 1, 1) + robot.workspace_max * (1, 0, 0) + (0.1, 0.0, 0.0)
    for goal in (start + OUT, aside, robot.home.position * np.nan):
        with pytest.raises((TrajectoryError, KinematicsError)):
            move(robot, settings, start, goal)


def test_a_trajectory_outside_the_workspace_is_refused(robot, limits):
    goal = Pose(robot.workspace_max + 0.1, np.eye(3))
    with pytest.raises(TrajectoryError, match="100 mm outside"):
        require_possible(PointToPoint(robot.home, goal, limits), robot)


def test_quintic_and_its_integral():
    x = np.linspace(0.0, 1.0, 2001)
    values = np.array([quintic(v) for v in x])
    assert values[:, 1].max() == pytest.approx(PEAK_SPEED)
    assert np.abs(values[:, 2]).max() == pytest.approx(PEAK_ACCELERATION, rel=1e-5)
    integral = np.array([quintic_integral(v) for v in x])
    np.testing.assert_allclose(np.gradient(integral, x)[1:-1], values[1:-1, 0], atol=1e-5)
    assert integral[-1] == pytest.approx(0.5)
    np.testing.assert_array_equal(quintic(1.5), (1.0, 0.0, 0.0))
    np.testing.assert_array_equal(quintic(-0.5), (0.0, 0.0, 0.0))


@pytest.mark.parametrize("law", [lambda t: rest_to_rest(t, 4.0, 0.7), lambda t: slowing_to_rest(t, 2.0, 0.7)])
def test_path_time_derivatives(law):
    for time in np.linspace(0.01, 4.69, 43):
        before, now, after = law(time - 1e-5), law(time), law(time + 1e-5)
        assert now.rate == pytest.approx((after.value - before.value) / 2e-5, abs=1e-8)
        assert now.acceleration == pytest.approx((after.rate - before.rate) / 2e-5, abs=1e-7)


def test_slowing_to_rest_begins_at_full_pace():
    assert slowing_to_rest(0.0, 2.0, 0.6).rate == 1.0
    end = slowing_to_rest(0.6, 2.0, 0.6)
    assert (end.value, end.rate, end.acceleration) == pytest.approx((2.3, 0.0, 0.0))
