"""Parameter files and command lines without ROS."""

import pytest
import yaml

from cspr_msgs_py.errors import ParameterError
from cspr_msgs_py.parameters.file import ParameterFile, check_arguments

TEXT = """
/**:
  ros__parameters: {kp: 2.0, max_payload: 300.0}
/mass_estimator:
  ros__parameters: {max_payload: 250.0, time_constant: 0.3}
supervisor:
  ros__parameters:
    max_age: {setpoint: 0.2}
rviz:
  ros__parameters: {anything: [1, 2]}
"""


def test_what_is_said_of_a_node_beats_what_is_said_of_all():
    file = ParameterFile(TEXT, "control.yaml")
    assert file.of("mass_estimator") == {"kp": 2.0, "max_payload": 250.0, "time_constant": 0.3}
    assert file.of("feedforward") == {"kp": 2.0, "max_payload": 300.0}
    assert file.of("supervisor")["max_age.setpoint"] == 0.2
    assert file.values("mass_estimator")["pose_timeout"] == 0.2  # the default
    assert "kp" not in file.values("mass_estimator")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [", "not YAML"),
        ("", "maps no names"),
        ("42", "maps no names"),
        ("node: {kp: 1.0}", "node has no ros__parameters"),
        ("node: {ros__parameters: 3}", "node has no ros__parameters"),
        ("/**:\n  ros__parameters: {kP: 1.0}", "line 2: no node has a parameter 'kP'; did you mean kp"),
        (
            "trajectory_publisher:\n  ros__parameters:\n    speeed: 1.0",
            "line 3: trajectory_publisher has no parameter 'speeed'; did you mean speed",
        ),
        ("supervisor:\n  ros__parameters:\n    max_age: {setpont: 1.0}", r"did you mean max_age\.setpoint"),
        ("feedforward: {ros__parameters: {pose_timeout: 1.0}}", "mass_estimator has pose_timeout"),
        ("feedforward: {ros__parameters: {zzz: 1.0}}", "it has robot_config, model, payload_source"),
        ("robot/feedfoward: {ros__parameters: {}}", None),
        ("feedfoward: {ros__parameters: {model: none}}", "no node feedfoward; did you mean feedforward"),
        ("motor_controller_3: {ros__parameters: {motor: 3}}", "motor_controller_3 has no parameter 'motor'"),
        (
            "feedforward: {ros__parameters: {model: none, model: static}}",
            r'duplicate key "model" with value "static" \(original value: "none"\) \(line 1\)',
        ),
        ("a: {ros__parameters: {}}\nb: {}\na: {}", r'duplicate key "a" .*line 3'),
    ],
)
def test_what_is_no_parameter_file_is_refused_by_name(text, words):
    if words is None:
        ParameterFile(text, "odd.yaml")
        return
    with pytest.raises(ParameterError, match=words) as error:
        ParameterFile(text, "odd.yaml")
    assert "odd.yaml" in str(error.value)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(ParameterError, match=r"none\.yaml"):
        ParameterFile.from_yaml(tmp_path / "none.yaml")


def test_what_depends_on_the_computers_clock_is_stretched():
    file = ParameterFile(TEXT, "control.yaml")
    file.change("feedforward", {"model": "static"})
    file.slow_down(0.25)
    slow = ParameterFile(file.text(), "slow.yaml")
    assert slow.of("mass_estimator")["time_constant"] == 1.2
    assert slow.values("mass_estimator")["center_rate_limit"] == 0.25 * 0.2
    assert slow.values("supervisor")["max_age.setpoint"] == 0.8
    assert slow.values("motor_controller_3")["setpoint_timeout"] == 0.4
    assert slow.values("trajectory_publisher")["max_gap"] == 0.4
    assert slow.values("trajectory_publisher")["dwell"] == 1.0  # counts on the machine's clock
    assert slow.values("feedforward")["model"] == "static"
    assert yaml.safe_load(file.text())["supervisor"]["ros__parameters"]["max_age"]["setpoint"] == 0.8


def test_a_change_must_fit():
    file = ParameterFile(TEXT.replace("0.3}", "3e-1}"), "control.yaml")
    assert file.values("mass_estimator")["time_constant"] == 0.3
    with pytest.raises(ParameterError, match="stuck_time is 'long'"):
        file.change("supervisor", {"stuck_time": "long"})
    with pytest.raises(ParameterError, match="did you mean stuck_time"):
        file.change("supervisor", {"stuck_tim": 1.0})


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-p", "kP:=3.0"], "-p kP:=3.0: no node has a parameter 'kP'; did you mean kp"),
        (["--param", "feedforward:modl:=none"], "feedforward has no parameter 'modl'; did you mean model"),
        (["-p", "/ns/feedforward:modl:=none"], "did you mean model"),
        (["-p", "supervisr:stuck_time:=1.0"], "no node supervisr; did you mean supervisor"),
        (["-p", "motor:=3", "-p", "motor_controller_12:kp:=1.0", "-p", "use_sim_time:=true"], None),
        (["-p", "qos_overrides./tf.publisher.depth:=1", "-p", "rviz:zzz:=1", "-r", "a:=b"], None),
    ],
)
def test_a_command_line_with_an_unknown_parameter_is_refused(arguments, words):
    if words is None:
        check_arguments(["program", "--ros-args", *arguments])
        return
    with pytest.raises(ParameterError, match=words):
        check_arguments(["program", "--ros-args", *arguments])
