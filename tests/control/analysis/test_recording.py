"""Bags into recordings: what is there, what is missing, what does not fit."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cspr_control.analysis.recording import read_recording
from cspr_control.analysis.run_analysis import RunAnalysis, analyse_bags
from cspr_control.analysis.timeline import EventKind
from cspr_control.errors import ControlError
from cspr_msgs_py.bag.bag_file import BagFile
from cspr_msgs_py.parameters.file import ParameterFile

from .conftest import CONFIG, START

ROBOT = (CONFIG / "robot.yaml").read_text(encoding="utf-8")


def test_story_of_a_run(run: RunAnalysis) -> None:
    timeline = run.recording.timeline
    assert [span.name for span in timeline.states] == ["enabled"]
    (trajectory,) = timeline.trajectories
    assert (trajectory.name, trajectory.start_ns) == ("swing", START)
    assert trajectory.end_ns == START + 4_000_000_000
    assert run.recording.origin_ns == START
    marks = [event for event in timeline.events if event.kind is EventKind.MARK]
    assert [event.text for event in marks] == ["second </script> lift"]
    assert [event.text for event in timeline.events if event.kind is EventKind.WARNING] == [
        "simulated_robot: cable_5 is slack"
    ]
    assert run.name == "pdff-mass"
    assert run.remarks == ()


def test_a_fault_is_an_event_and_ends_the_trajectory(record: Callable[..., Path]) -> None:
    timeline = read_recording(record(fault=True, duration=4.0), None, CONFIG).timeline
    (fault,) = [event for event in timeline.events if event.kind is EventKind.FAULT]
    assert fault.text == "robot fault: cable 5 is slack"
    assert timeline.trajectories[0].end_ns == pytest.approx(START + 2_520_000_000, abs=5_000_000)
    assert [span.name for span in timeline.states] == ["enabled", "fault"]


def test_a_slow_machine_has_its_own_time(record: Callable[..., Path]) -> None:
    """All of it recorded at a fifth of real time: every number and event stays where it was on the robot's clock."""
    (slow,) = analyse_bags([record(slowness=5.0, duration=4.0)], configuration_directory=CONFIG)
    mass = slow.metrics.mass
    assert mass is not None
    assert mass.changes[0].time == pytest.approx(2.0, abs=0.021)
    assert mass.settling == pytest.approx(0.25 * np.log(20.0), abs=0.041)
    (mark,) = [event for event in slow.recording.timeline.events if event.kind is EventKind.MARK]
    assert (mark.time_ns - START) * 1e-9 == pytest.approx(1.5, abs=0.005)


def test_the_directory_of_a_run_is_as_good_as_its_bag(recorded_bag: Path) -> None:
    assert read_recording(recorded_bag.parent, None, CONFIG).path == recorded_bag


@pytest.mark.parametrize(
    ("topic", "consequence"),
    [
        ("/setpoint", "no motor position and velocity errors"),
        ("/cable_tensions", "no measured tensions"),
        ("/reference", "no tensions of the model"),
        ("/true_pose", "how far the platform was from where it should be"),
        ("/simulation/payload", "the true payload is not known"),
        ("/motor_3/command", "no saturation"),
    ],
)
def test_a_missing_topic_is_named_with_its_consequence(
    record: Callable[..., Path], topic: str, consequence: str
) -> None:
    (analysis,) = analyse_bags([record(omitted=(topic,))], configuration_directory=CONFIG)
    (remark,) = analysis.remarks
    assert topic in remark
    assert consequence in remark


def test_without_motor_states_there_is_no_run(record: Callable[..., Path], tmp_path: Path) -> None:
    with pytest.raises(ControlError, match=r"no messages on /motor_states.*it has /cable_tensions, "):
        read_recording(record(omitted=("/motor_states",)))
    BagFile(tmp_path / "empty", {}).close()
    with pytest.raises(ControlError, match="it has nothing at all"):
        read_recording(tmp_path / "empty")


def test_what_is_not_a_bag(tmp_path: Path) -> None:
    with pytest.raises(ControlError, match="there is no bag"):
        read_recording(tmp_path / "nothing")
    (tmp_path / "text.mcap").write_text("hello")
    with pytest.raises(ControlError, match="not an MCAP file"):
        read_recording(tmp_path / "text.mcap")


def test_a_bag_that_was_cut_off_is_analysed_as_far_as_it_goes(
    record: Callable[..., Path], tmp_path: Path
) -> None:
    bag = record(duration=2.0, finished=False)
    (file,) = bag.glob("*.mcap")
    data = file.read_bytes()
    (tmp_path / "cut").mkdir()
    (tmp_path / "cut" / "cut_0.mcap").write_bytes(data[: len(data) - 1000])
    (analysis,) = analyse_bags([tmp_path / "cut"], configuration_directory=CONFIG)
    assert any("cut off" in remark for remark in analysis.remarks)
    position = analysis.metrics.position_error
    assert position is not None
    np.testing.assert_allclose(position.rms, np.arange(1.0, 9.0))


def test_a_bag_without_a_robot(record: Callable[..., Path], tmp_path: Path) -> None:
    bag = record(robot_text=None)
    with pytest.raises(ControlError, match=r"no robot to work with.*--robot FILE"):
        read_recording(bag, None, tmp_path)
    (remark,) = read_recording(bag, None, CONFIG).remarks
    assert "no robot.yaml attached" in remark
    assert read_recording(bag, CONFIG / "robot.yaml", tmp_path).remarks == ()


def test_a_robot_with_another_number_of_motors(record: Callable[..., Path]) -> None:
    six = CONFIG.parent / "tests" / "kinematics" / "robot" / "six_cables.yaml"
    with pytest.raises(ControlError, match=r"is of 8 motors, .*six_cables.yaml describes 6"):
        read_recording(record(), six, CONFIG)


def test_a_recorded_configuration_that_differs_from_the_one_on_disk(
    record: Callable[..., Path], tmp_path: Path
) -> None:
    disk = tmp_path / "config"
    shutil.copytree(CONFIG, disk)
    (disk / "robot.yaml").write_text(ROBOT.replace("mass: 153.0", "mass: 160.0"), encoding="utf-8")
    recording = read_recording(record(), None, disk)
    (remark,) = recording.remarks
    assert "robot.yaml" in remark
    assert "platform.mass is 153 recorded, 160 on disk; the recorded one is used" in remark
    assert recording.robot.platform.mass == 153.0
    # other comments and order are no difference
    (disk / "robot.yaml").write_text("# hello\n" + ROBOT, encoding="utf-8")
    assert read_recording(record("again"), None, disk).remarks == ()


@pytest.mark.parametrize("speed", [1.0, 0.3])
def test_a_rewritten_and_stretched_control_file_is_no_other_one(
    record: Callable[..., Path], speed: float
) -> None:
    control = ParameterFile.from_yaml(CONFIG / "control.yaml")
    if speed != 1.0:
        control.slow_down(speed)
    recording = read_recording(record(control_text=control.text()), None, CONFIG)
    assert recording.remarks == ()
    control.change("supervisor", {"max_age.motor_states": 0.9})
    (remark,) = read_recording(record("other", control_text=control.text()), None, CONFIG).remarks
    assert "supervisor.ros__parameters.max_age.motor_states is 0.9 recorded, " in remark
    assert (" as stretched for 0.3 of real time" in remark) == (speed != 1.0)
    assert "more" not in remark


def test_the_robot_file_that_the_recorded_parameters_name_is_used(record: Callable[..., Path]) -> None:
    control = "/**:\n  ros__parameters:\n    robot_config: elsewhere/robot.yaml\n"
    assert read_recording(record(control_text=control), None, CONFIG).configuration.robot_file == "robot.yaml"


def test_bags_of_two_robots_are_not_compared(record: Callable[..., Path], recorded_bag: Path) -> None:
    other = record("other", robot_text=ROBOT.replace("[2.5, -1.4, 3.0]", "[2.6, -1.4, 3.0]"))
    with pytest.raises(
        ControlError, match=r"two different robots.*exit_points\[6\]\[0\] is 2.5 first, 2.6 second"
    ):
        analyse_bags([recorded_bag, other], configuration_directory=CONFIG)


def test_bags_of_one_robot_with_another_limit_are_compared_with_a_remark(
    record: Callable[..., Path], recorded_bag: Path, tmp_path: Path
) -> None:
    other = record("other", robot_text=ROBOT.replace("tension_min: 50.0", "tension_min: 60.0"))
    first, _ = analyse_bags([recorded_bag, other], configuration_directory=tmp_path)
    assert any("tension_min is 50 first, 60 second" in remark for remark in first.remarks)


def test_runs_of_the_same_controller_are_told_apart(recorded_bag: Path, record: Callable[..., Path]) -> None:
    names = [run.name for run in analyse_bags([recorded_bag, record()], configuration_directory=CONFIG)]
    assert len(set(names)) == 2
    assert all(name.startswith("pdff-mass ") for name in names)
    with pytest.raises(ControlError, match="same label"):
        analyse_bags([recorded_bag, recorded_bag], ["a", "a"], configuration_directory=CONFIG)


def test_an_unknown_message_type_in_a_known_place(recorded_bag: Path, tmp_path: Path) -> None:
    from cspr_msgs_py.bag.metadata import RecordedTopic
    from cspr_msgs_py.message_definitions import message_definition

    bag = BagFile(tmp_path / "odd", {})
    channel = bag.add_topic(
        RecordedTopic("/motor_states", "std_msgs/msg/String", message_definition("std_msgs/msg/String"))
    )
    bag.add_message(channel, 1, 1, b"\x00\x01\x00\x00\x02\x00\x00\x00a\x00")
    bag.close()
    with pytest.raises(ControlError, match=r"/motor_states is of type std_msgs/msg/String"):
        read_recording(tmp_path / "odd", CONFIG / "robot.yaml", CONFIG)
