"""Processes and the network: on which interfaces they listen, and that security is enforced or nothing runs."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

PROGRAM = """
import sys
from rclpy.node import Node
from cspr_msgs_py.runtime.process import run_nodes
sys.argv[0] = "control"
sys.exit(run_nodes(lambda: [Node("worker")]))
"""
VARIABLES = r"ROS_(AUTOMATIC|STATIC|DISCOVERY|SECURITY)|FASTRTPS"
LOOPBACK, ALL = "0100007F", "00000000"  # as the kernel writes 127.0.0.1 and 0.0.0.0
FIRST_PORT, PORTS = 7400, 250  # of domain 0, and of each domain, by the wire protocol of DDS


def start(**variables: str) -> subprocess.Popen[str]:
    """Start a node where nothing but these variables says how it joins the network."""
    rest = {name: value for name, value in os.environ.items() if not re.match(VARIABLES, name)}
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM],
        env=rest | variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


@contextmanager
def running(**variables: str) -> Iterator[tuple[int, str]]:
    """Run a node; yields its process and what it said at the start."""
    process = start(**variables)
    try:
        said = ""
        assert process.stderr is not None
        for line in process.stderr:
            said += line
            if "worker ready" in line:
                break
        assert "worker ready" in said, said
        yield process.pid, said
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)


def listened_on(pid: int) -> set[str]:
    """Return the addresses of the sockets by which DDS hears of and from others."""
    links = [Path(f"/proc/{pid}/fd/{name}").readlink() for name in os.listdir(f"/proc/{pid}/fd")]
    first = FIRST_PORT + PORTS * int(os.environ["ROS_DOMAIN_ID"])
    found = set()
    for line in Path(f"/proc/{pid}/net/udp").read_text(encoding="ascii").splitlines()[1:]:
        _, local, *_ = words = line.split()
        address, port = local.split(":")
        if Path(f"socket:[{words[9]}]") in links and first <= int(port, 16) < first + PORTS:
            found.add(address)
    return found


def test_a_process_listens_on_this_computer_alone() -> None:
    with running() as (pid, said):
        assert listened_on(pid) == {LOOPBACK}
        assert f"ROS domain {os.environ['ROS_DOMAIN_ID']}, this computer alone" in said


def test_who_asks_for_the_subnet_gets_it() -> None:
    with running(ROS_AUTOMATIC_DISCOVERY_RANGE="SUBNET") as (pid, said):
        assert listened_on(pid) == {ALL}
        assert "open beyond this computer: ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET" in said


def test_permissive_security_is_said_to_be_open() -> None:
    with running(ROS_SECURITY_ENABLE="true") as (_, said):
        assert "without ROS_SECURITY_STRATEGY=Enforce: a process without keys runs open" in said


def refusal(**variables: str) -> str:
    """Return the one line of a process that refuses to start."""
    process = start(ROS_SECURITY_ENABLE="true", **variables)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1
    (line,) = (line for line in errors.splitlines() if "[rcl]: Found security directory" not in line)
    return line


@pytest.mark.parametrize("strategy", ["Enforce", "Permissive"])
def test_keys_without_the_library_start_nothing(tmp_path: Path, strategy: str) -> None:
    keys = tmp_path / "enclaves" / "cspr" / "control"
    keys.mkdir(parents=True)
    line = refusal(ROS_SECURITY_STRATEGY=strategy, ROS_SECURITY_KEYSTORE=str(tmp_path))
    assert line.startswith(
        "control: ROS_SECURITY_ENABLE=true, but the Fast DDS of this installation is built without"
    )
    assert "nothing was started" in line


def test_enforcement_without_keys_starts_nothing(tmp_path: Path) -> None:
    assert "ROS_SECURITY_KEYSTORE names no directory of keys" in refusal(ROS_SECURITY_STRATEGY="Enforce")
    line = refusal(ROS_SECURITY_STRATEGY="Enforce", ROS_SECURITY_KEYSTORE=str(tmp_path))
    assert f"no keys for /cspr/control in {tmp_path}" in line
