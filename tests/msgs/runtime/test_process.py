"""Each test runs a small program on run_nodes and looks at what it says and how it ends."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PROGRAM = """
import os, sys, time
from cspr_msgs_py.vocabulary import Level
from cspr_msgs_py.wire.samples import Status
from cspr_msgs_py.errors import NodeError, StartError
from cspr_msgs_py.parameters.row import NodeParameter
from cspr_msgs_py.runtime.parameters import declare
from cspr_msgs_py.runtime.process import *
from cspr_msgs_py.topics import MOTOR_STATES
from cspr_msgs_py.wire.joint_state import JointStateCodec
from rclpy.node import Node
from std_srvs.srv import Trigger

CASE = sys.argv.pop(1)

class Worker(Node):
    def __init__(self):
        super().__init__("worker")
        self.gain = declare(self, NodeParameter("gain", 1.0, "a gain", "N m", 0.0, 10.0, changeable=True))
        self.names = declare(self, NodeParameter("limits", [1.0], "some numbers", changeable=True))
        if CASE == "start error":
            raise StartError("robot.yaml: key mass: -1 is negative")
        if CASE == "missing file":
            open("missing.yaml")
        if CASE == "defect":
            {}["key"]
        if CASE == "slow start":
            print("starting", flush=True)
            time.sleep(60)
        self.received = 0
        self.codec = JointStateCodec(["motor_1"])
        self.publisher = advertise(self, MOTOR_STATES)
        subscribe_raw(self, MOTOR_STATES, self.receive)
        steady_timer(self, 0.005, self.publish)
        self.diagnostics = report_health(self, lambda: [Status("worker", Level.OK, "well")])
        self.create_service(Trigger, "~/ask", lambda request, response: response)
        self.client = self.create_client(Trigger, "/worker/ask")

    def publish(self):
        self.publisher.publish(self.codec.encode(time.time_ns(), [1.0], [2.0], [3.0]))

    def receive(self, data):
        assert self.codec.decode(data) is not None
        self.received += 1
        if self.received == 10:
            self.client.call_async(Trigger.Request()).add_done_callback(self.answered)
        if self.received == 200:
            print("still receiving", flush=True)
        if CASE in ("raising callback", "raising for good") and self.received == 20:
            raise ValueError("no such thing")
        if CASE == "raising part of a node" and self.received == 20:
            try:
                {}["key"]
            except KeyError as error:
                raise NodeError("controller") from error

    def answered(self, future):
        future.result()
        print("answered", flush=True)
        if CASE == "raising answer":
            raise StartError("the answer makes no sense")

    def failed(self, error):
        print("worker told", flush=True)
        if CASE == "raising for good":
            raise StartError("the robot cannot be stopped")

    def make_safe(self):
        self.publish()
        print("safe", flush=True)
        if CASE == "not safe":
            raise StartError("the brakes do not close")

class Controller(Node):
    def __init__(self):
        super().__init__("controller", **LEAN_NODE)

    def failed(self, error):
        print("controller told", flush=True)

    def make_safe(self):
        print("controller safe", flush=True)

sys.exit(run_nodes(lambda: [Worker(), Controller()]))
"""


class Program:
    def __init__(self, case: str, *arguments: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, case, *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self.lines: list[str] = []

    def wait_for(self, text: str) -> None:
        for line in self.process.stdout:
            self.lines.append(line)
            if text in line:
                return
        raise AssertionError(f"{text!r} never came: {''.join(self.lines)}")

    def end(self, *signals: int) -> tuple[int, str]:
        for number in signals:
            self.process.send_signal(number)
            time.sleep(0.01)
        try:
            rest, _ = self.process.communicate(timeout=30)
        except subprocess.TimeoutExpired:
            self.process.kill()
            raise
        return self.process.returncode, "".join(self.lines) + rest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_makes_every_node_safe_and_ends_with_status_0(number: int) -> None:
    program = Program("run")
    program.wait_for("answered")
    status, output = program.end(number)
    assert status == 0
    assert "worker ready" in output
    assert "controller ready" in output
    assert output.index("\nsafe") < output.index("controller safe")
    assert "Traceback" not in output


def test_impatience_does_not_interrupt_making_safe() -> None:
    program = Program("run")
    program.wait_for("answered")
    status, output = program.end(signal.SIGINT, signal.SIGINT, signal.SIGTERM)
    assert status == 0
    assert "controller safe" in output


SIGNALS_IN_A_METHOD_OF_THE_FUTURE = """
import os, signal, threading
from cspr_msgs_py.runtime.process import _stop_on_signal

def ignore(future):
    pass

for _ in range(30):
    with _stop_on_signal() as stop:
        stop.armed = True
        threading.Timer(0.01, os.kill, (os.getpid(), signal.SIGINT)).start()
        while not stop.future.done():
            stop.future.add_done_callback(ignore)  # holds the future's lock most of the time
            stop.future.remove_done_callback(ignore)
print("ended")
"""


def test_a_signal_that_interrupts_the_future_itself_ends_the_process() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", SIGNALS_IN_A_METHOD_OF_THE_FUTURE],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert ended.stdout == "ended\n"


def test_a_signal_during_the_start_ends_it() -> None:
    program = Program("slow start")
    program.wait_for("starting")
    assert program.end(signal.SIGINT) == (0, "starting\n")


@pytest.mark.parametrize(
    ("case", "line"),
    [
        ("start error", "worker: robot.yaml: key mass: -1 is negative\n"),
        ("missing file", "worker: [Errno 2] No such file or directory: 'missing.yaml'\n"),
    ],
)
def test_an_error_at_the_start_is_one_line(case: str, line: str) -> None:
    assert Program(case).end() == (1, line)


def test_a_defect_comes_with_its_traceback() -> None:
    status, output = Program("defect").end()
    assert status == 1
    assert "Traceback" in output
    assert output.endswith("worker: KeyError: 'key'\n")


@pytest.mark.parametrize(
    ("case", "line", "told"),
    [
        ("raising callback", "worker: ValueError: no such thing (", "worker"),
        ("raising part of a node", "controller: KeyError: 'key' (", "controller"),
        ("raising answer", "worker: StartError: the answer makes no sense (", "worker"),
    ],
)
def test_a_raising_callback_is_told_to_its_node_and_ends_nothing(case: str, line: str, told: str) -> None:
    program = Program(case)
    program.wait_for(line)
    program.wait_for(f"{told} told")
    program.wait_for("still receiving")
    status, output = program.end(signal.SIGINT)
    assert status == 0
    assert "controller safe" in output


def test_what_a_node_cannot_deal_with_ends_the_process_safely() -> None:
    status, output = Program("raising for good").end()
    assert status == 1
    assert "worker: the robot cannot be stopped\n" in output
    assert "controller safe" in output


def test_a_node_that_cannot_be_made_safe_does_not_keep_the_others_from_it() -> None:
    program = Program("not safe")
    program.wait_for("answered")
    status, output = program.end(signal.SIGTERM)
    assert status == 1
    assert "worker: the brakes do not close\n" in output
    assert "controller safe" in output


def test_a_wrong_parameter_is_one_line() -> None:
    status, output = Program("run", "--ros-args", "-p", "worker:gain:=-1.0").end()
    assert status == 1
    assert output.startswith("worker: parameter gain: ")
    assert "out of range Min: 0.0, Max: 10.0" in output
    assert output.count("\n") == 1


@pytest.mark.parametrize(
    ("given", "line"),
    [
        ("worker:gain:=[]", "worker: parameter gain is []; it must be a finite number"),
        ("worker:limits:=[]", "worker: parameter limits is []; leave it out for the default"),
        (f"worker:gain:={'x' * 3000}", f"Trying to set parameter 'gain' to '{'x' * 99}... of type 'STRING'"),
    ],
)
def test_a_value_is_repeated_as_it_was_given_and_no_longer_than_it_helps(given: str, line: str) -> None:
    status, output = Program("run", "--ros-args", "-p", given).end()
    assert status == 1
    assert line in output
    assert len(output) < 400


def test_a_parameter_file_that_is_not_there() -> None:
    status, output = Program("run", "--ros-args", "--params-file", "missing.yaml").end()
    assert status == 1
    assert "missing.yaml" in output.splitlines()[-1]
    assert "Traceback" not in output


def test_arguments_that_nobody_takes() -> None:
    status, output = Program("run", "-p", "gain:=2.0").end()
    assert status == 2
    assert "unknown arguments: -p gain:=2.0; parameters follow --ros-args" in output


def test_a_parameter_that_no_node_knows_ends_the_start(tmp_path: Path) -> None:
    status, output = Program("run", "--ros-args", "-p", "kP:=2.0").end()
    assert status == 2
    assert output == "-c: -p kP:=2.0: no node has a parameter 'kP'; did you mean kp?\n"
    file = tmp_path / "control.yaml"
    file.write_text("feedfoward:\n  ros__parameters: {model: none}\n", encoding="utf-8")
    status, output = Program("run", "--ros-args", "--params-file", str(file)).end()
    assert status == 2
    assert f"{file}, line 2: there is no node feedfoward; did you mean feedforward?" in output
    file.write_text("42", encoding="utf-8")
    status, output = Program("run", "--ros-args", "--params-file", str(file)).end()
    assert status == 2
    assert "is not a parameter file" in output


def test_the_whole_process_is_bound_to_a_cpu() -> None:
    cpu = max(os.sched_getaffinity(0))
    program = Program("run", "--ros-args", "-p", f"cpu:={cpu}")
    program.wait_for("answered")
    bound = [os.sched_getaffinity(int(t.name)) for t in Path(f"/proc/{program.process.pid}/task").iterdir()]
    status, _ = program.end(signal.SIGTERM)
    assert status == 0
    assert len(bound) > 1
    assert all(cpus == {cpu} for cpus in bound)


def test_a_cpu_that_is_not_there_is_said_and_survived() -> None:
    program = Program("run", "--ros-args", "-p", "cpu:=1023")
    program.wait_for("answered")
    status, output = program.end(signal.SIGTERM)
    assert status == 0
    assert "CPU 1023 was refused" in output


def test_priority_is_set_or_its_refusal_names_the_privilege() -> None:
    program = Program("run", "--ros-args", "-p", "realtime_priority:=10")
    program.wait_for("answered")
    policies = {
        os.sched_getscheduler(int(task.name)) for task in Path(f"/proc/{program.process.pid}/task").iterdir()
    }
    status, output = program.end(signal.SIGTERM)
    assert status == 0
    if policies != {os.SCHED_FIFO}:
        assert "CAP_SYS_NICE" in output
