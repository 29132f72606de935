"""The workspace as colcon builds it: packages recognised, every executable starts, names itself and stops."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
EXECUTABLES = {
    # executable: package, names of the nodes that say they are ready, more arguments
    "recorder": ("cspr_msgs_py", ["recorder"], ["-p", "output:=bag"]),
    "trajectory_publisher": ("cspr_control", ["trajectory_publisher"], []),
    "feedforward": ("cspr_control", ["feedforward"], []),
    "motor_controller": ("cspr_control", ["motor_controller_3"], ["-p", "motor:=3"]),
    "pose_estimator": ("cspr_control", ["pose_estimator"], []),
    "mass_estimator": ("cspr_control", ["mass_estimator"], []),
    "supervisor": ("cspr_control", ["supervisor"], []),
    "robot_markers": ("cspr_control", ["robot_markers"], []),
    "control": ("cspr_control", ["motor_controller_8", "trajectory_publisher", "supervisor"], []),
    "can_drives": ("cspr_drivers", ["can_drives"], ["-p", "can_config:=config/virtual_can.yaml"]),
    "load_cells": ("cspr_drivers", ["load_cells"], ["-p", "can_config:=config/virtual_can.yaml"]),
    "drivers": ("cspr_drivers", ["can_drives", "load_cells"], ["-p", "can_config:=config/virtual_can.yaml"]),
    "simulated_robot": ("cspr_drivers", ["simulated_robot", "can_drives", "load_cells"], []),
    "emulated_robot": ("cspr_drivers", ["simulated_robot"], ["-p", "can_config:=config/virtual_can.yaml"]),
}

PROGRAMS = {  # what ends by itself, and words that its --help must have
    "demo": (
        "--controller",
        "--exact-mass",
        "--compare",
        "--add-payload",
        "--realtime",
        "--json FILE",
        "examples:",
    ),
    "closed_loop": ("--controller", "--fault", "--bag", "--json FILE", "examples:"),
    "faults": ("--json FILE", "examples:"),
    "workspace": ("--robot", "--payload", "--json FILE", "examples:"),
    "analyze": ("BAG", "--output", "--label", "examples:"),
    "rerun": ("BAG", "--set", "--payload", "examples:"),
    "stability": ("DIR", "--latency", "--json FILE", "examples:"),
    "identify": ("BAG", "--robot", "--json FILE", "examples:"),
    "cspr": ("demo", "analyze", "commission"),
    "recover": ("--output", "examples:"),
    "replay": ("--rate", "--loop", "--start", "--topics", "examples:"),
    "security": ("--motors", "examples:"),
    "commission": ("--config", "--answers", "--torque", "examples:"),
}


def colcon(*arguments: str, cwd: Path) -> str:
    environment = {**os.environ, "PATH": f"{Path(sys.executable).parent}:{os.environ['PATH']}"}
    done = subprocess.run(
        [sys.executable, "-m", "colcon", "--log-base", str(cwd / "log"), *arguments],
        cwd=cwd, env=environment, capture_output=True, text=True, timeout=600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the sources, build them, and return the workspace."""
    path = tmp_path_factory.mktemp("workspace")
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", "build")
    shutil.copytree(ROOT / "src", path / "src", ignore=ignored)
    shutil.copytree(ROOT / "config", path / "config")
    can = (ROOT / "config" / "can.yaml").read_text(encoding="utf-8")
    (path / "config" / "virtual_can.yaml").write_text(
        can.replace("interface: socketcan", "interface: virtual"), encoding="utf-8"
    )
    colcon("build", "--base-paths", "src", cwd=path)
    # compiling the kernels takes a minute, once; what is tested below is how an installed executable starts
    subprocess.run(
        [sys.executable, "-m", "cspr_kinematics.warm_up", "config/robot.yaml"],
        cwd=path, env=environment(path), check=True, timeout=900,
    )  # fmt: skip
    return path


def test_packages_are_ament_python(workspace: Path) -> None:
    listed = {
        line.split("\t")[0]: line.split("\t")[-1] for line in colcon("list", cwd=workspace).splitlines()
    }
    assert listed == dict.fromkeys(
        ("cspr_control", "cspr_drivers", "cspr_kinematics", "cspr_msgs_py"), "(ros.ament_python)"
    )
    for package in listed:
        share = workspace / "install" / package / "share"
        assert (share / "ament_index" / "resource_index" / "packages" / package).is_file()
        assert (share / package / "package.xml").is_file()


def test_no_executable_is_forgotten(workspace: Path) -> None:
    built = {path.name for path in workspace.glob("install/*/lib/cspr_*/*") if path.is_file()}
    assert built == {*EXECUTABLES, *PROGRAMS}


def environment(workspace: Path) -> dict[str, str]:
    """Return the environment as sourcing the workspace sets it."""
    site = list(workspace.glob("install/*/lib/python3*/site-packages"))
    return {
        **os.environ,
        "PYTHONPATH": ":".join(map(str, site)),
        "AMENT_PREFIX_PATH": ":".join(str(path) for path in workspace.glob("install/cspr_*")),
        "PYTHONUNBUFFERED": "1",
    }


@pytest.mark.parametrize("name", EXECUTABLES)
def test_executable_names_itself_and_stops(workspace: Path, tmp_path: Path, name: str) -> None:
    package, nodes, arguments = EXECUTABLES[name]
    log = tmp_path / "log"
    with open(log, "wb") as file:
        process = subprocess.Popen(
            [str(workspace / "install" / package / "lib" / package / name), "--ros-args",
             "--params-file", "config/control.yaml", *arguments],
            cwd=workspace, env=environment(workspace), stdout=file, stderr=subprocess.STDOUT,
        )  # fmt: skip
    try:
        deadline = time.monotonic() + 120.0
        while not all(re.search(rf"\b{node} ready", log.read_text(encoding="utf-8")) for node in nodes):
            assert process.poll() is None, log.read_text(encoding="utf-8")
            assert time.monotonic() < deadline, log.read_text(encoding="utf-8")
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60.0) == 0, log.read_text(encoding="utf-8")
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
    assert "Traceback" not in log.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", PROGRAMS)
def test_program_teaches(workspace: Path, name: str) -> None:
    (program,) = workspace.glob(f"install/*/lib/cspr_*/{name}")
    done = subprocess.run(
        [str(program), "--help"], cwd=workspace, env=environment(workspace), capture_output=True, text=True,
        timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    for word in PROGRAMS[name]:
        assert word in done.stdout


def test_one_command_finds_every_program(workspace: Path) -> None:
    """After sourcing the workspace, ``cspr`` is on PATH and knows the programs of all packages."""
    python = Path(sys.executable).parent
    clean = {
        name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "AMENT_PREFIX_PATH")
    }

    def sourced(command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["bash", "-c", f". install/setup.bash && {command}"],
            cwd=workspace, env={**clean, "PATH": f"{python}:/usr/bin:/bin"}, capture_output=True, text=True,
            timeout=120, check=False,
        )  # fmt: skip

    assert sourced("command -v cspr").stdout.strip() == str(workspace / "install/cspr_msgs_py/bin/cspr")
    listed = sourced("cspr --help")
    assert listed.returncode == 0, listed.stderr
    for name in PROGRAMS.keys() - {"cspr"}:
        assert re.search(rf"^  {name} +\w", listed.stdout, re.MULTILINE), listed.stdout
    one = sourced("cspr analyze --help")
    assert one.returncode == 0, one.stderr
    assert "usage: cspr analyze" in one.stdout
    assert "--json FILE" in one.stdout
