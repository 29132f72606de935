"""The estimation of the payload in the graph: what it hears, says and reports, and how it starts again in motion."""

import numpy as np
import pytest

pytest.importorskip("mujoco")

from cspr_control.closed_loop.run import closed_loop
from cspr_control.closed_loop.scenario import Scenario
from cspr_control.components.component import Publication
from cspr_control.components.feedforward import FeedforwardComponent
from cspr_control.components.payload import PayloadComponent
from cspr_control.graph import Route
from cspr_control.motors.feedforward import FeedforwardSettings
from cspr_control.parameters.settings import estimator_settings
from cspr_control.reference.point_to_point import MotionLimits, PointToPoint
from cspr_kinematics import (
    Payload,
    Pose,
    Pulleys,
    Robot,
    distribute_tensions,
    holding_tensions,
    inverse_kinematics,
    rope_wrench,
    static_wrench,
)
from cspr_msgs_py import topics
from cspr_msgs_py.parameters.table import defaults
from cspr_msgs_py.vocabulary import CellCheck, Level, RobotState
from cspr_msgs_py.wire.joint_state import JointStateSample
from cspr_msgs_py.wire.samples import InertiaSample, Status

NONE, AT_REST = np.empty(0), np.zeros(8)
SETTINGS = estimator_settings(defaults("mass_estimator"))


@pytest.fixture
def component(robot):
    return PayloadComponent(robot, SETTINGS)


@pytest.fixture(scope="module")
def taut(robot):
    cables = inverse_kinematics(robot, robot.home)
    wrench = static_wrench(robot, robot.home, Payload(80.0, np.zeros(3))) + rope_wrench(robot, cables)
    return distribute_tensions(cables.wrench_matrix, wrench, robot.tension_min, robot.tension_max).tensions


def cycle(component, number, tensions, tensions_first=False, paired=True, torques=AT_REST):
    stamp, now = 4_000_000 * number, 0.004 * number
    states = JointStateSample(stamp, AT_REST, AT_REST, torques)
    pulls = JointStateSample(stamp + 2_000_000 * (not paired), NONE, NONE, tensions)
    steps = [(component.on_motor_states, states), (component.on_cable_tensions, pulls)]
    outputs = []
    for handle, sample in reversed(steps) if tensions_first else steps:
        outputs += handle(now, sample)
    return outputs


def of(outputs, topic):
    return [each.sample for each in outputs if isinstance(each, Publication) and each.topic is topic]


@pytest.mark.parametrize("tensions_first", [False, True])
def test_every_sync_brings_a_payload_and_a_wrench(component, taut, tensions_first):
    outputs = [cycle(component, k, taut, tensions_first) for k in range(1, 60)]
    payloads = [of(each, topics.PAYLOAD) for each in outputs]
    first = next(k for k, each in enumerate(payloads) if each)
    assert 20 < first < 35
    assert all(len(each) == 1 for each in payloads[first:])
    assert payloads[-1][0].stamp_ns == 59 * 4_000_000
    assert payloads[-1][0].mass == pytest.approx(80.0, abs=0.1)
    (wrench,) = of(outputs[-1], topics.EXTERNAL_WRENCH)
    np.testing.assert_allclose([*wrench.force, *wrench.moment], 0.0, atol=0.5)


def test_a_held_payload_is_still_told_and_says_why(component, taut):
    for k in range(1, 60):
        cycle(component, k, taut)
    slack = np.where(np.arange(8) == 3, 5.0, taut)
    outputs = cycle(component, 60, slack)
    (held,) = of(outputs, topics.PAYLOAD)
    assert held.stamp_ns == 59 * 4_000_000
    assert of(outputs, topics.EXTERNAL_WRENCH) == []
    (report,) = of(outputs, topics.DIAGNOSTICS)
    (status,) = report.statuses
    assert status.level is Level.WARN
    assert status.values["held_by"] == "slack_cable"
    (told_again,) = of(cycle(component, 61, slack), topics.PAYLOAD)
    assert told_again == held


def test_what_does_not_belong_together_is_counted(component, taut):
    for k in range(1, 10):
        assert cycle(component, k, taut, paired=False) == []
    status = component.status(1.0)
    assert status.values["held_by"] == "no_cycle"
    assert int(status.values["unpaired_messages"]) >= 16


def test_silence_is_reported_as_such(component, taut):
    for k in range(1, 60):
        cycle(component, k, taut)
    assert component.status(0.25).values["held_by"] == ""
    assert component.status(0.25).values["valid"] == "true"
    status = component.status(0.24 + SETTINGS.input_timeout)
    assert (status.level, status.values["held_by"]) == (Level.WARN, "stale")


def test_what_cannot_be_used_is_counted(component, taut):
    assert cycle(component, 1, np.full(8, np.nan)) == []
    component.on_payload_in_use(0.0, InertiaSample(0, -5.0, np.zeros(3)))
    assert component.unusable == 2
    assert "payload mass" in component.problem


def status_after_a_run(believed: Robot, truth: Robot) -> Status:
    """Show what is told of 100 kg at rest 0.6 m up, after places of a true robot, each at rest too."""
    component, load = PayloadComponent(believed, SETTINGS), Payload(100.0, np.zeros(3))
    around = [np.array([np.sin(s), np.sin(2.0 * s), np.sin(s)]) for s in np.linspace(0.0, 6.0, 60)]
    places = [*(0.5 * each for each in around), *60 * [np.array([0.0, 0.0, 0.6])]]
    for k, away in enumerate(places):
        pose = Pose(truth.home.position + away, truth.home.rotation)
        pulls = holding_tensions(truth, pose, load).tensions
        angles = truth.motor_angles(inverse_kinematics(truth, pose).lengths, pulls)
        stamp = 10**9 * k if k < 60 else 60 * 10**9 + 4_000_000 * k
        component.on_motor_states(
            0.0, JointStateSample(stamp, angles, AT_REST, truth.winch.motor_torque(pulls))
        )
        component.on_cable_tensions(0.0, JointStateSample(stamp, NONE, NONE, pulls))
    return component.status(0.0)


def test_pulleys_that_nobody_configured_are_a_warning(robot):
    truth = robot.with_geometry(pulleys=Pulleys(0.05))
    known, unknown = status_after_a_run(truth, truth), status_after_a_run(robot, truth)
    assert float(known.values["estimated_mass"]) == pytest.approx(100.0, abs=0.1)
    assert abs(float(unknown.values["estimated_mass"]) - 100.0) > 3.0
    assert (known.level, known.message) == (Level.OK, "estimating")
    assert (unknown.level, unknown.values["valid"]) == (Level.WARN, "true")
    assert "the mass may be wrong: cable lengths misfit by" in unknown.message
    assert "cspr identify" in unknown.message
    assert float(known.values["length_misfit_rms"]) < 1e-6 < 4e-4 < float(unknown.values["length_misfit_rms"])


def test_no_cell_is_judged_by_its_motor_before_the_motors_carry_the_cables(component, robot, taut):
    wrong = taut + 120.0 * (np.arange(8) == 3)  # four times what friction hides from a motor at rest
    torques = robot.winch.motor_torque(taut)
    enabled = 1250  # after the longest that enabling may take, five seconds
    found = []
    for k in range(1, enabled + 200):
        if k in (1, enabled):
            state = RobotState.ENABLED if k == enabled else RobotState.ENABLING
            component.on_robot_state(0.004 * k, Status("supervisor", Level.OK, state.value, {}))
        noisy = wrong + 0.1 * (-1) ** k  # a cell that shows the same for ever is another fault
        checks = of(cycle(component, k, noisy, torques=torques), topics.LOAD_CELL_CHECK)
        found += [(0.004 * (k - enabled), check.message, check.values["cell"]) for check in checks]
    ((after, verdict, cell),) = found
    assert (verdict, cell) == (CellCheck.EXCLUDED, "cable_4")
    assert 0.5 <= after <= 0.6


def test_the_feedforward_tells_which_payload_is_in_use_when_it_changes(robot):
    feedforward = FeedforwardComponent(
        robot, FeedforwardSettings(nominal_payload=Payload(30.0, [0.0, 0.0, 0.1]))
    )
    (first,) = of(feedforward.begin(), topics.PAYLOAD_IN_USE)
    assert (first.mass, first.center_of_mass[2]) == (30.0, 0.1)
    assert feedforward.tell_payload(0.02) == ()
    feedforward.on_payload(0.03, InertiaSample(7, 80.0, np.array([0.01, 0.0, 0.0])))
    (changed,) = of(feedforward.tell_payload(0.04), topics.PAYLOAD_IN_USE)
    assert (changed.stamp_ns, changed.mass, changed.center_of_mass[0]) == (7, 80.0, 0.01)
    feedforward.on_payload(0.05, InertiaSample(8, 80.0, np.array([0.01, 0.0, 0.0])))
    assert feedforward.tell_payload(0.06) == ()


def test_a_restart_in_motion_is_no_step_of_the_torque(robot_file):
    loop = closed_loop(Scenario(payload=150.0, config=robot_file.parent, devices=False))
    samples = {topic.name: [] for topic in (topics.SETPOINT, topics.PAYLOAD, topics.PAYLOAD_IN_USE)}
    loop.listeners.append(lambda topic, sample: samples.get(topic.name, []).append(sample))
    loop.begin()
    loop.enable()
    loop.time.wait(0.4)
    goal = Pose(np.add(loop.robot.home.position, [0.5, 0.2, 0.3]), loop.robot.home.rotation)
    loop.play(lambda here: PointToPoint(here, goal, MotionLimits(0.5, 1.0, 0.5, 1.0)))
    loop.time.wait((loop.player.start_time - loop.time.system_ns()) * 1e-9 + 0.4)  # accelerating

    old, graph = loop.graph.components["mass_estimator"], loop.graph
    fresh = PayloadComponent(loop.robot, loop.settings.payload)
    graph.components["mass_estimator"] = fresh
    for topic in old.inputs:
        routes = graph.routes(topic)
        routes[:] = [Route(fresh, own, fresh.handler(own)) if each is old else Route(each, own, handle)
                     for each, own, handle in routes]  # fmt: skip
    in_use = samples["/payload_in_use"][-1]
    fresh.on_payload_in_use(
        loop.time.monotonic(), in_use
    )  # a latched topic: whoever joins is given the last one
    before = {name: len(each) for name, each in samples.items()}
    assert loop.player.sample(loop.time.system_ns()).twist.linear.any()
    loop.time.wait(0.4)

    masses = np.array([sample.mass for sample in samples["/payload"][before["/payload"] - 1 :]])
    assert 60 < len(masses) < 80  # silent for a moment
    np.testing.assert_allclose(masses, in_use.mass, atol=1.0)
    torques = np.array([sample.effort for sample in samples["/setpoint"]])
    steps = np.abs(np.diff(torques, axis=0)).max(axis=1)
    one_kilogram = loop.robot.winch.transmission_ratio * 9.81 / 8
    restart = before["/setpoint"]
    assert steps[restart - 1 :].max() < steps[restart - 50 : restart].max() + one_kilogram
    assert loop.state.value == "enabled"
