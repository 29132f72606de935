import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cspr_control.errors import PayloadError
from cspr_control.motors.feedforward import Feedforward, FeedforwardSettings, Margins, checked_payload
from cspr_control.reference.paper import paper_19, paper_19_tilt
from cspr_control.reference.smooth import SmoothTrajectory
from cspr_kinematics import (
    Acceleration,
    CableProperties,
    InvalidInputError,
    Motion,
    Payload,
    Pose,
    Robot,
    Task,
    Twist,
    assess_task,
    distribute_tensions,
    inverse_kinematics,
    required_wrench,
    static_wrench,
)
from cspr_msgs_py.vocabulary import FeedforwardModel, PayloadSource, PayloadStatus

PERIOD = 0.004
NOMINAL = {"payload_source": PayloadSource.NOMINAL}
WEIGHTLESS = {"winch_inertia": False, **NOMINAL}  # winches, as in the paper
GRAVITY = 9.81


def setpoint_of(robot, reference, time=0.0, **settings):
    return Feedforward(robot, FeedforwardSettings(**settings)).compute(time, reference)


def ropes(robot, pose):
    """Wrench (6,) that the winches exert to move the ropes, by virtual work.

    A straight rope of length l whose lower end is h below its upper one has its weight h / 2 below that, where it came
    out or goes in: the winches' work is what -mu g l h / 2 gains.
    """

    def energy(displacement):
        turn = Rotation.from_rotvec(displacement[3:]).as_matrix() @ pose.rotation
        spans = robot.exit_points - pose.position - displacement[:3] - robot.anchor_points @ turn.T
        masses = robot.cables.mass_per_metre * np.linalg.norm(spans, axis=1)
        return -0.5 * GRAVITY * masses @ spans[:, 2]

    return np.array([(energy(step) - energy(-step)) / 2e-4 for step in 1e-4 * np.eye(6)])


@pytest.fixture
def moving(robot):
    return paper_19_tilt(robot.trajectory_center).sample(1.3)


def test_angles_and_speeds_are_those_of_the_reference(robot):
    robot = dataclasses.replace(robot, cables=CableProperties())  # stretch: test_stretch.py
    trajectory = paper_19_tilt(robot.trajectory_center)
    feedforward = Feedforward(robot, FeedforwardSettings(**NOMINAL))
    before, now, after = (feedforward.compute(t, trajectory.sample(t)) for t in (1.2999, 1.3, 1.3001))
    lengths = inverse_kinematics(robot, trajectory.sample(1.3).pose).lengths
    np.testing.assert_allclose(robot.cable_lengths(now.angle), lengths, atol=1e-12)
    np.testing.assert_allclose(now.speed, (after.angle - before.angle) / 2e-4, atol=1e-3)


@pytest.mark.parametrize("model", [FeedforwardModel.STATIC, FeedforwardModel.DYNAMIC])
def test_torque_gives_the_wrench_of_the_model(robot, moving, model):
    payload = Payload(100.0, [0.02, -0.03, 0.05])
    setpoint = setpoint_of(robot, moving, model=model, nominal_payload=payload, **WEIGHTLESS)
    if model is FeedforwardModel.STATIC:
        wrench = static_wrench(robot, moving.pose, payload)
    else:
        wrench = required_wrench(robot, moving.pose, moving.twist, moving.acceleration, payload)
    tensions = robot.winch.tension(setpoint.torque)
    np.testing.assert_allclose(tensions, setpoint.tensions)
    carried = ropes(robot, moving.pose)
    assert carried[2] > 20.0
    A = inverse_kinematics(robot, moving.pose).wrench_matrix
    np.testing.assert_allclose(A @ tensions, wrench + carried, atol=1e-6)
    assert setpoint.feasible
    assert setpoint.wrench_residual < 1e-6
    as_printed = setpoint_of(
        robot, moving, model=model, rope_weight=False, nominal_payload=payload, **WEIGHTLESS
    )
    np.testing.assert_allclose(A @ as_printed.tensions, wrench, atol=1e-6)


@pytest.mark.parametrize("place", [[0.0, 0.0, 1.0], [1.2, -0.6, 1.8], [-1.2, 0.6, 0.4]])
def test_it_asks_for_the_wrench_under_which_the_simulated_machine_hangs_still(robot_file, place):
    """Where MuJoCo finds platform and payload in balance under ropes that are elastic catenaries."""
    pytest.importorskip("mujoco")
    from tests.platforms import platform_pose

    from cspr_drivers.simulation.plant.plant import Plant
    from cspr_drivers.simulation.simulation_config import SimulationConfig

    config, load = (
        SimulationConfig.from_yaml(robot_file.with_name("simulation.yaml")),
        Payload(100.0, np.zeros(3)),
    )
    true = config.robot.with_geometry(home=Pose.from_euler(place, 0.1, -0.05, 0.08))
    plant = Plant(dataclasses.replace(config, robot=true).with_payload(load))
    hanging = Motion.at_rest(platform_pose(plant))
    asked = setpoint_of(true, hanging, nominal_payload=load, **NOMINAL)
    np.testing.assert_allclose(asked.wrench_matrix @ plant.tensions(), asked.wrench, atol=0.1)
    as_printed = setpoint_of(true, hanging, rope_weight=False, nominal_payload=load, **NOMINAL)
    assert 20.0 < asked.wrench[2] - as_printed.wrench[2] < 40.0


@pytest.mark.parametrize("file", ["robot.yaml", "robot_pulleys.yaml"])
def test_winches_are_given_what_accelerates_them(robot_file, file):
    """The torque is that of winches without inertia, and J_w times what the desired speeds change by."""
    robot = dataclasses.replace(Robot.from_yaml(robot_file.with_name(file)), cables=CableProperties())
    trajectory = SmoothTrajectory(paper_19_tilt(robot.trajectory_center), blend_time=1.0)
    full, weightless = (Feedforward(robot, FeedforwardSettings(**each)) for each in (NOMINAL, WEIGHTLESS))
    largest = 0.0
    for time in np.arange(0.0, trajectory.duration + 0.5, 0.0371).tolist():
        before, after = (setpoint_of(robot, trajectory.sample(time + t), **NOMINAL) for t in (-1e-4, 1e-4))
        given, plain = (each.compute(time, trajectory.sample(time)) for each in (full, weightless))
        inertial = robot.motor.inertia * (after.speed - before.speed) / 2e-4
        np.testing.assert_allclose(given.torque - plain.torque, inertial, atol=2e-5)
        np.testing.assert_array_equal(given.tensions, plain.tensions)
        largest = max(largest, np.abs(inertial).max())
    assert largest > 0.5


@pytest.mark.parametrize("model", [FeedforwardModel.NONE, FeedforwardModel.STATIC])
def test_only_the_dynamic_model_accelerates_winches(robot, moving, model):
    torques = [setpoint_of(robot, moving, model=model, **each).torque for each in (NOMINAL, WEIGHTLESS)]
    np.testing.assert_array_equal(*torques)


def test_without_a_model_there_is_no_torque(robot, moving):
    setpoint = setpoint_of(robot, moving, model=FeedforwardModel.NONE, **NOMINAL)
    np.testing.assert_array_equal(setpoint.torque, np.zeros(8))
    assert setpoint.feasible


def test_out_of_reach_no_cable_pushes_and_it_is_flagged(robot):
    thrown = Motion(robot.home, Twist.zero(), Acceleration([0.0, 0.0, -30.0], np.zeros(3)))
    setpoint = setpoint_of(robot, thrown, **WEIGHTLESS)
    assert not setpoint.feasible
    assert setpoint.wrench_residual > 100.0
    assert (setpoint.tensions >= robot.tension_min).all()
    assert (setpoint.tensions <= robot.tension_max).all()
    assert setpoint.torque.max() < 0.0


def run(feedforward, robot, begin, count):
    """Efforts of consecutive set-points along a trajectory, and what they would be without bridging."""
    trajectory = paper_19(robot.trajectory_center)
    never_switched = Feedforward(robot, feedforward.settings)
    never_switched.set_estimate(0.0, 150.0, np.zeros(3))
    torques, plain = [], []
    for cycle in range(begin, begin + count):
        time = cycle * PERIOD
        torques.append(feedforward.compute(time, trajectory.sample(time)).torque)
        plain.append(never_switched.compute(time, trajectory.sample(time)).torque)
    return np.array(torques), np.array(plain)


@pytest.mark.parametrize(
    "change",
    [
        {"model": FeedforwardModel.NONE},
        {"model": FeedforwardModel.STATIC},
        {"winch_inertia": False},
        {"rope_weight": False},
        {"nominal_payload": Payload(200.0, np.zeros(3))},
        {"payload_source": PayloadSource.ESTIMATED},
    ],
    ids=lambda change: next(iter(change)),
)
def test_a_switch_is_bridged_at_the_stated_slew(robot, change):
    slew = 2.0
    robot = dataclasses.replace(robot, cables=CableProperties())  # the smoothed stretch remembers longer
    settings = {"switch_slew": slew, **NOMINAL}
    feedforward = Feedforward(robot, FeedforwardSettings(**settings))
    feedforward.set_estimate(0.0, 150.0, np.zeros(3))
    before, _ = run(feedforward, robot, 1, 5)
    feedforward.configure(FeedforwardSettings(**{**settings, "payload_timeout": 10.0, **change}))
    after, plain = run(feedforward, robot, 6, 300)
    steps = np.diff(np.vstack([before, after]), axis=0)
    own = np.diff(np.vstack([plain[:1], plain]), axis=0)  # by the motion itself
    excess = np.abs(steps[len(before) - 1 :]) - np.abs(own)
    assert excess.max() <= slew * PERIOD + 1e-9
    np.testing.assert_allclose(after[0], before[-1], atol=1e-12)
    np.testing.assert_allclose(after[-1], plain[-1], atol=1e-12)


@pytest.mark.parametrize("method", ["closest", "centroid", "analytic_center"])
def test_every_tension_method_gives_the_wrench(robot, moving, method):
    setpoint = setpoint_of(robot, moving, tension_method=method, **WEIGHTLESS)
    wrench = required_wrench(robot, moving.pose, moving.twist, moving.acceleration)
    wrench = wrench + ropes(robot, moving.pose)
    A = inverse_kinematics(robot, moving.pose).wrench_matrix
    np.testing.assert_allclose(A @ setpoint.tensions, wrench, atol=1e-6)
    expected = distribute_tensions(A, wrench, robot.tension_min, robot.tension_max, method).tensions
    np.testing.assert_allclose(setpoint.tensions, expected, atol=1e-6)
    np.testing.assert_allclose(robot.winch.tension(setpoint.torque), expected, atol=1e-6)


def test_a_change_of_tension_method_keeps_the_slew_and_the_wrench(robot, moving):
    """From one method to another and, halfway, to a third: no step, and the platform feels nothing of it."""
    slew = 0.02
    settings = {"switch_slew": slew, **WEIGHTLESS}
    feedforward = Feedforward(robot, FeedforwardSettings(**settings))
    changes = {50: "centroid", 120: "analytic_center", 500: "closest"}
    torques = []
    for cycle in range(1, 900):
        if cycle in changes:
            feedforward.configure(FeedforwardSettings(**settings, tension_method=changes[cycle]))
        setpoint = feedforward.compute(cycle * PERIOD, moving)
        tensions = robot.winch.tension(setpoint.torque)
        np.testing.assert_allclose(setpoint.wrench_matrix @ tensions, setpoint.wrench, atol=1e-6)
        assert setpoint.feasible
        torques.append(setpoint.torque)
    steps = np.abs(np.diff(torques, axis=0)).max(axis=1)
    assert steps.max() <= slew * PERIOD * (1.0 + 1e-9)
    assert (steps > 0.5 * slew * PERIOD).sum() > 200  # it does take a while
    for cycle, method in ((40, "closest"), (490, "analytic_center"), (890, "closest")):
        settled = setpoint_of(robot, moving, tension_method=method, **WEIGHTLESS).torque
        np.testing.assert_allclose(torques[cycle], settled, atol=1e-9)


def test_an_unknown_tension_method_is_refused_and_changes_nothing(robot, moving):
    feedforward = Feedforward(robot, FeedforwardSettings(**NOMINAL))
    before = feedforward.compute(0.0, moving).torque
    with pytest.raises(InvalidInputError, match="softest"):
        feedforward.configure(FeedforwardSettings(tension_method="softest"))
    np.testing.assert_array_equal(feedforward.compute(1.0, moving).torque, before)


def test_margins_are_those_of_the_wrenches_within_reach(robot):
    at_rest = Motion.at_rest(Pose.from_euler([0.4, -0.2, 1.3], 0.1, 0.0, -0.05))
    setpoint = setpoint_of(robot, at_rest, model=FeedforwardModel.STATIC, **NOMINAL)
    margins = Margins.of(setpoint, robot)
    assert margins.wrench == pytest.approx(float(assess_task(robot, at_rest.pose, Task()).margin))
    assert margins.tension == pytest.approx((setpoint.tensions - robot.tension_min).min())
    thrown = Motion(robot.home, Twist.zero(), Acceleration([0.0, 0.0, -30.0], np.zeros(3)))
    beyond = setpoint_of(robot, thrown, **NOMINAL)
    assert Margins.of(beyond, robot).wrench < 0.0
    # the tensions of least error are no nearer than the distance that the margin bounds from below
    assert beyond.wrench_residual >= -Margins.of(beyond, robot).wrench - 1e-6


def test_payload_status(robot, moving):
    settings = FeedforwardSettings(payload_timeout=0.5, nominal_payload=Payload(20.0, np.zeros(3)))
    feedforward = Feedforward(robot, settings)
    assert feedforward.compute(0.0, moving).payload_status is PayloadStatus.AWAITED
    assert feedforward.compute(0.1, moving).payload.mass == 20.0
    feedforward.set_estimate(0.2, 70.0, [0.01, 0.0, 0.0])
    first = feedforward.compute(0.2, moving)
    assert (first.payload_status, first.payload.mass) == (PayloadStatus.ESTIMATED, 70.0)
    held = feedforward.compute(0.8, moving)
    assert (held.payload_status, held.payload.mass) == (PayloadStatus.HELD, 70.0)


def test_the_first_estimate_and_one_after_a_gap_are_bridged(robot):
    reference = Motion.at_rest(robot.home)
    feedforward = Feedforward(robot, FeedforwardSettings(switch_slew=1.0))
    before = feedforward.compute(0.0, reference).torque
    feedforward.set_estimate(0.004, 150.0, np.zeros(3))
    np.testing.assert_allclose(feedforward.compute(0.004, reference).torque, before)
    settled = feedforward.compute(5.0, reference)
    assert settled.payload_status is PayloadStatus.HELD
    feedforward.set_estimate(5.004, 20.0, np.zeros(3))
    np.testing.assert_allclose(feedforward.compute(5.004, reference).torque, settled.torque)


@pytest.mark.parametrize(
    ("mass", "center", "complaint"),
    [
        (-1.0, [0.0, 0.0, 0.0], "negative"),
        (math.nan, [0.0, 0.0, 0.0], "finite"),
        (math.inf, [0.0, 0.0, 0.0], "finite"),
        (301.0, [0.0, 0.0, 0.0], "max_payload"),
        (1.0, [0.0, math.nan, 0.0], "center_of_mass"),
        (1.0, [0.0, 0.0], "center_of_mass"),
        (1.0, [20.0, 0.0, 0.0], "no coordinate may exceed 10 m"),
        (1.0, [0.0, -1e308, 0.0], "no coordinate may exceed 10 m"),
    ],
)
def test_a_payload_that_cannot_be_is_refused(robot, mass, center, complaint):
    with pytest.raises(PayloadError, match=complaint):
        checked_payload("nominal payload", mass, center, 300.0)
    feedforward = Feedforward(robot, FeedforwardSettings())
    feedforward.set_estimate(0.0, 40.0, np.zeros(3))
    with pytest.raises(PayloadError, match="estimated payload"):
        feedforward.set_estimate(0.1, mass, center)
    assert feedforward.payload_in_use(0.1)[0].mass == 40.0


def test_pose_that_is_not_level_keeps_the_weight_and_half_of_each_rope(robot):
    pose = Pose.from_euler(robot.home.position, 0.1, 0.05, -0.05)
    setpoint = setpoint_of(robot, Motion.at_rest(pose), **NOMINAL)
    force = inverse_kinematics(robot, pose).wrench_matrix @ setpoint.tensions
    assert force[2] == pytest.approx(153.0 * GRAVITY + ropes(robot, pose)[2])
