"""The recorder under the load of the whole graph at 500 Hz: what is lost, what it costs, whether it grows.

Another process publishes the topics of the control loop (twelve of them, every cycle) and the slower ones as the
graph does; the stamps count the cycles, so that the bag shows which messages are missing.
"""

from __future__ import annotations

import argparse
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import rclpy
from rclpy.node import Node

from cspr_msgs_py.bag.reader import Bag
from cspr_msgs_py.runtime.process import LEAN_NODE, sample_publisher
from cspr_msgs_py.security.discovery import stay
from cspr_msgs_py.topics import (
    CABLE_TENSIONS,
    MOTOR_STATES,
    PAYLOAD,
    PLATFORM_POSE,
    REFERENCE,
    SETPOINT,
    SIMULATED_PAYLOAD,
    motor_command,
)
from cspr_msgs_py.wire.joint_state import JointSample, JointStateSample
from cspr_msgs_py.wire.reference import VECTORS, ReferenceSample
from cspr_msgs_py.wire.samples import InertiaSample, PoseSample

RATE = 500  # Hz
MOTORS = 8
EVERY = RATE // 50  # cycles between two messages of the topics of 50 Hz
COMMANDS = tuple(motor_command(k) for k in range(1, MOTORS + 1))
FAST = (REFERENCE, SETPOINT, MOTOR_STATES, CABLE_TENSIONS, *COMMANDS)
SLOW = (PLATFORM_POSE, PAYLOAD, SIMULATED_PAYLOAD)
SAMPLES = 5  # of the memory
LATE = 0.02  # s
TICKS = os.sysconf("SC_CLK_TCK")


def flood(cycles: int) -> None:
    """Publish this number of cycles, then print how late the worst one was."""
    rclpy.init()
    node = Node("flood", **LEAN_NODE)
    send = {topic: sample_publisher(node, topic, MOTORS) for topic in (*FAST, *SLOW)}
    vectors = {field: np.zeros(size) for field, size in VECTORS.items()}
    upright = np.array([0.0, 0.0, 0.0, 1.0])
    while not all(node.count_subscribers(topic.name) for topic in send):
        time.sleep(0.05)
    time.sleep(1.0)  # until the recorder knows the publishers as well
    print("publishing", flush=True)
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(256, 3, MOTORS))
    start = due = time.monotonic()
    latest = 0.0
    for cycle in range(cycles):
        position, velocity, effort = noise[cycle % 256] + cycle
        send[REFERENCE](ReferenceSample(cycle, cycle / RATE, **vectors))
        send[SETPOINT](JointStateSample(cycle, velocity, effort, position))
        send[MOTOR_STATES](JointStateSample(cycle, position, velocity, effort))
        send[CABLE_TENSIONS](JointStateSample(cycle, position, velocity, effort))
        for topic, torque in zip(COMMANDS, effort.tolist(), strict=True):
            send[topic](JointSample(cycle, math.nan, math.nan, torque))
        if cycle % EVERY == 0:
            send[PLATFORM_POSE](PoseSample(cycle, np.array([0.0, 0.0, 1.0]), upright))
            for topic in (PAYLOAD, SIMULATED_PAYLOAD):
                send[topic](InertiaSample(cycle, 100.0, np.zeros(3)))
        due += 1 / RATE
        delay = due - time.monotonic()
        latest = max(latest, -delay)
        if delay > 0:
            time.sleep(delay)
        elif delay < -LATE:  # as the driver does: cycles that were missed are not made up for
            due -= delay
    took = time.monotonic() - start
    print(f"{cycles / took:.1f} Hz, at most {latest * 1000:.0f} ms late", flush=True)
    time.sleep(1.0)  # what is on its way arrives while its publisher is there
    rclpy.try_shutdown()


def processor_time(pid: int) -> float:
    """Seconds of CPU that a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def memory(pid: int) -> float:
    """Resident memory of a process, MB."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(float(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS"))


@contextmanager
def running(*arguments: str, ready: str) -> Iterator[subprocess.Popen[str]]:
    """Start a Python process and wait for a word in its output; it is stopped at the end."""
    process = subprocess.Popen(
        [sys.executable, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if ready in line:
                break
        else:
            raise RuntimeError(f"{' '.join(arguments)} ended early")
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
            process.wait(timeout=60)


def lost(bag: Path, cycles: int) -> dict[str, int]:
    """Return the number of messages of each topic that are not in the bag."""
    expected = dict.fromkeys(FAST, cycles) | dict.fromkeys(SLOW, -(-cycles // EVERY))
    with Bag(bag) as read:
        return {topic.name: number - read.counts.get(topic.name, 0) for topic, number in expected.items()}


def measure(minutes: float) -> None:
    """Record for this long and print what it cost."""
    cycles = round(minutes * 60 * RATE)
    with tempfile.TemporaryDirectory() as directory:
        bag = Path(directory) / "bag"
        recorder_arguments = ["-m", "cspr_msgs_py.nodes.recorder", "--ros-args", "-p", f"output:={bag}"]
        with (
            running(*recorder_arguments, ready="recorder ready") as recorder,
            running("-m", "benchmarks.recorder", "--flood", str(cycles), ready="publishing") as source,
        ):
            time.sleep(3.0)  # the first chunks, and with them the buffers
            first_cpu, first = processor_time(recorder.pid), time.monotonic()
            memories = [memory(recorder.pid)]
            for sample in range(1, SAMPLES + 1):
                time.sleep(max(first + (minutes * 60 - 5.0) * sample / SAMPLES - time.monotonic(), 0.0))
                memories.append(memory(recorder.pid))
            cpu, span = processor_time(recorder.pid) - first_cpu, time.monotonic() - first
            assert source.stdout is not None
            published = source.stdout.readline().strip()
        missing = lost(bag, cycles)
        size = sum(file.stat().st_size for file in bag.glob("*.mcap"))
        with Bag(bag) as read:
            total = sum(read.counts.values())
    print(
        f"{minutes * 60:.0f} s of {len(missing)} topics, {total} messages, {total / (minutes * 60):.0f}/s, {published}"
    )
    print(f"{'lost':24}{sum(missing.values()):>12}")
    for topic, number in missing.items():
        if number:
            print(f"  {topic:22}{number:>12}")
    print(f"{'CPU of the recorder':24}{cpu / span:>12.1%} of one core")
    print(f"{'memory on the way':24}    {' '.join(f'{each:.1f}' for each in memories)} MB")
    print(f"{'size':24}{size / 1e6:>12.1f} MB, {size / max(total, 1):.0f} bytes per message")


def main(arguments: Sequence[str] = ()) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.recorder", description=__doc__)
    parser.add_argument("--minutes", type=float, default=0.25, help="default: %(default)s")
    parser.add_argument("--flood", type=int, metavar="CYCLES", help="be the process that publishes")
    chosen = parser.parse_args(arguments)
    stay(os.environ)
    os.environ.setdefault("ROS_DOMAIN_ID", "89")
    if chosen.flood is not None:
        flood(chosen.flood)
    else:
        measure(chosen.minutes)


if __name__ == "__main__":
    main(sys.argv[1:])
