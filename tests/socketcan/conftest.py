"""The drivers and the emulated robot as two processes on the kernel's CAN, vcan0 and vcan1.

One pair of processes serves all tests of a module, at the PACE (rate, speed) of the module if it has one; each test
begins with the drives disabled, after a fault reset by the operator where the one before has left a fault. What is on
the wire is what candump says.
"""

import contextlib
import copy
import itertools
import os
import re
import shutil
import signal
import socket
import statistics
import struct
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
import rclpy
import yaml
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger
from tests.messages import from_diagnostic_array

from cspr_msgs_py.runtime.process import advertise, subscribe, subscribe_raw
from cspr_msgs_py.topics import (
    CABLE_TENSIONS,
    DIAGNOSTICS,
    DRIVE_STATES,
    LOAD_CELL_STATES,
    MOTOR_STATES,
    SETPOINT,
    SUPERVISOR_ALIVE,
    cable_names,
    motor_command,
    motor_names,
)
from cspr_msgs_py.wire.joint_state import JointStateCodec
from cspr_msgs_py.wire.samples import SignOfLife
from cspr_msgs_py.wire.topic_codecs import topic_codec

ROOT = Path(__file__).parents[2]
CHANNELS = ("vcan0", "vcan1")
MOTORS = 8
PATIENCE = 300.0  # s; a generous limit for what takes seconds on a quiet machine

WATCHDOGS = {  # s of the computer
    "command": 2.5,  # below rpdo, so that the driver names the cause before the drives act
    "feedback": 2.25,  # below command: without states there are no commands, and silence is the cause
    "supervisor": 3.0,
    "rpdo": 4.0,
    "heartbeat_producer": 1.5,
    "heartbeat_consumer": 4.5,
}
PROCEDURES = {"sdo": 5.0, "transition": 5.0, "enable": 15.0, "stop": 10.0}  # s of the machine


@dataclass(frozen=True)
class Pace:
    """One virtual CPU of a slow and busy machine runs drivers, devices, plant and test.

    So there is a slower cycle, watchdogs to match, and all of it in slow motion, so that nobody who has to wait for the
    CPU for a second is taken for dead.
    """

    rate: float  # cycles in a second of the machine, Hz
    speed: float  # seconds of the machine in a second of the computer

    @property
    def timeouts(self):
        """Of can.yaml, s of the machine."""
        return {name: value * self.speed for name, value in WATCHDOGS.items()} | PROCEDURES


USUAL_PACE = Pace(25.0, 0.2)  # the rate of a real machine is ten times as high

KP, KD = 0.3, 0.03  # N m/rad and N m s/rad of the probe that plays the motor controllers


def pytest_collection_modifyitems(items):
    """Skip, and say what is missing, on a machine without these interfaces."""
    if lack := _lack():
        for item in items:
            if Path(__file__).parent in item.path.parents:
                item.add_marker(pytest.mark.skip(reason=lack))


def _lack():
    missing = [name for name in CHANNELS if not Path("/sys/class/net", name).exists()]
    if missing:
        return f"no CAN interface {' and '.join(missing)}: `make test-socketcan` makes them, or says what is missing"
    if shutil.which("candump") is None:
        return "no candump: `apt install can-utils`"
    if os.geteuid() != 0:
        return "the tests take interfaces down: root is needed"
    return ""


@dataclass(frozen=True)
class Frame:
    """One line of `candump -L`."""

    time: float  # s
    channel: str
    identifier: int
    data: bytes


_LINE = re.compile(r"\(([\d.]+)\) (\w+) ([0-9A-F]+)#([0-9A-F]*)")


class Candump:
    """can-utils' candump, as a witness that shares no code with either end.

    It listens on any interface: bound to one, it would hear nothing any more of one that was removed and made again.
    """

    def __init__(self, path):
        self._path = path
        self._file = path.open("w")
        self._process = subprocess.Popen(["candump", "-L", "any"], stdout=self._file)

    def frames(self, since=0.0):
        """Return the frames that were on the wire from a moment (s of the system clock) until now.

        The witness waits for the CPU too: it has written all of them when it has written a later one, and one of the
        SYNCs and heartbeats is never far.
        """
        now, written = time.time(), []

        def caught_up():
            written[:] = self._path.read_text().splitlines()
            newest = next(filter(None, map(_LINE.fullmatch, reversed(written))), None)
            return newest is not None and float(newest[1]) >= now

        wait_for(caught_up, "candump sees no frames any more")
        found = [match for match in map(_LINE.fullmatch, written) if match]
        frames = [Frame(float(f[1]), f[2], int(f[3], 16), bytes.fromhex(f[4])) for f in found]
        return [frame for frame in frames if frame.time >= since]

    def close(self):
        self._process.terminate()
        self._process.wait(10.0)
        self._file.close()


# Real drives have no slow motion, so the executable has no parameter for it.
SLOW_DRIVERS = """
import sys
from cspr_drivers.clock import SlowClock
from cspr_drivers.nodes.driver_node import SWITCH_INTERVAL
from cspr_drivers.nodes.drivers import create_nodes
from cspr_msgs_py.runtime.process import run_nodes
sys.setswitchinterval(SWITCH_INTERVAL)
sys.exit(run_nodes(lambda: create_nodes(SlowClock({speed}))))
"""


class Process:
    """One executable of the product, by its module or with code that runs it, its log in a file."""

    def __init__(self, name, module, arguments, directory, ros=True, code=None):
        self.name = name
        self.log = directory / f"{name}.log"
        with self.log.open("w") as log:
            self._process = subprocess.Popen(
                [
                    sys.executable,
                    *(["-m", module] if code is None else ["-c", code]),
                    *(["--ros-args"] if ros else []),
                    *map(str, arguments),
                ],
                cwd=ROOT,
                env=os.environ | {"PYTHONUNBUFFERED": "1"},
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    @property
    def running(self):
        return self._process.poll() is None

    def wait_until_ready(self):
        """Wait for the line that every executable writes when it has started."""
        wait_for(
            lambda: " ready\n" in self.log.read_text() or not self.running,
            lambda: f"{self.name} does not start: {self.log.read_text()}",
        )
        assert self.running, self.log.read_text()

    def send(self, number):
        self._process.send_signal(number)

    def wait(self):
        return self._process.wait(PATIENCE)

    def end(self):
        if self.running:
            self._process.send_signal(signal.SIGCONT)
            self._process.terminate()
            try:
                self._process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()


class Probe:
    """Plays the motor controllers: a torque that holds the platform for every state, and the operator's services."""

    def __init__(self):
        self._context = Context()
        rclpy.init(args=[], context=self._context)
        self.node = Node("probe", context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._lock = threading.Lock()
        self.answers = True
        self.foreign = set()  # motors, from 1, that have a controller of their own
        self.override = None  # torque, N m, that motor 3 is commanded instead
        self.state = None
        self.states = 0  # how many there have been
        self.tensions = None
        self.drives = {}
        self.health = {}
        self.load_cells = "unknown"  # what is wrong with them; empty when all is well
        self._anchor = None
        self._holding = None
        names = motor_names(MOTORS)
        self._states = JointStateCodec(names)
        self._sign_of_life = topic_codec(SUPERVISOR_ALIVE, MOTORS).encode
        self._cells = JointStateCodec(cable_names(MOTORS), position=False, velocity=False)
        self._codecs = [JointStateCodec((name,), position=False, velocity=False) for name in names]
        self._control = threading.Lock()  # over the publishers
        self.lead()
        subscribe_raw(self.node, MOTOR_STATES, self._answer)
        subscribe_raw(self.node, CABLE_TENSIONS, self._measured)
        subscribe(self.node, DRIVE_STATES, self._note_drives)
        subscribe(self.node, DIAGNOSTICS, self._note_health)
        subscribe(self.node, LOAD_CELL_STATES, self._note_cells)
        self._clients = {}
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def lead(self):
        """Publish in place of controllers and supervisor, until they are to do so themselves: `leave`."""
        self._setpoints = advertise(self.node, SETPOINT)
        self._alive = advertise(self.node, SUPERVISOR_ALIVE)
        self._commands = [advertise(self.node, motor_command(k)) for k in range(1, MOTORS + 1)]
        self._leads = True

    def leave(self):
        """Leave all topics to their own publishers: a second one stops the robot."""
        with self._control:
            self._leads = False
        for publisher in (self._setpoints, self._alive, *self._commands):
            self.node.destroy_publisher(publisher)

    def _spin(self):
        while not self._stopping.is_set():
            self._executor.spin_once(timeout_sec=0.2)

    def _answer(self, buffer):
        state = self._states.decode(buffer)
        self.state = state
        self.states += 1
        with self._control:
            if self._leads:
                self._alive.publish(self._sign_of_life(SignOfLife(state.stamp_ns)))
                if self.answers and self.tensions is not None:
                    self._command(state)

    def _command(self, state):
        if self._anchor is None:
            self._anchor = state.position.copy()
            self._holding = -0.05 / 30.0 * self.tensions  # drum radius over gear ratio
        torque = self._holding - KP * (state.position - self._anchor) - KD * state.velocity
        if self.override is not None:
            torque[2] = self.override
        if self.foreign:
            still = [0.0] * MOTORS
            self._setpoints.publish(self._states.encode(state.stamp_ns, self._anchor, still, self._holding))
        for k, (codec, publisher) in enumerate(zip(self._codecs, self._commands, strict=True)):
            if k + 1 not in self.foreign:
                publisher.publish(codec.encode(state.stamp_ns, effort=[torque[k]]))

    def _measured(self, buffer):
        self.tensions = self._cells.decode(buffer).effort

    def _note_drives(self, message):
        self.drives = from_diagnostic_array(message)

    def _note_health(self, message):
        self.health.update(from_diagnostic_array(message))

    def _note_cells(self, message):
        self.load_cells = from_diagnostic_array(message)["load_cells"][2].get("cause", "")

    def forget_drives(self):
        """Forget what drivers that are gone have said, and wait for the present ones to say something."""
        self.drives = {}

    def begin_here(self):
        """Hold the platform where it is from now on."""
        self._anchor = None

    @property
    def holds(self):
        """Whether torques answer the motor states, since `begin_here` was called."""
        return self._anchor is not None

    def call(self, service, kind=Trigger, request=None):
        """Call a service; return its response."""
        client = self._clients.get(service)
        if client is None:
            client = self._clients[service] = self.node.create_client(kind, service)
        wait_for(client.service_is_ready, f"{service} is not offered")
        future = client.call_async(kind.Request() if request is None else request)
        wait_for(future.done, f"{service} did not answer")
        return future.result()

    @property
    def group(self):
        """State and cause of the drives as a whole."""
        if "can_drives" not in self.drives:
            return "", ""
        _, state, values = self.drives["can_drives"]
        return state, values["cause"]

    @property
    def brakes_open(self):
        """Brakes that are open in the plant, as the emulated robot says once a second."""
        values = self.health.get("simulated_robot", (0, "", {}))[2]
        return int(values.get("brakes_open", -1))

    def close(self):
        self._stopping.set()
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


def wait_for(condition, problem, patience=PATIENCE):
    """Wait until a condition is true; fail with what `problem` says."""
    end = time.monotonic() + patience
    while not condition():
        if time.monotonic() > end:
            pytest.fail(problem() if callable(problem) else problem)
        time.sleep(0.01)


class Bench:
    """Drivers and emulated robot, each a process, on two kernel CAN buses, with probe and witness."""

    def __init__(self, directory, pace):
        self.directory = directory
        self.pace = pace
        self.config = directory / "can.yaml"
        self.config.write_text(yaml.safe_dump(two_buses(pace)))
        (directory / "eds").symlink_to(ROOT / "config" / "eds")
        self.wire = Candump(directory / "candump.log")
        self.probe = Probe()
        self.robot = None
        self.drivers = None

    def start_robot(self):
        self.robot = Process(
            "emulated_robot",
            "cspr_drivers.nodes.emulated_robot",
            [
                *("-p", f"can_config:={self.config}"),
                *("-p", f"simulation_config:={ROOT}/config/simulation.yaml"),
                *("-p", f"speed:={self.pace.speed}"),
            ],
            self.directory,
        )

    def start_drivers(self):
        code = SLOW_DRIVERS.format(speed=self.pace.speed)
        self.drivers = Process(
            "drivers", None, ["-p", f"can_config:={self.config}"], self.directory, code=code
        )

    def ready(self):
        """Bring both processes to where a test begins: running, drives disabled, brakes closed."""
        if self.robot is None or not self.robot.running:
            self.start_robot()
            self.robot.wait_until_ready()
        if self.drivers is None or not self.drivers.running:
            self.start_drivers()
            self.drivers.wait_until_ready()
            self.probe.forget_drives()
        self.probe.answers = True
        self.probe.call("/simulated_robot/clear_faults")  # of a test that failed
        wait_for(
            lambda: self.probe.group[0] in ("disabled", "fault"), self.explain("the drives are not ready")
        )
        self.recover()

    def recover(self):
        """Reset the fault, as the operator does, until the drives are disabled."""
        reset = 0.0
        end = time.monotonic() + PATIENCE
        while self.probe.group[0] != "disabled":
            assert time.monotonic() < end, self.explain("no recovery")()
            if self.probe.group[0] == "fault" and time.monotonic() > reset:
                self.probe.call("/can_drives/fault_reset")
                reset = time.monotonic() + 1.0
            time.sleep(0.02)
        self.until(lambda: self.probe.brakes_open == 0, "brakes are open")

    def enable(self):
        """Enable the drives, as the operator does, and wait until all brakes are open."""
        self.probe.begin_here()
        self.until(lambda: self.probe.holds, "no motor states come")  # and so no torque commands go
        self.until(lambda: self.probe.call("/can_drives/enable").success, "enable is refused")
        self.until(lambda: self.probe.group[0] == "enabled", "not enabled")
        self.until(lambda: self.probe.brakes_open == MOTORS, "not all brakes are open")

    def inject(self, fault):
        """Put a fault into the emulated devices by its name."""
        value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=fault)
        request = SetParameters.Request(parameters=[Parameter(name="fault", value=value)])
        (result,) = self.probe.call("/simulated_robot/set_parameters", SetParameters, request).results
        assert result.successful, result.reason
        answer = self.probe.call("/simulated_robot/inject_fault")
        assert answer.success, answer.message

    def held(self, *words):
        """Wait for the end that every fault must have: brakes closed in the plant, latched, the cause named."""
        self.until(lambda: self.probe.group[0] == "fault", "no fault is latched")
        self.until(lambda: self.probe.brakes_open == 0, "brakes are open")
        cause = self.probe.group[1]
        for word in words:
            assert word in cause, cause

    def back_without_a_jump(self):
        """Enable again after a fault; only the operator's two commands may do that, and nothing may jump."""
        before = self.probe.state.position
        stays = time.monotonic() + 1.0
        while time.monotonic() < stays:
            assert self.probe.brakes_open == 0, "a brake opened by itself"
            time.sleep(0.05)
        if self.probe.group[0] == "fault":
            assert not self.probe.call("/can_drives/enable").success, "enabled with a latched fault"
        self.recover()
        self.enable()
        # motor angles in rad: 1 rad is 1.7 mm of cable
        assert abs(self.probe.state.position - before).max() < 3.0
        self.disable()

    def disable(self):
        self.probe.call("/can_drives/disable")
        self.until(lambda: self.probe.group[0] == "disabled", "not disabled")

    def until(self, condition, problem):
        wait_for(condition, self.explain(problem))

    def explain(self, problem):
        def text():
            logs = [
                f"{process.name}: " + " | ".join(process.log.read_text().splitlines()[-8:])
                for process in (self.robot, self.drivers)
                if process is not None
            ]
            what = problem() if callable(problem) else problem
            return "\n".join(
                [f"{what}; drives {self.probe.group}, brakes open {self.probe.brakes_open}", *logs]
            )

        return text

    def close(self):
        for process in (self.drivers, self.robot):
            if process is not None:
                process.end()
        self.wire.close()
        self.probe.close()


def two_buses(pace):
    """Return the shipped configuration with half of the devices on each of two buses."""
    content = yaml.safe_load((ROOT / "config" / "can.yaml").read_text())
    content["rate"] = pace.rate
    content["timeouts"].update(pace.timeouts)
    content["allowed_drop"] = 0.2  # nothing hangs from it
    (name,) = content["buses"]
    bus = content["buses"].pop(name)
    for place, channel in enumerate(CHANNELS):
        content["buses"][f"bus_{place}"] = copy.deepcopy(bus) | {"interface": "socketcan", "channel": channel}
    for devices in (content["drives"], content["load_cells"]):
        for index, device in enumerate(devices):
            device["bus"] = f"bus_{index * len(CHANNELS) // len(devices)}"
    return content


def run_ip(*words):
    """Run iproute2's `ip`."""
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


def make_present(channel):
    """Make a virtual CAN interface if it is missing, and bring it up."""
    if not Path("/sys/class/net", channel).exists():
        run_ip("link", "add", channel, "type", "vcan")
    run_ip("link", "set", channel, "up")


class RawSocket:
    """A raw CAN socket of the kernel, to put on the bus what neither end would send."""

    _FRAME = struct.Struct("=IB3x8s")

    def __init__(self, channel):
        self._socket = socket.socket(socket.AF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
        self._socket.bind((channel,))

    def send(self, identifier, data=b""):
        self._socket.send(self._FRAME.pack(identifier, len(data), data.ljust(8, b"\0")))

    def close(self):
        self._socket.close()


class WireReport:
    """Round trip and losses of a stretch of the log: from each SYNC to the last torque before the next one."""

    def __init__(self, frames):
        trips, lost_states, lost_tensions, self.commands, self.cycles = [], 0, 0, 0, 0
        for channel, drives, cells in (
            ("vcan0", range(1, 5), range(11, 15)),
            ("vcan1", range(5, 9), range(15, 19)),
        ):
            here = [frame for frame in frames if frame.channel == channel]
            starts = [place for place, frame in enumerate(here) if frame.identifier == 0x080]
            for first, last in itertools.pairwise(starts):
                cycle = here[first:last]
                seen = {frame.identifier for frame in cycle}
                lost_states += sum(0x180 + node not in seen for node in drives)
                lost_tensions += sum(0x180 + node not in seen for node in cells)
                torques = [frame.time for frame in cycle if 0x201 <= frame.identifier <= 0x208]
                self.commands += len(torques)
                self.cycles += 1
                if len(torques) >= len(drives):
                    trips.append(torques[-1] - cycle[0].time)
        self._trips = sorted(trips)
        self._lost = (lost_states, lost_tensions)

    def __str__(self):
        trips = self._trips or [float("nan")]
        return (
            f"{self.cycles} cycles: SYNC to the last torque {1e3 * statistics.median(trips):.1f} ms median, "
            f"{1e3 * trips[-1]:.1f} ms maximum; lost: {self._lost[0]} of {4 * self.cycles} states, "
            f"{self._lost[1]} of {4 * self.cycles} tensions, {4 * self.cycles - self.commands} of "
            f"{4 * self.cycles} torques"
        )


@pytest.fixture(scope="module")
def processes(request, tmp_path_factory):
    pace = Pace(*request.module.PACE) if hasattr(request.module, "PACE") else USUAL_PACE
    bench = Bench(tmp_path_factory.mktemp("socketcan"), pace)
    yield bench
    bench.close()


@pytest.fixture
def bench(processes):
    """Both processes, drives disabled; interfaces are put right afterwards."""
    for channel in CHANNELS:
        make_present(channel)
    processes.ready()
    yield processes
    for channel in CHANNELS:
        make_present(channel)
    with contextlib.suppress(ProcessLookupError):
        for process in (processes.drivers, processes.robot):
            process.send(signal.SIGCONT)


@pytest.fixture
def ip():
    """Run iproute2's `ip`."""
    return run_ip


@pytest.fixture
def plug_in():
    """Make a virtual CAN interface if it is missing, and bring it up."""
    return make_present


@pytest.fixture
def raw():
    """Open raw sockets that are closed after the test."""
    sockets = []

    def open_raw(channel):
        sockets.append(RawSocket(channel))
        return sockets[-1]

    yield open_raw
    for each in sockets:
        each.close()


@pytest.fixture
def executable(bench):
    """Start one more executable of the product; the test ends it."""

    def start(name, module, *arguments, ros=True):
        process = Process(name, module, arguments, bench.directory, ros)
        if ros:
            process.wait_until_ready()
        return process

    return start


@pytest.fixture
def root():
    """The repository."""
    return ROOT


@pytest.fixture
def two_buses_file(tmp_path):
    """The shipped configuration, half of its devices on each of two buses of the kernel."""
    path = tmp_path / "can.yaml"
    path.write_text(yaml.safe_dump(two_buses(USUAL_PACE)))
    return path


@pytest.fixture
def wire_report():
    """Make a report of a stretch of candump's log."""
    return WireReport
