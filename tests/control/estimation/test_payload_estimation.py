import math
from dataclasses import replace

import numpy as np
import pytest

from cspr_control.errors import MeasurementError
from cspr_control.estimation.payload import Invalidity, PayloadEstimator
from cspr_control.estimation.payload_measurement import measure_payload
from cspr_control.parameters.settings import estimator_settings
from cspr_kinematics import (
    Payload,
    Pose,
    distribute_tensions,
    inverse_kinematics,
    static_wrench,
)
from cspr_msgs_py.parameters.table import defaults

PERIOD = 0.02
NANOSECONDS = 1_000_000_000
SETTINGS = estimator_settings(defaults("mass_estimator"))


def static_tensions(robot, pose, payload):
    wrench_matrix = inverse_kinematics(robot, pose).wrench_matrix
    wrench = static_wrench(robot, pose, payload)
    return distribute_tensions(wrench_matrix, wrench, robot.tension_min, robot.tension_max).tensions


class Bench:
    """An estimator that is fed tensions and poses every period."""

    def __init__(self, robot, rng=None, noise=0.0, pose=None, **settings):
        self.robot = robot
        self.estimator = PayloadEstimator(robot, replace(SETTINGS, **settings))
        self.time = 100.0
        self.pose = pose or robot.home
        self._rng, self._noise = rng, noise

    def run(self, duration, payload, tensions=None, velocity=(0.0, 0.0, 0.0), poses=True, samples=5):
        estimates = []
        for _ in range(round(duration / PERIOD)):
            self.time += PERIOD
            stamp = round(self.time * NANOSECONDS)
            self.pose = Pose(self.pose.position + np.multiply(velocity, PERIOD), self.pose.rotation)
            exact = static_tensions(self.robot, self.pose, payload) if tensions is None else tensions
            for _ in range(samples):
                noise = self._rng.normal(0.0, self._noise, len(exact)) if self._noise else 0.0
                self.estimator.observe_tensions(self.time, stamp, exact + noise)
            if poses:
                self.estimator.observe_pose(self.time, stamp, self.pose)
            estimates.append(self.estimator.update(self.time))
        return estimates


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.2, math.radians(5.0), math.radians(-5.0))])
def test_measurement_is_exact_at_rest(robot, angles):
    pose = Pose.from_euler([0.2, -0.3, 1.1], *angles)
    payload = Payload(120.0, [0.03, -0.04, 0.06])
    measurement = measure_payload(robot, pose, static_tensions(robot, pose, payload), payload_height=0.06)
    assert measurement.mass == pytest.approx(120.0)
    assert measurement.total_mass == pytest.approx(273.0)
    np.testing.assert_allclose(measurement.moment / measurement.mass, [0.03, -0.04], atol=1e-9)
    np.testing.assert_allclose(
        measurement.total_moment / measurement.total_mass, np.array([3.6, -4.8]) / 273.0, atol=1e-9
    )


def test_level_measurement_is_that_of_the_paper(robot):
    payload = Payload(200.0, [0.05, 0.02, 0.0])
    measurement = measure_payload(robot, robot.home, static_tensions(robot, robot.home, payload))
    mass = measurement.wrench[2] / 9.81
    assert measurement.total_mass == pytest.approx(mass)
    np.testing.assert_allclose(
        measurement.total_moment / measurement.total_mass,
        [-measurement.wrench[4] / (mass * 9.81), measurement.wrench[3] / (mass * 9.81)],
    )


def test_first_measurements_start_the_filter_without_a_ramp(robot, rng):
    bench = Bench(robot, rng, noise=5.0, time_constant=2.0, mass_rate_limit=1e4)
    estimates = bench.run(0.4, Payload(100.0, [0.02, 0.01, 0.0]))
    assert estimates[1].published.mass == pytest.approx(100.0, abs=2.0)
    assert estimates[-1].filtered_mass == pytest.approx(100.0, abs=1.0)
    assert estimates[-1].samples == 20
    assert estimates[-1].stamp == round(bench.time * NANOSECONDS)


def test_noise_is_filtered_and_the_estimate_has_no_bias(robot, rng):
    bench = Bench(robot, rng, noise=5.0, center_rate_limit=10.0)
    estimates = bench.run(8.0, Payload(100.0, [0.02, -0.03, 0.0]))[200:]
    raw = np.array([estimate.raw.mass for estimate in estimates])
    published = np.array([estimate.published.mass for estimate in estimates])
    assert published.std() < 0.4 * raw.std()
    assert published.mean() == pytest.approx(100.0, abs=0.1)
    np.testing.assert_allclose(estimates[-1].published.center_of_mass, [0.02, -0.03, 0.0], atol=2e-3)


def test_step_is_followed_with_the_time_constant(robot):
    bench = Bench(robot, time_constant=0.4, mass_rate_limit=1e4)
    bench.run(2.0, Payload(100.0, np.zeros(3)))
    after = bench.run(0.4, Payload(200.0, np.zeros(3)))
    assert after[-1].filtered_mass == pytest.approx(200.0 - 100.0 / math.e, abs=0.1)


def test_published_mass_is_rate_limited_and_bounded(robot):
    bench = Bench(robot, time_constant=0.05, mass_rate_limit=50.0, max_payload=80.0)
    estimates = bench.run(3.0, Payload(100.0, np.zeros(3)))
    masses = np.array([0.0] + [estimate.published.mass for estimate in estimates])
    assert np.diff(masses).max() <= 50.0 * PERIOD + 1e-9
    assert masses[-1] == 80.0
    assert estimates[-1].filtered_mass == pytest.approx(100.0)
    lightened = bench.run(5.0, None, tensions=0.9 * static_tensions(robot, robot.home, None))
    assert lightened[-1].published.mass == 0.0
    assert lightened[-1].filtered_mass == pytest.approx(-15.3)


def test_centre_of_mass_is_bounded_and_absent_without_payload(robot):
    bench = Bench(robot, max_offset=0.05, center_rate_limit=10.0, mass_rate_limit=1e4)
    heavy = bench.run(1.0, Payload(50.0, [0.12, -0.01, 0.0]))[-1]
    np.testing.assert_allclose(heavy.published.center_of_mass, [0.05, -0.01, 0.0], atol=1e-6)
    empty = bench.run(4.0, Payload(1.0, [0.12, 0.0, 0.0]))[-1]
    np.testing.assert_array_equal(empty.published.center_of_mass, np.zeros(3))


def test_before_the_first_inputs(robot):
    estimator = PayloadEstimator(robot, SETTINGS, Payload(12.0, np.zeros(3)))
    assert estimator.update(1.0).invalidities == (Invalidity.NO_POSE,)
    estimator.observe_tensions(1.0, 1, np.zeros(8))
    assert estimator.update(1.01).invalidities == (Invalidity.NO_POSE,)
    estimator.observe_pose(1.0, 1, robot.home)
    estimate = estimator.update(1.02)
    assert estimate.invalidities == (Invalidity.NO_TENSIONS,)
    assert not estimate.valid
    assert (estimate.published.mass, estimate.samples, estimate.stamp) == (12.0, 0, 0)


def held_after(bench, reason, **disturbance):
    before = bench.run(1.0, Payload(60.0, np.zeros(3)))[-1]
    assert before.valid
    disturbed = bench.run(0.4, Payload(60.0, np.zeros(3)), **disturbance)[-1]
    assert reason in disturbed.invalidities
    assert disturbed.published is before.published
    assert disturbed.samples < before.samples + 12
    return before


def test_slack_cable_holds_the_estimate(robot):
    bench = Bench(robot)
    tensions = np.array(static_tensions(robot, robot.home, Payload(60.0, np.zeros(3))))
    tensions[2] = 3.0
    before = held_after(bench, Invalidity.SLACK_CABLE, tensions=tensions)
    recovered = bench.run(0.1, Payload(60.0, np.zeros(3)))[-1]
    assert recovered.valid
    assert recovered.published.mass == pytest.approx(before.published.mass, abs=0.1)


def test_fast_motion_holds_the_estimate(robot):
    held_after(Bench(robot), Invalidity.MOVING_TOO_FAST, velocity=(0.0, 0.7, 0.0))


def test_fast_turning_holds_the_estimate(robot):
    bench = Bench(robot)
    payload = Payload(60.0, np.zeros(3))
    bench.run(0.1, payload)
    bench.pose = Pose.from_euler(robot.home.position, 0.02, 0.0, 0.0)
    turned = bench.run(PERIOD, payload)[-1]
    assert turned.invalidities == (Invalidity.TURNING_TOO_FAST,)


def test_sideways_pull_holds_the_estimate(robot):
    A = inverse_kinematics(robot, robot.home).wrench_matrix
    wrench = np.array([300.0, 0.0, 2090.0, 0.0, 0.0, 0.0])
    held_after(Bench(robot), Invalidity.NOT_VERTICAL, tensions=np.linalg.pinv(A) @ wrench)


def test_stale_pose_and_tensions_hold_the_estimate(robot):
    bench = Bench(robot)
    before = bench.run(1.0, Payload(60.0, np.zeros(3)))[-1]
    stale = bench.run(0.4, Payload(60.0, np.zeros(3)), poses=False)[-1]
    assert Invalidity.STALE_POSE in stale.invalidities
    bench.run(0.1, Payload(60.0, np.zeros(3)))
    stale = bench.run(0.4, Payload(60.0, np.zeros(3)), samples=0)[-1]
    assert stale.invalidities == (Invalidity.STALE_TENSIONS,)
    assert stale.published.mass == pytest.approx(before.published.mass, abs=1e-6)
    assert stale.stamp < round(bench.time * NANOSECONDS)


@pytest.mark.parametrize("tensions", [[1.0] * 7, [*[100.0] * 7, math.nan]])
def test_tensions_that_cannot_be_used_are_refused(robot, tensions):
    estimator = PayloadEstimator(robot, SETTINGS)
    with pytest.raises(MeasurementError, match="8 finite"):
        estimator.observe_tensions(1.0, 1, tensions)
