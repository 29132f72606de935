"""Re-runs over recordings whose making is known: reproduced, changed, deterministic, refused."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from rcl_interfaces.msg import Parameter, ParameterEvent, ParameterType, ParameterValue
from rclpy.serialization import serialize_message
from rosbags.typesys import get_types_from_msg

from cspr_control.closed_loop.run import run as run_loop
from cspr_control.closed_loop.scenario import Scenario, soft_sling
from cspr_control.estimation.payload import PayloadEstimator
from cspr_control.motors.feedforward import Feedforward, FeedforwardSettings
from cspr_control.parameters.settings import estimator_settings
from cspr_control.programs import rerun
from cspr_control.reference.paper import paper_19
from cspr_control.rerun.bag import DEFINITIONS
from cspr_kinematics import Payload, Pose, holding_tensions, inverse_kinematics, static_wrench
from cspr_msgs_py import topics
from cspr_msgs_py.bag.bag_file import Attachment, BagFile
from cspr_msgs_py.bag.metadata import RecordedTopic
from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.message_definitions import message_definition
from cspr_msgs_py.parameters.file import ParameterFile
from cspr_msgs_py.parameters.table import defaults
from cspr_msgs_py.vocabulary import FeedforwardModel, TrajectoryName
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.reference import ReferenceCodec, ReferenceSample
from cspr_msgs_py.wire.stamped_doubles import INERTIA as INERTIA_DOUBLES
from cspr_msgs_py.wire.stamped_doubles import StampedDoublesCodec

CONFIG = Path(__file__).parents[3] / "config"
START = 1_700_000_000_000_000_000
MS = 1_000_000
LENGTH = 2.2  # s
CYCLES = round(LENGTH * 250)
STEP_AT = 1.0  # s: the load grows from 50 to 150 kg
MOTORS = JointStateCodec(topics.motor_names(8))
CABLES = JointStateCodec(topics.cable_names(8), position=False, velocity=False)
INERTIA = StampedDoublesCodec(topics.PLATFORM_FRAME, INERTIA_DOUBLES)
REFERENCE = ReferenceCodec()
PARAMETER_EVENTS = topics.Topic(
    "/parameter_events", "rcl_interfaces/msg/ParameterEvent", topics.Rate.ON_CHANGE, "*", "",
    reliable=True, latched=False, depth=10,
)  # fmt: skip
RECORDED = (
    topics.MOTOR_STATES, topics.CABLE_TENSIONS, topics.REFERENCE, topics.PAYLOAD, topics.PAYLOAD_IN_USE,
    topics.SETPOINT, topics.SIMULATED_PAYLOAD, PARAMETER_EVENTS,
)  # fmt: skip


class Graph:
    """A robot that stands still while its load changes, as estimator, feed-forward and recorder live through it.

    The estimator is there from a time on, s.
    """

    def __init__(self, robot, model_change=None, estimator_since=0.0):
        self.messages = []  # topic, received, published, data
        self._robot = robot
        self._estimator_since = estimator_since
        self._estimator = PayloadEstimator(robot, estimator_settings(defaults("mass_estimator")))
        self._estimator.begin_at(Payload.none())
        self._feedforward = Feedforward(robot, FeedforwardSettings())
        self._trajectory = paper_19(robot.trajectory_center)
        self._rng = np.random.default_rng(7)
        self._home_lengths = inverse_kinematics(robot, robot.home).lengths
        tensions = {
            mass: holding_tensions(robot, robot.home, Payload(mass, np.zeros(3))).tensions
            for mass in (50.0, 150.0)
        }
        changed = model_change is None
        for cycle in range(CYCLES):
            now = START + cycle * 4 * MS
            mass = 50.0 if cycle * 0.004 < STEP_AT else 150.0
            if not changed and cycle * 0.004 >= model_change[0]:
                changed = True
                self._change_model(now, model_change[1])
            self._cycle(cycle, now, mass, tensions[mass])

    def _jitter(self, most_us):
        return int(self._rng.integers(0, most_us * 1000))

    def _record(self, topic, received, data, published=None):
        self.messages.append((topic, received, received if published is None else published, data))

    def _cycle(self, cycle, now, mass, tensions):
        arrival = now + MS + self._jitter(400)
        none = np.zeros(8)
        angles = self._robot.motor_angles(self._home_lengths, tensions)  # they take up the stretch
        tensions = tensions + self._rng.normal(0.0, 1e-3, 8)  # no load cell shows the same for long
        self._record(topics.MOTOR_STATES, arrival, MOTORS.encode(now, angles, none, none))
        arrival += self._jitter(400)
        self._record(topics.CABLE_TENSIONS, arrival, CABLES.encode(now, effort=tensions))
        estimate = self._estimator.newest
        if cycle * 0.004 >= self._estimator_since:
            estimate = self._estimator.observe(now, angles, tensions)
        if estimate.samples > 0:
            payload = estimate.published
            data = INERTIA.encode(estimate.stamp, [payload.mass, *payload.center_of_mass, *np.zeros(6)])
            # the recorder hears of it later, perhaps after the motor states of the next cycle
            self._record(topics.PAYLOAD, arrival + 100_000 + self._jitter(3500), data, arrival)
            self._feedforward.set_estimate(arrival * 1e-9, payload.mass, payload.center_of_mass)
        if cycle % 5 == 0:
            self._record(topics.SIMULATED_PAYLOAD, arrival, INERTIA.encode(now, [mass, *np.zeros(9)]))
            payload, _ = self._feedforward.payload_in_use(arrival * 1e-9)
            data = INERTIA.encode(estimate.stamp, [payload.mass, *payload.center_of_mass, *np.zeros(6)])
            self._record(topics.PAYLOAD_IN_USE, arrival + 200_000, data)
        point = self._trajectory.sample(cycle * 0.004)
        stamp = now + 4 * MS
        sample = ReferenceSample(
            stamp, cycle * 0.004, point.pose.position, point.pose.quaternion, point.twist.linear,
            point.twist.angular, point.acceleration.linear, point.acceleration.angular,
        )  # fmt: skip
        arrival = now + 3 * MS + self._jitter(300)
        heard = point._replace(pose=Pose.from_quaternion(sample.position, sample.quaternion_xyzw))
        setpoint = self._feedforward.compute(arrival * 1e-9, heard, stamp)
        self._record(topics.REFERENCE, arrival, REFERENCE.encode(sample))
        data = MOTORS.encode(stamp, setpoint.angle, setpoint.speed, setpoint.torque)
        self._record(topics.SETPOINT, arrival + 200_000, data)

    def _change_model(self, now, model):
        self._feedforward.configure(FeedforwardSettings(FeedforwardModel(model)))
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=model)
        event = ParameterEvent(node="/feedforward", changed_parameters=[Parameter(name="model", value=value)])
        self._record(PARAMETER_EVENTS, now, bytes(serialize_message(event)))

    def write(self, directory, *, without=(), attach=True, since=0.0, late=(), speed=1.0):
        """Record what comes `since` a time, s; the topics of `late` from 0.6 s on."""
        files = ("control.yaml", "robot.yaml") if attach else ()
        attachments = [Attachment(f"run/config/{name}", (CONFIG / name).read_bytes()) for name in files]
        if speed != 1.0:
            control = ParameterFile.from_yaml(CONFIG / "control.yaml")
            control.slow_down(speed)
            attachments[0] = Attachment("run/config/control.yaml", control.text().encode())
        bag = BagFile(directory, {}, attachments)
        indices = {
            topic.name: bag.add_topic(RecordedTopic(topic.name, topic.type, message_definition(topic.type)))
            for topic in RECORDED
            if topic not in without
        }
        for topic, received, published, data in sorted(self.messages, key=lambda message: message[1]):
            begin = 0.6 if topic in late else since
            if topic not in without and received >= START + begin * 1e9:
                bag.add_message(indices[topic.name], received, published, data)
        bag.close()
        return directory


@pytest.fixture(scope="module")
def graph(robot):
    return Graph(robot)


@pytest.fixture(scope="module")
def bag(graph, tmp_path_factory):
    return graph.write(tmp_path_factory.mktemp("run") / "bag")


def run(*arguments):
    assert rerun.main([str(argument) for argument in arguments]) == 0
    output = Path(arguments[arguments.index("--output") + 1])
    return output, json.loads((output / "comparison.json").read_text(encoding="utf-8"))


def test_unchanged_parameters_reproduce_the_recording(bag, tmp_path, capsys):
    output, comparison = run(bag, "--output", tmp_path / "rerun")
    payload, setpoint = comparison["payload"], comparison["setpoint"]
    assert payload["recorded"] == payload["rerun"] > CYCLES - 40
    # while the estimate is held, it is that of one stamp
    assert CYCLES - 100 < payload["matched"] <= payload["recorded"]
    assert payload["mass"]["maximum"] == payload["center_of_mass"]["maximum"] == 0.0
    assert setpoint["matched"] == setpoint["recorded"] == CYCLES
    # at which of two cycles an estimate arrived, and what follows for the stretch
    assert setpoint["position"]["maximum"] < 1e-5
    assert setpoint["velocity"]["maximum"] < 1e-4
    assert setpoint["effort"]["maximum"] < 1e-3
    assert "parameters as recorded" in capsys.readouterr().out
    with Bag(output / "bag") as written, Bag(bag) as recorded:
        ours, theirs = written.joint_states("/setpoint"), recorded.joint_states("/setpoint")
        np.testing.assert_array_equal(ours.time_ns, theirs.time_ns)
        assert set(written.attachments) == {"control.yaml", "robot.yaml"}


def test_with_the_recorded_estimates_every_setpoint_is_the_same(bag, tmp_path):
    _, comparison = run(
        bag, "--nodes", "feedforward", "--payload", "/payload", "--output", tmp_path / "rerun"
    )
    assert comparison["payload"] is None
    setpoint = comparison["setpoint"]
    # an estimate that the recorder heard of late may have been counted on one cycle earlier
    assert setpoint["position"]["maximum"] < 0.01
    assert (
        setpoint["effort"]["maximum"] < 0.06
    )  # N m, of what a rate-limited estimate may change in one update


def test_the_answer_to_a_swing_is_reproduced(tmp_path):
    pytest.importorskip("mujoco")
    swinging = Scenario(
        config=CONFIG,
        devices=False,
        payload=100.0,
        added=(),
        sling=soft_sling(0.5, 0.15),
        trajectory=TrajectoryName.SMOOTH_19,
        duration=0.5,
        parameters={"feedforward": {"swing_damping": 0.35}},
    )
    run_loop(swinging, tmp_path / "bag")
    answers = {}
    for name, *given in (("as recorded",), ("left alone", "--set", "feedforward.swing_damping=0")):
        _, comparison = run(
            tmp_path / "bag",
            "--nodes",
            "feedforward",
            "--payload",
            "/payload",
            "--output",
            tmp_path / name,
            *given,
        )
        answers[name] = comparison["setpoint"]
    assert answers["as recorded"]["position"]["maximum"] < 1e-9
    assert answers["left alone"]["position"]["maximum"] > 5.0  # rad: 8 mm of cable


def test_the_same_bag_gives_the_same_bytes(bag, tmp_path):
    contents = []
    for name in ("one", "two"):
        output, _ = run(bag, "--output", tmp_path / name, "--set", "mass_estimator.time_constant=0.05")
        files = sorted(path for path in output.rglob("*") if path.is_file())
        contents.append({path.relative_to(output): path.read_bytes() for path in files})
    assert contents[0] == contents[1]
    assert any(path.suffix == ".mcap" for path in contents[0])


@pytest.mark.parametrize("time_constant", [0.1, 0.25])
def test_another_time_constant_gives_its_step_response(bag, tmp_path, time_constant):
    output, comparison = run(
        bag, "--output", tmp_path / "rerun", "--set", "mass_estimator.method=static",
        "--set", f"mass_estimator.static.time_constant={time_constant}",
        "--set", "mass_estimator.mass_rate_limit=10000",
    )  # fmt: skip
    assert comparison["parameters"]["mass_estimator.static.time_constant"] == {
        "recorded": 0.4, "rerun": time_constant,
    }  # fmt: skip
    with Bag(output / "bag") as written:
        payload = written.inertias("/payload")
    since = (payload.log_time_ns - START) * 1e-9 - STEP_AT
    after = since > 0.0
    expected = 150.0 - 100.0 * np.exp(-since[after] / time_constant)
    # the first tensions after the step count for the whole cycle before them
    np.testing.assert_allclose(payload.mass[after], expected, atol=100.0 * 0.005 / time_constant)
    settled = comparison["payload"]["rerun_quality"]["settling_time"]
    assert settled == pytest.approx(time_constant * math.log(100.0 / 3.0), abs=0.01)


def test_parameters_of_a_slowed_machine_are_given_and_shown_as_in_real_time(graph, bag, tmp_path, capsys):
    slowed = graph.write(tmp_path / "bag", speed=0.3)
    given = "--set", "feedforward.switch_slew=0.06", "--set", "mass_estimator.time_constant=0.05"
    output, comparison = run(slowed, "--output", tmp_path / "slowed", *given)
    assert comparison["parameters"]["feedforward.switch_slew"] == {"recorded": 2.0, "rerun": 0.06}
    assert "the machine ran at 0.3 of real time" in capsys.readouterr().err
    # durations of the estimator are by the stamps, which are the machine's
    by_the_clock = "--set", "feedforward.switch_slew=0.018", "--set", "mass_estimator.time_constant=0.05"
    same, _ = run(bag, "--output", tmp_path / "same", *by_the_clock)
    with Bag(output / "bag") as one, Bag(same / "bag") as other:
        np.testing.assert_array_equal(one.inertias("/payload").mass, other.inertias("/payload").mass)
        torques = (each.joint_states("/setpoint").effort for each in (one, other))
        np.testing.assert_allclose(*torques, rtol=1e-9)


def test_another_model_gives_its_torques(bag, robot, tmp_path):
    output, comparison = run(
        bag, "--output", tmp_path / "rerun", "--nodes", "feedforward", "--set", "feedforward.model=static",
        "--set", "feedforward.payload_source=nominal", "--set", "feedforward.nominal_payload_mass=20",
        "--set", "feedforward.rope_weight=false",
    )  # fmt: skip
    assert comparison["setpoint"]["effort"]["maximum"] > 0.01
    assert 0.1 < comparison["setpoint"]["position"]["maximum"] < 2.0  # of the stretch under a smaller load
    with Bag(output / "bag") as written:
        setpoints = written.joint_states("/setpoint")
    pose = paper_19(robot.trajectory_center).sample(0.4).pose
    wrench = static_wrench(robot, pose, Payload(20.0, np.zeros(3)))
    A = inverse_kinematics(robot, pose).wrench_matrix
    np.testing.assert_allclose(
        setpoints.effort[100], -robot.winch.transmission_ratio * np.linalg.pinv(A) @ wrench, atol=1e-6
    )


def test_a_parameter_that_was_changed_while_recording_changes_in_the_rerun(robot, tmp_path):
    bag = Graph(robot, model_change=(0.5, "static")).write(tmp_path / "bag")
    _, followed = run(bag, "--output", tmp_path / "followed")
    assert followed["setpoint"]["effort"]["maximum"] < 1e-3
    _, held = run(bag, "--output", tmp_path / "held", "--set", "feedforward.model=dynamic")
    assert held["setpoint"]["effort"]["maximum"] > 5e-3


def test_a_recording_that_began_late_is_reproduced_from_its_first_estimate_on(graph, tmp_path):
    bag = graph.write(tmp_path / "bag", since=0.4)
    _, comparison = run(bag, "--output", tmp_path / "rerun")
    # the filter's past is lost; the load had been steady, and the feed-forward knows of it from the first reference on
    assert comparison["payload"]["mass"]["maximum"] < 2.0
    assert comparison["setpoint"]["effort"]["maximum"] < 0.02
    assert comparison["payload"]["recorded_quality"]["final_error"] == pytest.approx(
        comparison["payload"]["rerun_quality"]["final_error"], abs=0.5
    )


def test_an_estimator_that_came_late_is_reproduced_from_its_beginning_on(robot, tmp_path):
    """As in a `control` that had to wait for the margins of its loop while the drivers were there already."""
    bag = Graph(robot, estimator_since=0.604).write(tmp_path / "bag")
    _, comparison = run(bag, "--output", tmp_path / "rerun")
    payload = comparison["payload"]
    assert 300 < payload["matched"] <= payload["recorded"] == payload["rerun"] < CYCLES - 150
    assert payload["mass"]["maximum"] < 1e-6


@pytest.mark.parametrize("late", [topics.CABLE_TENSIONS, topics.MOTOR_STATES])
def test_inputs_that_the_recorder_met_late_are_reproduced_from_there_on(graph, tmp_path, late):
    bag = graph.write(tmp_path / "bag", late=(late,))
    _, comparison = run(bag, "--output", tmp_path / "rerun")
    payload = comparison["payload"]
    assert 300 < payload["matched"] < payload["recorded"] - 100
    assert payload["mass"]["maximum"] < 2.0
    # before that it is the recorded estimates on which the set-points count
    assert comparison["setpoint"]["effort"]["maximum"] < 0.06


def test_a_bag_without_outputs_is_run_all_the_same(graph, tmp_path, capsys):
    bag = graph.write(tmp_path / "bag", without=(topics.PAYLOAD, topics.SETPOINT, topics.SIMULATED_PAYLOAD))
    _, comparison = run(bag, "--output", tmp_path / "rerun")
    assert comparison["payload"]["recorded"] == comparison["setpoint"]["recorded"] == 0
    assert comparison["payload"]["rerun"] > 90
    assert comparison["setpoint"]["rerun"] == CYCLES
    assert "estimates, 0 recorded" in capsys.readouterr().out


def test_the_default_output_lies_beside_the_bag_and_replaces_nothing(graph, tmp_path):
    bag = graph.write(tmp_path / "bag")
    for name in ("rerun", "rerun-2"):
        assert rerun.main([str(bag), "--nodes", "mass_estimator"]) == 0
        assert (tmp_path / name / "comparison.json").is_file()


@pytest.mark.parametrize("name", ["robot_config=x.yaml", "cpu=1"])
def test_a_parameter_that_a_rerun_does_not_take_is_refused(bag, tmp_path, capsys, name):
    assert rerun.main([str(bag), "--output", str(tmp_path / "out"), "--set", f"mass_estimator.{name}"]) == 1
    assert (
        f"mass_estimator takes no {name.partition('=')[0]} here; it takes method, time_constant"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--set", "mass_estimator.time_constnt=0.2"], "did you mean time_constant"),
        (
            ["--set", "mass_estimatr.time_constant=0.2"],
            "parameters of 'mass_estimatr' cannot be set here; choose from",
        ),
        (["--set", "supervisor.following_error=1.0"], "mass_estimator, feedforward"),
        (["--set", "mass_estimator.time_constant=-1"], "must lie in [0.001, 1] s"),
        (["--set", "mass_estimator.time_constant=.nan"], "must be a finite number"),
        (["--set", "mass_estimator.time_constant=quick"], "must be a finite number"),
        (["--set", "feedforward.model=wrong"], "must be one of none, static, dynamic"),
        (["--set", "mass_estimator.time_constant"], "NODE.PARAMETER=VALUE"),
        (["--nodes", "feedforward", "--set", "mass_estimator.static.max_speed=1.0"], "not among the nodes"),
    ],
)
def test_wrong_arguments_are_refused(bag, capsys, arguments, words):
    with pytest.raises(SystemExit) as end:
        rerun.main([str(bag), *arguments])
    assert end.value.code == 2
    assert words in capsys.readouterr().err


def _refused(capsys, *arguments):
    assert rerun.main([str(argument) for argument in arguments]) == 1
    error = capsys.readouterr().err
    assert error.startswith("rerun: ")
    assert error.count("\n") == 1
    return error


def test_what_cannot_be_rerun_is_said_in_one_line(graph, bag, tmp_path, capsys):
    out = ("--output", tmp_path / "out")
    assert "there is no bag" in _refused(capsys, tmp_path / "nothing", *out)
    text = tmp_path / "text.mcap"
    text.write_text("no bag", encoding="utf-8")
    assert "not an MCAP file" in _refused(capsys, text, *out)
    lacking = graph.write(tmp_path / "lacking", without=(topics.CABLE_TENSIONS,))
    assert "no topic /cable_tensions" in _refused(capsys, lacking, *out)
    bare = graph.write(tmp_path / "bare", attach=False)
    assert "holds no control.yaml" in _refused(capsys, bare, *out)
    assert "--config DIR" in _refused(capsys, bare, *out)
    assert "no topic /load" in _refused(capsys, bag, *out, "--payload", "/load")
    assert "type sensor_msgs" in _refused(capsys, bag, *out, "--payload", "/setpoint")
    existing = tmp_path / "existing"
    existing.mkdir()
    assert "exists already" in _refused(capsys, bag, "--output", existing)
    assert not (tmp_path / "out").exists()


def test_a_bag_that_was_cut_off_gives_what_it_has(graph, tmp_path, capsys):
    bag = graph.write(tmp_path / "bag")
    (file,) = bag.glob("*.mcap")
    whole = graph_length = file.stat().st_size
    with open(file, "r+b") as stream:
        stream.truncate(graph_length - 20_000)
    (bag / "metadata.yaml").unlink()
    assert whole > 40_000
    assert rerun.main([str(bag), "--output", str(tmp_path / "out")]) in (0, 1)
    lines = capsys.readouterr().err.splitlines()
    assert lines
    assert all(line.startswith("rerun: ") for line in lines)
    assert str(file) in lines[0]


def test_a_bag_without_configuration_takes_that_of_a_directory(graph, tmp_path):
    bare = graph.write(tmp_path / "bare", attach=False)
    _, comparison = run(bare, "--output", tmp_path / "out", "--config", CONFIG)
    assert comparison["setpoint"]["effort"]["maximum"] < 1e-3


def test_a_configuration_that_differs_from_the_files_here_is_mentioned(graph, tmp_path, monkeypatch, capsys):
    bag = graph.write(tmp_path / "bag")
    (tmp_path / "config").mkdir()
    control, here = tmp_path / "config" / "control.yaml", CONFIG / "control.yaml"
    monkeypatch.chdir(tmp_path)
    control.write_text(f"# another comment\n{here.read_text(encoding='utf-8')}", encoding="utf-8")
    run(tmp_path, "--output", tmp_path / "same", "--nodes", "mass_estimator")  # the directory of the run
    assert capsys.readouterr().err == ""
    control.write_text("other: 1\n", encoding="utf-8")
    run(tmp_path, "--output", tmp_path / "out", "--nodes", "mass_estimator")
    assert f"control.yaml in {bag} differs from config/control.yaml: " in capsys.readouterr().err


@pytest.mark.parametrize("type_name", DEFINITIONS)
def test_definitions_are_those_of_the_message_packages(type_name):
    ours, theirs = (
        {name: fields for name, (_, fields) in get_types_from_msg(text, type_name).items()}
        for text in (DEFINITIONS[type_name], message_definition(type_name))
    )
    assert ours == theirs
