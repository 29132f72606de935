"""The platform's pose from the motor angles."""

import numpy as np
import pytest

from cspr_control.components.pose import PoseComponent
from cspr_kinematics import ForwardKinematicsError, InvalidInputError, Pose, inverse_kinematics


def test_pose_estimator_follows_the_motor_angles(robot, rng):
    estimator = PoseComponent(robot, rate=50.0, period=0.004)
    for step in range(20):
        pose = Pose.from_euler(
            np.add(robot.home.position, [0.02 * step, -0.01 * step, 0.01 * step]), 0.01 * step, 0.0, 0.02
        )
        angles = robot.winch.motor_angle(inverse_kinematics(robot, pose).lengths)
        estimated = estimator.estimate(angles)
        np.testing.assert_allclose(estimated.position, pose.position, atol=1e-7)
        np.testing.assert_allclose(estimated.rotation, pose.rotation, atol=1e-7)


def test_pose_estimator_refuses_what_fits_no_pose_and_goes_on(robot):
    estimator = PoseComponent(robot, rate=50.0, period=0.004)
    with pytest.raises(ForwardKinematicsError):
        estimator.estimate(np.array([800.0, -800.0] * 4))
    with pytest.raises(InvalidInputError):
        estimator.estimate(np.full(8, np.nan))
    assert estimator.failures == 1
    np.testing.assert_allclose(estimator.estimate(np.zeros(8)).position, robot.home.position, atol=1e-8)
