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
    assert file.values("mass_estimator")["input_timeout"] == 0.1  # the default
    assert "kp" not in file.values("mass_estimator")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [", "not YAML"),
        ("", "maps no names"),
        ("42", "maps no names"),
        ("node: {kp: 1.0}", "line 1: node/kp is 1.0; parameters stand under their node, as in "),
        ("node: {ros__parameters: 3}", "line 1: node/ros__parameters is 3; parameters stand under"),
        ("/**: 5", r"line 1: /\*\* is 5; parameters stand under their node"),
        ("/**:", r"line 1: /\*\* is empty; parameters stand under their node"),
        (
            "ros__parameters: {kp: 1.0}",
            "line 1: ros__parameters is a list or mapping; parameters stand under their node",
        ),
        ("x: {ros__parameters: {a: 1, b: {}}}", r"line 1: x: b is empty; give it a value, or leave it out"),
        ("x: {ros__parameters: {a: {b: {}}}}", r"line 1: x: a.b is empty; give it a value"),
        ("x: {ros__parameters: {a: []}}", r"line 1: x: a is empty; give it a value"),
        ("x: {ros__parameters: {a: }}", "line 1: x: a is empty; give it a value"),
        (
            "recorder: {ros__parameters: {split_size: 5}}",
            "recorder: split_size is 5; .* finite number; write 5.0",
        ),
        (
            "trajectory_publisher: {ros__parameters: {move_position: [1, 2.5, 0]}}",
            r"move_position is \[1, 2.5, 0\]; it must be a list of finite numbers; write \[1.0, 2.5, 0.0\]",
        ),
        (
            "supervisor: {ros__parameters: {stuck_time: 12:30:00}}",
            "stuck_time is '12:30:00'; it must be a finite",
        ),
        ("supervisor: {ros__parameters: {stuck_time: 1_000}}", "stuck_time is '1_000'; it must be a finite"),
        (
            "supervisor: {ros__parameters: {stuck_time: 123456.789012}}",
            r"stuck_time is 123457; .* \[0, 1000\] s",
        ),
        ("/**:\n  ros__parameters: {kP: 1.0}", "line 2: no node has a parameter 'kP'; did you mean kp"),
        (
            "trajectory_publisher:\n  ros__parameters:\n    speeed: 1.0",
            "line 3: trajectory_publisher has no parameter 'speeed'; did you mean speed",
        ),
        ("supervisor:\n  ros__parameters:\n    max_age: {setpont: 1.0}", r"did you mean max_age\.setpoint"),
        ("feedforward: {ros__parameters: {slack_hold: 1.0}}", "mass_estimator has slack_hold"),
        (
            "feedforward: {ros__parameters: {zzz: 1.0}}",
            "it has robot_config, model, winch_inertia, payload_source",
        ),
        ("robot/feedfoward: {ros__parameters: {}}", None),
        ("feedfoward: {ros__parameters: {model: none}}", "no node feedfoward; did you mean feedforward"),
        ("motor_controller_3: {ros__parameters: {motor: 3}}", "motor_controller_3 has no parameter 'motor'"),
        (
            "feedforward: {ros__parameters: {model: none, model: static}}",
            r'duplicate key "model" with value "static" \(original value: "none"\) \(line 1\)',
        ),
        ("a: {ros__parameters: {}}\nb: {}\na: {}", r'duplicate key "a" .*line 3'),
        ("? [a]\n: {ros__parameters: {b: 1}}", "a key that is no text .*line 1"),
        (
            "recorder: {ros__parameters: {split_size: 5.0}}\n/**: {ros__parameters: {split_size: 6.0}}",
            r"line 2: split_size is given to all nodes, .* of recorder in line 1: put /\*\* first",
        ),
        ("rviz: {ros__parameters: {rate: 5.0}}\n/**: {ros__parameters: {control_rate: 250.0}}", None),
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
    assert slow.of("mass_estimator")["time_constant"] == 0.3  # counts on the machine's clock
    assert slow.values("mass_estimator")["input_timeout"] == 0.4
    assert slow.values("feedforward")["switch_slew"] == 0.25 * 2.0
    assert slow.values("supervisor")["max_age.setpoint"] == 0.8
    assert slow.values("supervisor")["allowed_drop"] == 16.0 * 0.02  # what falls for four times as long
    assert slow.values("motor_controller_3")["setpoint_timeout"] == 0.4
    assert slow.values("trajectory_publisher")["max_gap"] == 0.4
    assert slow.values("trajectory_publisher")["dwell"] == 1.0  # counts on the machine's clock
    assert slow.values("feedforward")["model"] == "static"
    assert yaml.safe_load(file.text())["supervisor"]["ros__parameters"]["max_age.setpoint"] == 0.8


def test_a_default_is_stretched_for_its_node_alone():
    """The supervisor's `stuck_time` counts on the computer's clock, that of `mass_estimator` on the machine's."""
    file = ParameterFile("supervisor: {ros__parameters: {}}", "mine.yaml")
    before = file.values("mass_estimator")
    file.slow_down(0.25)
    assert file.values("supervisor")["stuck_time"] == 4.0
    assert file.values("mass_estimator") == before | {"input_timeout": 0.4}


def test_a_stretched_default_does_not_replace_the_value_of_a_node():
    """As ROS reads the text: what stands in it last counts."""
    file = ParameterFile("motor_controller_3: {ros__parameters: {setpoint_timeout: 0.05}}", "mine.yaml")
    file.slow_down(0.1)
    everywhere, *_ = yaml.safe_load(file.text())
    assert everywhere == "/**"
    assert file.values("motor_controller_3")["setpoint_timeout"] == 0.5


def test_a_change_must_fit():
    file = ParameterFile(TEXT.replace("0.3}", "3e-1}"), "control.yaml")
    assert file.values("mass_estimator")["time_constant"] == 0.3
    with pytest.raises(ParameterError, match="stuck_time is 'long'"):
        file.change("supervisor", {"stuck_time": "long"})
    with pytest.raises(ParameterError, match="did you mean stuck_time"):
        file.change("supervisor", {"stuck_tim": 1.0})


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("pose", "pose_estimator"),
        ("mass", "mass_estimator"),
        ("payload_estimator", "mass_estimator"),
        ("trajectory", "trajectory_publisher"),
        ("motor_gains", "motor_control_gains"),
        ("gains", "motor_control_gains"),
        ("controller", "motor_controller_1"),
        ("control", "motor_controller_1"),
        ("motor_controler_3", "motor_controller_3"),
        ("motor_controller_0", "motor_controller_1"),
        ("motor_controller_K", "motor_controller_1"),
        ("motor_5", "motor_controller_5"),
        ("drives", "can_drives"),
        ("drivers", "can_drives"),
        ("simulated", "simulated_robot"),
        ("emulated_robot", "simulated_robot"),
        ("feed_forward_control", "feedforward"),
        ("candrives", "can_drives"),
        ("Recorder", "recorder"),
    ],
)
def test_a_node_that_is_almost_one_of_ours_is_refused_with_the_one_that_was_meant(name, meant):
    with pytest.raises(ParameterError, match=rf"there is no node {name}; did you mean {meant}\?"):
        ParameterFile(f"{name}: {{ros__parameters: {{kp: 2.0}}}}", "odd.yaml")


@pytest.mark.parametrize(
    "name",
    [
        "rviz",
        "rviz2",
        "joy",
        "joy_node",
        "camera_driver",
        "foxglove_bridge",
        "robot_state_publisher",
        "controller_manager",
        "imu_driver",
        "joint_trajectory_controller",
        "rosbag2_recorder",
        "usb_cam",
        "robot_localization",
        "static_transform_publisher",
    ],
)
def test_a_node_with_a_word_of_its_own_is_none_of_our_business(name):
    assert ParameterFile(f"{name}: {{ros__parameters: {{kp: 2}}}}", "odd.yaml").of(name) == {"kp": 2}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-p", "kP:=3.0"], "-p kP:=3.0: no node has a parameter 'kP'; did you mean kp"),
        (["--param", "feedforward:modl:=none"], "feedforward has no parameter 'modl'; did you mean model"),
        (["-p", "/ns/feedforward:modl:=none"], "did you mean model"),
        (
            ["-p", "motor_controler_3:kp:=1.0"],
            r"no node motor_controler_3; did you mean motor_controller_3\?",
        ),
        (["-p", "motor_controller_0:kp:=1.0"], "no node motor_controller_0; did you mean motor_controller_1"),
        (["-r", "__node:=x"], "-r __node:=x: other nodes find this one by its name"),
        (["--remap", "feedforward:__node:=x"], "--remap feedforward:__node:=x: other nodes find"),
        (["--remap", "__name:=x"], "--remap __name:=x: other nodes find"),
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
