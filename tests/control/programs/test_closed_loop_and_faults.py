"""The programs closed_loop and faults."""

import json
from pathlib import Path

import pytest

pytest.importorskip("mujoco")

from cspr_control.programs import closed_loop, faults
from cspr_msgs_py.bag.reader import Bag

CONFIG = str(Path(__file__).parents[3] / "config")


def test_a_scenario_from_the_command_line(tmp_path, capsys):
    bag, numbers = tmp_path / "bag", tmp_path / "summary.json"
    arguments = [
        "--config", CONFIG, "--controller", "pdff", "--exact-mass", "--trajectory", "smooth-19", "--duration", "1",
        "--payload", "50", "--add-payload", "25@0.5", "--set", "motor_control_gains.kp=3", "--seed", "7",
        "--bag", str(bag), "--json", str(numbers),
    ]  # fmt: skip
    assert closed_loop.main(arguments) == 0
    said = json.loads(numbers.read_text(encoding="utf-8"))
    assert (said["controller"], said["exact_mass"], said["trajectory"]) == ("pdff", True, "smooth-19")
    assert (said["mass_true_final_kg"], said["missed_cycles"], said["bag"]) == (75.0, 0, str(bag))
    out = capsys.readouterr().out
    assert "pdff (exact mass) on smooth-19" in out
    assert "times real time" in out
    with Bag(bag) as reader:
        control = next(data for name, data in reader.attachments.items() if name.endswith("control.yaml"))
        assert b"kp: 3" in control
        assert {"/motor_states", "/setpoint", "/robot_state", "/drive_states", "/diagnostics"} <= set(
            reader.counts
        )


def test_what_stopped_the_robot_is_said(capsys):
    assert (
        closed_loop.main(["--config", CONFIG, "--duration", "1", "--fault", "drive_silent motor_3@0.2"]) == 0
    )
    assert "stopped               drive fault: motor_3: silent" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--fault", "drive_silent motor_3"], "FAULT PLACE@S"),
        (["--fault", "bus_cut main@1", "--plant"], "needs devices"),
        (["--set", "feedforward.modle=static"], "did you mean model"),
        (["--set", "kp"], "NODE.NAME=VALUE"),
        (["--payload", "-3"], "not a mass"),
        (["--duration", "soon"], "not a time"),
        (["--seed", "-1"], "not a whole number"),
        (["--controller", "pid"], "(choose from 'pd', 'static'"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(arguments, words, capsys):
    with pytest.raises(SystemExit):
        closed_loop.main(["--config", CONFIG, *arguments])
    assert words in capsys.readouterr().err.replace("\n", " ")


def test_a_fault_after_the_trajectory_is_refused(capsys):
    assert closed_loop.main(["--config", CONFIG, "--duration", "1", "--fault", "bus_cut main@30"]) == 1
    assert "would come too late: the trajectory is over after 1 s" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("motor_controller_3.kp=4", "motor_controller_3 takes no kp here; motor_control_gains does"),
        ("recorder.nice=3", "recorder is not here; the nodes here are motor_control_gains, "),
        (
            "supervisor.robot_config=x",
            "is x, of motor_control_gains config/robot.yaml; it must be the same for all",
        ),
        ("/**.control_rate=500", "control_rate is 500 Hz, but "),
    ],
)
def test_a_parameter_that_nothing_takes_is_refused(given, words, capsys):
    assert closed_loop.main(["--config", CONFIG, "--set", given]) == 1
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("program", [closed_loop, faults])
def test_a_configuration_that_is_not_there(program, capsys, tmp_path):
    with pytest.raises(SystemExit):
        program.main(["--config", str(tmp_path)])
    assert "robot.yaml is not there" in capsys.readouterr().err


def test_the_table_of_faults(tmp_path, capsys):
    numbers = tmp_path / "faults.json"
    assert faults.main(["--config", CONFIG, "emergency stop", "--json", str(numbers)]) == 0
    row = capsys.readouterr().out.splitlines()[-1]
    assert row.startswith("| emergency stop | drive fault: emergency stop: input of motor_1 | quick stop | ")
    (said,) = json.loads(numbers.read_text(encoding="utf-8"))
    assert said["fault"] == "emergency stop"
    assert 0.0 < said["held"]["duration"] < said["moving"]["duration"] < 0.3


def test_a_fault_that_is_not_known(capsys):
    with pytest.raises(SystemExit):
        faults.main(["sabotage"])
    assert "there is no fault 'sabotage'" in capsys.readouterr().err
