"""The linearised feed-forward against the feed-forward of the graph, and what angles and tensions tell."""

import numpy as np
import pytest

from cspr_control.motors.feedforward import Feedforward, FeedforwardSettings
from cspr_control.stability.linear_plant import displaced, linear_plant
from cspr_control.stability.payload_path import FeedforwardPath, LinearObservation, PayloadLoop
from cspr_kinematics import Motion, Payload, Pose, inverse_kinematics
from cspr_kinematics.kinematics._cable_follower import elastic_tensions

PERIOD = 0.004  # s
MASS = 150.0  # kg


@pytest.mark.parametrize("method", ["closest", "analytic_center"])
def test_set_points_follow_a_payload_as_those_of_the_graph_do(robot, method):
    pose = Pose((0.6, -0.3, 1.5), np.eye(3))
    settings = FeedforwardSettings(tension_method=method)
    plant = linear_plant(robot, pose, Payload(MASS, np.zeros(3)), method)
    path = FeedforwardPath(PayloadLoop(plant, PERIOD, 0.0, settings))
    graph, changed = Feedforward(robot, settings), np.array([0.01, 3e-4, -2e-4])  # kg, kg m
    state = np.zeros(path.size)
    for cycle in range(60):
        payload = np.zeros(3) if cycle < 2 else changed
        mass = MASS + payload[0]
        graph.set_estimate(cycle * PERIOD, mass, [*payload[1:] / mass, 0.0])
        setpoint = graph.compute(cycle * PERIOD, Motion.at_rest(pose), round(cycle * PERIOD * 1e9))
        state = path.advance(state, payload)
        if cycle == 1:
            before = setpoint
    expected = path.setpoint(state)
    for found, rest, deviation in (
        (setpoint.angle, before.angle, expected.angle),
        (setpoint.speed, before.speed, expected.speed),
        (setpoint.torque, before.torque, expected.torque),
    ):
        np.testing.assert_allclose(found - rest, deviation, atol=2e-3 * np.abs(deviation).max())
    assert np.abs(expected.angle).max() > 0.0


def test_what_does_not_allow_for_stretch_moves_no_set_point(robot):
    plant = linear_plant(robot, robot.home, Payload.none())
    rigid = FeedforwardSettings(stretch_compensation=False)
    path = FeedforwardPath(PayloadLoop(plant, PERIOD, 0.0, rigid))
    state = path.advance(np.zeros(path.size), np.ones(3))
    assert not np.any(path.setpoint(state).angle)
    assert np.any(path.setpoint(state).torque)


def test_an_observation_allows_for_damping_as_the_estimate_does(robot, rng):
    plant = linear_plant(robot, robot.home, Payload(MASS, np.zeros(3)))
    observe = LinearObservation(PayloadLoop(plant, PERIOD, 0.0, FeedforwardSettings()))
    state, no_turn, before, elastic = np.zeros(8), np.zeros(8), np.zeros(8), np.zeros(8)
    for tensions in rng.uniform(0.0, 1.0, (10, 8)):
        elastic_tensions(PERIOD, robot.cables.damping_time, tensions, before, elastic)
        state, displacement, _ = observe(state, no_turn, tensions)
    at_rest = elastic
    for _ in range(20):
        state, expected, _ = observe(state, no_turn, at_rest)
    np.testing.assert_allclose(displacement, expected, atol=1e-12)
    assert np.abs(elastic - tensions).max() > 0.1


def test_an_observed_displacement_is_the_true_one(robot, rng):
    """Angles and tensions of a displaced platform give back where it is, and what the cables pull there."""
    plant = linear_plant(robot, Pose((0.4, 0.2, 1.2), np.eye(3)), Payload(MASS, np.zeros(3)))
    displacement, tensions = 1e-6 * rng.standard_normal(6), 1e-2 * rng.standard_normal(8)
    there = inverse_kinematics(robot, displaced(plant.pose, displacement))
    here = inverse_kinematics(robot, plant.pose)
    angles = robot.motor_angles(there.lengths, plant.tensions + tensions)
    angles = angles - robot.motor_angles(here.lengths, plant.tensions)
    observe = LinearObservation(PayloadLoop(plant, PERIOD, 0.0, FeedforwardSettings()))
    state = np.zeros(observe.size)
    for _ in range(20):  # the damping of the cables dies away
        state, found, wrench = observe(state, angles, tensions)
    np.testing.assert_allclose(found, displacement, atol=1e-10)
    pulled = there.wrench_matrix @ (plant.tensions + tensions) - here.wrench_matrix @ plant.tensions
    np.testing.assert_allclose(wrench, pulled, atol=1e-5)
