"""The filter on motions that MuJoCo integrates under known wrenches: the equations of the filter are not used there."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from cspr_control.estimation.motion_filter import MotionFilter
from cspr_control.estimation.observation import Found, Held, Observation
from cspr_control.parameters.settings import estimator_settings
from cspr_kinematics import Payload, Pose, inverse_kinematics
from cspr_msgs_py.parameters.table import defaults

PERIOD = 0.004
SETTINGS = replace(estimator_settings(defaults("mass_estimator")).motion, tension_skew=0.0)
G = 9.81
LOAD = Payload(120.0, [0.06, -0.04, 0.03])


class FreeBody:
    """A platform with a load that is fixed to it, pushed about by forces and moments at the common centre of mass."""

    def __init__(self, robot, payload, rotation=None):
        platform = robot.platform
        self.mass = platform.mass + payload.mass
        self.center = (platform.first_moment + payload.first_moment) / self.mass
        quaternion = np.roll(Pose(np.zeros(3), np.eye(3) if rotation is None else rotation).quaternion, 1)
        inertia = " ".join(map(repr, np.diag(platform.inertia).tolist()))
        at = " ".join(map(repr, payload.center_of_mass.tolist()))
        self.model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option gravity="0 0 -{G}" timestep="1e-3" integrator="RK4"/><worldbody>'
            f'<body name="platform" pos="0 0 1" quat="{" ".join(map(repr, quaternion.tolist()))}"><freejoint/>'
            f'<inertial pos="0 0 0" mass="{platform.mass}" diaginertia="{inertia}"/>'
            f'<body pos="{at}"><inertial pos="0 0 0" mass="{payload.mass}" diaginertia="1e-6 1e-6 1e-6"/></body>'
            "</body></worldbody></mujoco>"
        )
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)

    @property
    def rotation(self):
        return np.array(self.data.body("platform").xmat).reshape(3, 3)

    def wrench(self, force, moment):
        """Return the wrench about the platform's origin of a force and a moment at the centre of mass."""
        return np.concatenate((force, moment + np.cross(self.rotation @ self.center, force)))

    def advance(self, push, duration):
        """Integrate; ``push(t)`` gives force and moment, applied as the generalised force of the free joint."""
        for _ in range(round(duration / 1e-3)):
            # at the middle of a step: RK4 holds applied forces over the step
            wrench = self.wrench(*push(self.data.time + 0.5e-3))
            self.data.qfrc_applied[:3] = wrench[:3]
            self.data.qfrc_applied[3:] = self.rotation.T @ wrench[3:]
            mujoco.mj_step(self.model, self.data)
        mujoco.mj_forward(self.model, self.data)

    def observation(self, push, step=PERIOD):
        position = np.array(self.data.body("platform").xpos)
        return Observation(
            step, position, self.rotation, self.wrench(*push(self.data.time)), np.zeros((8, 6))
        )


def shaken(mass, forward=(2.0, 1.5, 3.0), turning=(1.0, -0.8, 0.6)):
    """Return a push: the weight, accelerations of some m/s^2 that swing back and forth, and moments."""
    omega = 2.0 * math.pi * np.array([1.1, 1.3, 0.9])

    def push(t):
        force = mass * np.multiply(forward, np.cos(omega * t)) + [0.0, 0.0, mass * G]
        return force, np.multiply(turning, np.cos(omega[::-1] * t))

    return push


def run(body, push, filter, duration, wait=None, rng=None, noise=(0.0, 0.0)):
    results = []
    for _ in range(round(duration / PERIOD)):
        body.advance(push, PERIOD)
        observation = body.observation(push)
        if rng is not None:
            position = observation.position + rng.normal(0.0, noise[0], 3)
            wrench = observation.wrench + rng.normal(0.0, noise[1], 6)
            observation = observation._replace(position=position, wrench=wrench)
        results.append(filter.observe(observation, wait))
    return results


def test_mass_and_centre_are_found_in_any_motion(robot):
    body = FreeBody(robot, LOAD)
    filter = MotionFilter(robot, SETTINGS, Payload.none())
    results = run(body, shaken(body.mass), filter, 2.0)
    assert results[:20] == [Held.STARTING] * 20
    found = results[150:]
    masses = np.array([each.mass for each in found])
    np.testing.assert_allclose(masses, 120.0, atol=0.1)
    centers = np.array([each.moment / each.mass for each in found])
    np.testing.assert_allclose(centers[:, :2], np.tile([0.06, -0.04], (len(found), 1)), atol=1e-3)
    assert centers[-1, 2] == pytest.approx(0.03, abs=0.01)  # by the accelerations along x and y
    np.testing.assert_allclose(found[-1].external_wrench, 0.0, atol=3.0)


def test_a_static_balance_would_be_off_by_far(robot):
    body = FreeBody(robot, LOAD)
    push = shaken(body.mass)
    weights = []
    for _ in range(250):
        body.advance(push, PERIOD)
        weights.append(body.observation(push).wrench[2] / G - robot.platform.mass)
    assert np.ptp(weights) > 100.0


def test_a_tilted_platform_that_turns_quickly_is_no_other_case(robot):
    tilted = Pose.from_euler(np.zeros(3), 0.4, 0.2, -0.25).rotation
    body = FreeBody(robot, LOAD, tilted)
    filter = MotionFilter(robot, SETTINGS, Payload.none())
    results = run(body, shaken(body.mass, turning=(8.0, 9.0, 12.0)), filter, 2.0)
    assert results[-1].mass == pytest.approx(120.0, abs=0.2)
    np.testing.assert_allclose(results[-1].moment / results[-1].mass, LOAD.center_of_mass, atol=6e-3)


def test_cycles_of_unequal_length_are_as_good(robot, rng):
    body = FreeBody(robot, LOAD)
    push = shaken(body.mass)
    filter = MotionFilter(robot, SETTINGS, Payload.none())
    masses = []
    for _ in range(400):
        step = float(rng.choice([0.003, 0.004, 0.008]))
        body.advance(push, step)
        found = filter.observe(body.observation(push, step), None)
        masses += [found.mass] if isinstance(found, Found) else []
    np.testing.assert_allclose(masses[100:], 120.0, atol=0.2)


def test_a_load_that_appears_is_found_at_once(robot):
    empty, laden = FreeBody(robot, Payload.none()), FreeBody(robot, LOAD)
    filter = MotionFilter(robot, SETTINGS, Payload.none())
    run(empty, shaken(empty.mass), filter, 1.0)
    assert filter.alarms == 0
    # the cables pull as before at first: the platform with its load begins to fall
    laden.data.qpos[:] = empty.data.qpos
    laden.data.qvel[:] = empty.data.qvel
    laden.data.time = empty.data.time
    mujoco.mj_forward(laden.model, laden.data)
    results = run(laden, shaken(robot.platform.mass + 80.0), filter, 0.3)
    assert filter.alarms >= 1
    late = [each.mass for each in results[30:]]
    np.testing.assert_allclose(late, 120.0, atol=0.02 * 120.0)


def test_a_push_from_the_side_is_no_mass_and_is_told(robot):
    body = FreeBody(robot, LOAD)
    filter = MotionFilter(robot, SETTINGS, LOAD)
    push = shaken(body.mass)
    run(body, push, filter, 1.0)
    side = np.array([60.0, -20.0, 0.0])

    def cables(t):  # carry the push as well, so that the motion is the same
        force, moment = push(t)
        return force - side, moment

    found = []
    for _ in range(250):
        body.advance(push, PERIOD)
        observation = body.observation(cables)
        found.append(filter.observe(observation, None))
    assert np.abs([each.mass - 120.0 for each in found]).max() < 1.5
    np.testing.assert_allclose(found[-1].external_wrench[:2], side[:2], atol=6.0)
    assert filter.deviations[0] < 2.0


def test_noise_hardly_shows(robot, rng):
    body = FreeBody(robot, LOAD)
    filter = MotionFilter(robot, SETTINGS, LOAD)
    results = run(body, shaken(body.mass, (0.0,) * 3, (0.0,) * 3), filter, 3.0, rng=rng, noise=(5e-6, 5.0))
    masses = np.array([each.mass for each in results[250:]])
    assert masses.std() < 0.1
    assert masses.mean() == pytest.approx(120.0, abs=0.1)
    assert filter.alarms == 0


@pytest.mark.parametrize("skew", [0.001, 0.0055])
def test_tensions_that_are_older_than_the_poses_need_to_be_known_as_such(robot, skew):
    errors = {}
    for told in (0.0, skew):
        body = FreeBody(robot, LOAD)
        push = shaken(body.mass, forward=(0.0, 0.0, 4.0), turning=(0.0,) * 3)
        filter = MotionFilter(robot, replace(SETTINGS, tension_skew=told), LOAD)
        masses = []
        for _ in range(500):
            body.advance(push, PERIOD)
            late = body.observation(lambda t, push=push: push(t - skew))
            found = filter.observe(late, None)
            masses += [found.mass] if isinstance(found, Found) else []
        errors[told] = np.abs(np.array(masses[100:]) - 120.0).max()
    assert errors[skew] < 0.25 * errors[0.0]
    assert errors[skew] < 0.2


def test_the_height_returns_to_what_is_assumed_while_nothing_tells_it(robot):
    filter = MotionFilter(robot, replace(SETTINGS, payload_height=-0.1), LOAD)
    body = FreeBody(robot, LOAD)
    results = run(body, shaken(body.mass, (0.0,) * 3, (0.0,) * 3), filter, 20.0)
    assert results[-1].moment[2] / results[-1].mass == pytest.approx(-0.1 + 0.13 * math.exp(-1.0), abs=0.01)


def test_a_jolt_and_a_gap_hold_the_estimate_and_begin_the_differences_anew(robot):
    body = FreeBody(robot, LOAD)
    filter = MotionFilter(robot, SETTINGS, LOAD)
    push = shaken(body.mass)
    before = run(body, push, filter, 0.5)[-1]
    jolt = body.observation(push)
    up = np.add(jolt.position, [0.0, 0.0, 0.01])
    assert filter.observe(jolt._replace(position=up), None) is Held.JOLT
    after = run(body, push, filter, 0.3)
    held = [each for each in after if isinstance(each, Held)]
    assert 0.08 < len(held) * PERIOD < 0.13
    assert after[len(held)].mass == pytest.approx(before.mass, abs=0.05)
    assert filter.observe(body.observation(push, math.inf), None) is Held.STARTING


def test_it_goes_on_without_the_cell_of_a_cable(robot):
    """What the excluded cell says is of no account at all."""
    A = np.array(inverse_kinematics(robot, robot.home).wrench_matrix)
    body = FreeBody(robot, LOAD)
    push = shaken(body.mass)
    filters = [MotionFilter(robot, SETTINGS, Payload.none()) for _ in range(2)]
    for _ in range(250):
        body.advance(push, PERIOD)
        observation = body.observation(push)._replace(jacobian=np.ascontiguousarray(-A.T))
        wrong = observation._replace(wrench=observation.wrench + A[:, 4] * 300.0)
        results = [
            filter.observe(each, None, 4) for filter, each in zip(filters, (observation, wrong), strict=True)
        ]
    assert results[0].mass == pytest.approx(120.0, abs=0.2)
    assert results[1].mass == pytest.approx(results[0].mass, abs=1e-6)
    np.testing.assert_allclose(results[1].moment, results[0].moment, atol=1e-6)
    assert filters[0].alarms <= 2
