"""The whole graph in closed loop, end to end: the demo as a user starts it, its outcome, and how it ends."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from cspr_control.programs import rerun
from cspr_msgs_py.bag.reader import Bag

ROOT = Path(__file__).parents[2]
KEYS = {
    "controller", "exact_mass", "trajectory", "rms_position_error_deg", "max_position_error_deg",
    "mass_true_final_kg", "mass_estimate_final_kg", "mass_settling_time_s", "rate_hz", "cycles", "missed_cycles",
    "command_latency_us", "bag",
}  # fmt: skip


class Demo:
    """The demo as a child process."""

    def __init__(self, directory: Path, *arguments: str) -> None:
        self.runs = directory / "runs"
        self.output = directory / "output"
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        with open(self.output, "wb") as file:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "cspr_control.programs.demo", "--runs", str(self.runs), *arguments],
                cwd=ROOT, env=environment, stdout=file, stderr=subprocess.STDOUT,
            )  # fmt: skip

    @property
    def text(self) -> str:
        return self.output.read_text(encoding="utf-8")

    def wait_for(self, step: str, limit: float = 90.0) -> None:
        deadline = time.monotonic() + limit
        while step not in self.text:
            assert self.process.poll() is None, self.text
            assert time.monotonic() < deadline, self.text
            time.sleep(0.05)

    def end(self, limit: float = 90.0) -> int:
        return self.process.wait(timeout=limit)

    def children(self) -> dict[str, int]:
        """Process ids of the children by the name of their module."""
        listed = subprocess.run(
            ["ps", "--ppid", str(self.process.pid), "-o", "pid=,args="],
            capture_output=True,
            text=True,
            check=False,
        )
        found = {}
        for line in listed.stdout.splitlines():
            pid, _, command = line.strip().partition(" ")
            for name in ("control", "simulated_robot", "recorder"):
                if f"nodes.{name}" in command:
                    found[name] = int(pid)
        return found


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[list[Demo]]:
    """Collect demos, and end what a failed test leaves behind."""
    started: list[Demo] = []
    yield started
    for one in started:
        if one.process.poll() is None:
            one.process.send_signal(signal.SIGINT)
            try:
                one.process.wait(timeout=40.0)
            except subprocess.TimeoutExpired:
                one.process.kill()


def gone(pids: dict[str, int]) -> bool:
    return not any(Path(f"/proc/{pid}").exists() for pid in pids.values())


def test_the_robot_moves_and_is_recorded(tmp_path: Path, demo: list[Demo]) -> None:
    demo.append(Demo(tmp_path, "--trajectory", "smooth-19", "--speed", "0.8"))
    assert demo[0].end(200.0) == 0, demo[0].text
    run = demo[0].runs / "latest"
    summary = json.loads((run / "summary.json").read_text(encoding="utf-8"))
    assert summary.keys() >= KEYS
    assert summary["mass_true_final_kg"] == 200.0
    assert abs(summary["mass_estimate_final_kg"] - 200.0) < 4.0
    assert len(summary["rms_position_error_deg"]) == 8
    # 353 kg that the motors follow within 6 mm of cable even where cycles are missed; 17 degrees, half a millimetre,
    # are usual, and a loop with a wrong sign is off by metres
    assert max(summary["max_position_error_deg"]) < 200.0
    assert summary["cycles"] > 1500
    assert (run / "config" / "robot.yaml").is_file()
    assert "verdict" in demo[0].text

    bag = run / "bag"
    with Bag(bag) as reader:
        states = reader.joint_states("/motor_states")
        tensions = reader.joint_states("/cable_tensions")
    assert np.ptp(states.position, axis=0).min() > 50.0  # rad: every motor turned
    assert (np.diff(states.time_ns) > 0).all()
    assert np.median(tensions.effort) > 200.0

    with AnyReader([bag]) as reader:
        types = {connection.topic: connection.msgtype for connection in reader.connections}
        assert types["/motor_1/command"] == "sensor_msgs/msg/JointState"
        connection = next(c for c in reader.connections if c.topic == "/motor_states")
        first = next(iter(reader.messages([connection])))
        message = reader.deserialize(first[2], connection.msgtype)
    assert list(message.name) == [f"motor_{k}" for k in range(1, 9)]
    np.testing.assert_array_equal(message.position, states.position[0])

    topics = set()
    with open(next(bag.glob("*.mcap")), "rb") as file:
        for _, channel, _, decoded in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            if channel.topic not in topics:
                assert decoded is not None
                topics.add(channel.topic)
    wanted = {
        "/reference", "/setpoint", "/motor_states", "/cable_tensions", "/platform_pose", "/payload", "/robot_state",
        "/drive_states", "/trajectory_state", "/diagnostics", *(f"/motor_{k}/command" for k in range(1, 9)),
    }  # fmt: skip
    assert topics >= wanted

    # estimator and feed-forward say once more what they said, as far as the order of arrivals is known
    assert rerun.main([str(bag), "--output", str(tmp_path / "rerun")]) == 0
    again = json.loads((tmp_path / "rerun" / "comparison.json").read_text(encoding="utf-8"))
    assert again["setpoint"]["matched"] > 1500
    # the stretch follows the payload that was in use, which depends on that order: a few hundredths of a radian, and
    # for some cycles more where a busy computer held estimates up; the whole payload stretches by several
    assert again["setpoint"]["position"]["rms"] < 0.1
    assert again["setpoint"]["velocity"]["rms"] < 0.5
    assert again["payload"]["mass"]["rms"] < 2.0
    assert abs(again["payload"]["rerun_quality"]["final_error"]) < 4.0


def test_interrupted_in_motion_it_closes_brakes_and_ends_everything(tmp_path: Path, demo: list[Demo]) -> None:
    demo.append(Demo(tmp_path, "--trajectory", "smooth-18", "--speed", "0.5"))
    demo[0].wait_for("moving to the start")
    time.sleep(1.0)  # into the motion
    children = demo[0].children()
    assert set(children) == {"control", "simulated_robot", "recorder"}
    demo[0].process.send_signal(signal.SIGINT)
    assert demo[0].end(60.0) == 130
    assert gone(children)
    assert "brakes are closed" in demo[0].text
    log = (demo[0].runs / "latest" / "log" / "simulated_robot.log").read_text(encoding="utf-8")
    assert "drives disabled" in log[log.index("drives enabled") :]
    with Bag(demo[0].runs / "latest" / "bag") as bag:
        assert bag.complete
        assert bag.joint_states("/motor_states").time_ns.size > 250


def test_a_node_that_dies_ends_the_demo_with_its_name(tmp_path: Path, demo: list[Demo]) -> None:
    demo.append(Demo(tmp_path, "--speed", "0.5"))
    demo[0].wait_for("moving to the start")
    children = demo[0].children()
    os.kill(children["control"], signal.SIGKILL)
    assert demo[0].end(60.0) == 1
    assert "control ended with signal SIGKILL; its last output" in demo[0].text
    assert gone(children)
    log = (demo[0].runs / "latest" / "log" / "simulated_robot.log").read_text(encoding="utf-8")
    # nobody commands torques any more, and the robot does not hang on open brakes for that
    assert re.search(r"drives (disabled|fault)", log[log.index("drives enabled") :])
