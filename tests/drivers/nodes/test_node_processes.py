"""The executables as processes: how they start and end."""

import os
import signal
import subprocess
import sys
from pathlib import Path
from threading import Timer

import pytest
import yaml

ROOT = Path(__file__).parents[3]
PATIENCE = 120.0


def start(executable, can_config):
    command = f"import sys; from cspr_drivers.nodes.{executable} import main; sys.exit(main())"
    return subprocess.Popen(
        [sys.executable, "-c", command, "--ros-args", "-p", f"can_config:={can_config}"],
        cwd=ROOT,
        env=os.environ | {"PYTHONUNBUFFERED": "1"},
        stderr=subprocess.PIPE,
        text=True,
    )


@pytest.fixture
def can_config(tmp_path, mapping):
    def write(**changes):
        mapping["buses"]["main"].update(changes)
        path = tmp_path / "can.yaml"
        path.write_text(yaml.safe_dump(mapping))
        return path

    return write


def test_a_missing_interface_ends_the_process_with_one_line(can_config):
    process = start("drivers", can_config(interface="socketcan", channel="can_not_there"))
    _, errors = process.communicate(timeout=PATIENCE)
    lines = [line for line in errors.splitlines() if "[INFO]" not in line]
    assert process.returncode == 1
    assert len(lines) == 1, errors
    assert lines[0].startswith("can_drives: CAN bus main (socketcan, channel can_not_there): ")


def test_drivers_run_without_devices_and_end_on_a_signal(can_config):
    process = start("drivers", can_config())
    awaited = {"can_drives ready", "load_cells ready", "motor_1 (node 1 on main): does not answer"}
    seen = ""
    impatience = Timer(PATIENCE, process.kill)
    impatience.start()
    for line in process.stderr:  # in whichever order
        seen += line
        if all(words in seen for words in awaited):
            break
    impatience.cancel()
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=PATIENCE)
    assert all(words in seen for words in awaited), seen
    assert process.returncode == 0, seen + errors
