"""The platform's pose from motor angles and cable tensions of one SYNC."""

import dataclasses

import numpy as np
import pytest

from cspr_control.components.pose import PoseComponent
from cspr_kinematics import CableProperties, Payload, Pose, Pulleys, cable_lengths, holding_tensions
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.joint_state import JointStateSample

CYCLE = 4_000_000  # ns
NONE = np.empty(0)


@pytest.fixture
def estimator(robot):
    return PoseComponent(robot, rate=50.0, period=0.004)


@pytest.fixture
def loaded(robot):
    """A pose with 200 kg: motor angles and tensions."""
    pose = Pose.from_euler(np.add(robot.home.position, [0.2, -0.1, 0.3]), 0.05, 0.02, -0.03)
    tensions = holding_tensions(robot, pose, Payload(200.0, np.zeros(3))).tensions
    return pose, robot.motor_angles(cable_lengths(robot, pose), tensions), tensions


def states(cycle, angles):
    return JointStateSample((100 + cycle) * CYCLE, angles, np.zeros(8), np.zeros(8))


def cells(cycle, tensions):
    return JointStateSample((100 + cycle) * CYCLE, NONE, NONE, tensions)


def published(outputs):
    return [output.sample for output in outputs]


@pytest.mark.parametrize("tensions_first", [True, False])
def test_a_pose_has_the_stretch_of_its_own_tensions(estimator, loaded, tensions_first):
    pose, angles, tensions = loaded
    poses = []
    for cycle in range(1, 12):
        messages = [(estimator.on_motor_states, states(cycle, angles))]
        messages.insert(0 if tensions_first else 1, (estimator.on_cable_tensions, cells(cycle, tensions)))
        for handle, sample in messages:
            poses += published(handle(0.0, sample))
    stamps = [sample.stamp_ns // CYCLE - 100 for sample in poses]
    # only the first could not know that tensions would come
    assert stamps == [1, 6, 11]
    for sample in poses[1:]:
        np.testing.assert_allclose(sample.position, pose.position, atol=1e-7)
        np.testing.assert_allclose(sample.quaternion_xyzw, pose.quaternion, atol=1e-7)
    assert float(estimator.status(0.0).values["length_misfit"]) < 1e-6


def test_a_pose_without_its_tensions_comes_with_the_next_state_and_the_last_stretch(estimator, loaded):
    pose, angles, tensions = loaded
    estimator.on_cable_tensions(0.0, cells(1, tensions))
    assert published(estimator.on_motor_states(0.0, states(1, angles)))
    for cycle in range(2, 6):
        assert estimator.on_motor_states(0.0, states(cycle, angles)) == ()
    assert estimator.on_motor_states(0.0, states(6, angles)) == ()  # due, and its tensions are late
    (late,) = published(estimator.on_motor_states(0.0, states(7, angles)))
    assert late.stamp_ns == 106 * CYCLE
    np.testing.assert_allclose(late.position, pose.position, atol=1e-7)
    status = estimator.status(0.0)
    assert status.level is Level.WARN
    assert "measured last" in status.message
    assert status.values["poses_without_tensions"] == "1"


def test_where_no_tensions_come_the_stretch_is_that_of_the_home_pose_at_once(estimator, robot, loaded):
    pose, angles, _ = loaded
    (sample,) = published(estimator.on_motor_states(0.0, states(1, angles)))
    by_hand = Pose(sample.position, pose.rotation)
    below = pose.position[2] - sample.position[2]
    assert -5e-3 < below < -2e-3  # the sag of 200 kg does not show
    assert by_hand.position[0] == pytest.approx(pose.position[0], abs=1e-3)
    status = estimator.status(0.0)
    assert status.level is Level.WARN
    assert "home pose" in status.message


def test_cables_that_do_not_stretch_need_no_tensions(robot):
    stiff = dataclasses.replace(robot, cables=CableProperties())
    estimator = PoseComponent(stiff, rate=250.0, period=0.004)
    for step in range(20):
        pose = Pose.from_euler(
            np.add(robot.home.position, [0.02 * step, -0.01 * step, 0.0]), 0.01 * step, 0.0, 0.02
        )
        angles = stiff.motor_angles(cable_lengths(stiff, pose))
        estimator.on_cable_tensions(0.0, cells(step, np.full(8, 2000.0)))
        (sample,) = published(estimator.on_motor_states(0.0, states(step, angles)))
        np.testing.assert_allclose(sample.position, pose.position, atol=1e-7)
    assert estimator.status(0.0).level is Level.OK


def test_a_slack_cable_and_a_misfit_are_said(estimator, loaded):
    _, angles, tensions = loaded
    slack = tensions * (np.arange(8) != 4) - 3.0 * (np.arange(8) == 4)
    estimator.on_cable_tensions(0.0, cells(1, slack))
    (_,) = published(estimator.on_motor_states(0.0, states(1, angles)))
    status = estimator.status(0.0)
    assert status.level is Level.WARN
    assert "cable_5" in status.message
    assert float(status.values["length_misfit"]) > 1e-4


def test_what_fits_no_pose_is_counted_and_the_next_one_is_found(estimator, robot):
    assert estimator.on_motor_states(0.0, states(1, np.array([800.0, -800.0] * 4))) == ()
    assert estimator.failures == 1
    assert estimator.status(0.0).level is Level.ERROR
    estimator.on_cable_tensions(0.0, cells(6, np.full(8, np.nan)))
    assert estimator.on_motor_states(0.0, states(6, np.zeros(8))) == ()
    assert estimator.failures == 2
    estimator.on_cable_tensions(0.0, cells(11, robot.home_tensions))
    (sample,) = published(estimator.on_motor_states(0.0, states(11, np.zeros(8))))
    np.testing.assert_allclose(sample.position, robot.home.position, atol=1e-8)
    assert estimator.status(0.0).level is Level.OK


def test_a_run_over_pulleys_that_nobody_configured_is_a_warning(robot):
    estimator = PoseComponent(robot, rate=50.0, period=0.004)
    truth = robot.with_geometry(pulleys=Pulleys(0.05))
    for step in range(100):
        s = 0.0628 * step
        place = robot.home.position + 0.5 * np.array([np.sin(s), np.sin(2.0 * s), np.sin(s)])
        angles = truth.motor_angles(cable_lengths(truth, Pose(place, np.eye(3))))
        sample = JointStateSample(20_000_000 * (step + 1), angles, np.zeros(8), np.zeros(8))
        assert estimator.on_motor_states(0.0, sample)
    status = estimator.status(0.0)
    assert status.level is Level.WARN
    assert "cspr identify" in status.message
    assert float(status.values["length_misfit_rms"]) > 4e-4
