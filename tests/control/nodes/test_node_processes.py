"""The executables as processes: what they print, how they end."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
PATIENCE = 120.0


def start(executable, *parameters):
    module, _, function = executable.partition(":")
    command = (
        f"import sys; from cspr_control.nodes.{module} import {function or 'main'} as main; sys.exit(main())"
    )
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    arguments = ["--ros-args", *parameters] if parameters else []
    return subprocess.Popen(
        [sys.executable, "-c", command, *arguments],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def finish(process):
    try:
        return process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        raise


@pytest.mark.parametrize(
    ("executable", "parameters", "last_name"),
    [
        ("motor_controller", ("-p", "motor:=3"), "motor_controller_3"),
        ("control", ("--params-file", "config/control.yaml"), "supervisor"),
    ],
)
def test_a_process_says_its_name_and_ends_on_a_signal(executable, parameters, last_name):
    process = start(executable, *parameters)
    seen = ""
    for line in process.stderr:
        seen += line
        if f"{last_name} ready" in line:
            break
    process.send_signal(signal.SIGINT)
    _, errors = finish(process)
    assert f"{last_name} ready" in seen
    assert process.returncode == 0, seen + errors


def test_what_cannot_start_says_why_in_one_line():
    processes = {
        "name the robot's file with -p robot_config:=PATH": start(
            "control_nodes:feedforward", "-p", "robot_config:=no.yaml"
        ),
        "motor: 9": start("motor_controller", "-p", "motor:=9"),
        "nominal_payload_mass": start("control_nodes:feedforward", "-p", "nominal_payload_mass:=-5.0"),
    }
    for complaint, process in processes.items():
        _, errors = finish(process)
        assert process.returncode == 1
        assert len(errors.splitlines()) == 1, errors
        assert complaint in errors
