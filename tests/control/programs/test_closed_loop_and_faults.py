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
    ],
)
def test_arguments_that_make_no_sense_are_refused(arguments, words, capsys):
    with pytest.raises(SystemExit):
        closed_loop.main(["--config", CONFIG, *arguments])
    assert words in capsys.readouterr().err.replace("\n", " ")


def test_a_configuration_that_is_not_there(capsys, tmp_path):
    assert closed_loop.main(["--config", str(tmp_path)]) == 1
    assert "robot.yaml" in capsys.readouterr().err


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
