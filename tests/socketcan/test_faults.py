"""Faults of bus, driver and devices: each ends held, brakes closed, latched, with its cause, and only the operator
brings the robot back.

The names of the causes are those of docs/operation.md.
"""

import math
import signal
import threading
import time
from pathlib import Path

import pytest
from tests.socketcan.conftest import WATCHDOGS

CAN_ERR_FLAG = 0x20000000  # linux/can/error.h
CAN_ERR_PROT, CAN_ERR_BUSOFF = 0x08, 0x40


def test_commands_that_stop(bench):
    bench.enable()
    bench.probe.answers = False
    bench.held("no torque command within")
    bench.probe.answers = True
    bench.back_without_a_jump()


def test_a_driver_that_is_killed(bench):
    """The drives notice by themselves, by heartbeat or RPDO timeout: quick stop, brakes closed."""
    bench.enable()
    bench.drivers.send(signal.SIGKILL)
    killed = time.time()
    assert bench.drivers.wait() == -signal.SIGKILL
    bench.until(lambda: bench.probe.brakes_open == 0, "brakes stay open without a driver")
    frames = bench.wire.frames(since=killed)
    # EMCY 8130h (heartbeat) or 8250h (RPDO timeout) of every drive: CiA 301, section 7.2.7.1
    told = {
        f.identifier - 0x80: f.data[:2] for f in frames if 0x81 <= f.identifier <= 0x88 and len(f.data) == 8
    }
    assert set(told) == set(range(1, 9))
    assert set(told.values()) <= {bytes.fromhex("30 81"), bytes.fromhex("50 82")}
    # the operator starts it again; that alone opens no brake
    bench.ready()
    assert bench.probe.brakes_open == 0
    bench.enable()
    bench.disable()


def test_a_driver_that_is_frozen_for_a_second(bench):
    bench.enable()
    bench.drivers.send(signal.SIGSTOP)
    time.sleep(1.0 / bench.pace.speed)
    bench.drivers.send(signal.SIGCONT)
    # the drives have stopped by themselves meanwhile; the driver finds them so, or finds the commands missing first
    bench.held("motor_")
    bench.back_without_a_jump()


def test_a_drive_that_is_silent(bench, raw):
    """NMT stop from somebody else on the bus: the drive answers no SYNC and takes no torque any more."""
    bench.enable()
    raw("vcan0").send(0x000, bytes([0x02, 3]))
    bench.held("motor_3")
    bench.back_without_a_jump()


def test_a_drive_that_restarts(bench, raw):
    bench.enable()
    raw("vcan1").send(0x000, bytes([0x81, 7]))
    bench.held("motor_7")
    bench.back_without_a_jump()


def test_an_interface_that_goes_down(bench, ip):
    bench.enable()
    ip("link", "set", "vcan1", "down")
    bench.held("bus bus_1: Network is down")
    ip("link", "set", "vcan1", "up")
    bench.back_without_a_jump()


def test_a_bus_that_is_off(bench, raw, ip):
    """The controller reports bus-off by an error frame, and then sends nothing: vcan has no such state of its own."""
    bench.enable()
    raw("vcan0").send(CAN_ERR_FLAG | CAN_ERR_BUSOFF, bytes(8))
    ip("link", "set", "vcan0", "down")
    bench.held("bus bus_0: ")
    ip("link", "set", "vcan0", "up")
    bench.until(
        lambda: int(bench.probe.health.get("can_drives: bus bus_0", (0, "", {}))[2].get("bus_errors", 0)) > 0,
        "the error is not counted",
    )
    bench.back_without_a_jump()


@pytest.mark.skipif(
    "User Mode Linux" not in Path("/proc/cpuinfo").read_text(),
    reason="sets the clock of the machine that it runs on",
)
@pytest.mark.parametrize("step", [-3600.0, 0.5 * WATCHDOGS["command"], 3600.0])
def test_a_time_of_day_that_is_set(bench, step):
    bench.enable()
    true_time = time.time() - time.monotonic()
    before = bench.probe.states
    time.clock_settime(time.CLOCK_REALTIME, time.time() + step)
    try:
        bench.until(
            lambda: bench.probe.states > before + 30 or bench.probe.group[0] != "enabled",
            "no motor states come",
        )
        assert bench.probe.group[0] == "enabled", bench.probe.group

        def noted():
            return float(bench.probe.health["can_drives"][2]["time_set_by_s"])

        bench.until(lambda: abs(noted() - step) < 0.3, lambda: f"noted: {noted()} s")
    finally:
        time.clock_settime(time.CLOCK_REALTIME, true_time + time.monotonic())
    bench.disable()


def test_error_frames_are_counted_and_named(bench, raw):
    socket = raw("vcan0")
    for _ in range(20):
        socket.send(CAN_ERR_FLAG | CAN_ERR_PROT, bytes(8))
        time.sleep(0.01)

    def told():
        _, message, values = bench.probe.health.get("can_drives: bus bus_0", (0, "", {}))
        return "protocol violation" in message and int(values.get("bus_errors", 0)) >= 20

    bench.until(told, "error frames are not in /diagnostics")
    assert bench.probe.brakes_open == 0


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("drive_fault motor_2", "motor_2 reports drive or motor temperature too high (error code 0x4310)"),
        ("drive_emergency motor_2", "motor_2 reports DC link undervoltage (error code 0x3220)"),
        ("drive_wrong_mode motor_2", "motor_2 does not follow its target torque: it has left its mode"),
        ("drive_no_heartbeat motor_2", "motor_2: no heartbeat for"),
        ("drive_no_feedback motor_2", "motor_2: silent for"),
        ("emergency_stop", "emergency stop: input of motor_"),
    ],
)
def test_a_fault_of_the_devices(bench, fault, words):
    bench.enable()
    bench.inject(fault)
    bench.held(words)
    bench.probe.call("/simulated_robot/clear_faults")
    bench.back_without_a_jump()


def test_the_quick_stop_of_the_operator(bench):
    bench.enable()
    assert bench.probe.call("/can_drives/quick_stop").success
    bench.held("quick stop commanded")
    bench.back_without_a_jump()


def test_a_controller_that_is_killed(bench, executable, root):
    """One motor has the product's own controller, in a process of its own; it ends without a word."""
    bench.probe.foreign = {3}
    controller = executable(
        "motor_controller",
        "cspr_control.nodes.motor_controller",
        "-p", "motor:=3",
        "-p", f"control_rate:={bench.pace.rate}",
        "-p", "kp:=0.3",
        "-p", "kd:=0.02",
        "-p", "setpoint_timeout:=1.0",
        "-p", f"robot_config:={root}/config/robot.yaml",
    )  # fmt: skip
    try:
        bench.enable()
        controller.send(signal.SIGKILL)
        assert controller.wait() == -signal.SIGKILL
        bench.held("no torque command within", "motor_3")
    finally:
        controller.end()
        bench.probe.foreign = set()
    bench.back_without_a_jump()


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("load_cell_silent cable_6", "cable_6: "),
        ("load_cell_saturated cable_6", "cable_6: positive overload"),
    ],
)
def test_a_load_cell_that_fails_is_named_where_the_supervisor_listens(bench, fault, words):
    bench.until(lambda: bench.probe.load_cells == "", "the load cells are not well")
    bench.inject(fault)
    bench.until(lambda: words in bench.probe.load_cells, lambda: f"it is not named: {bench.probe.load_cells}")
    bench.probe.call("/simulated_robot/clear_faults")
    bench.until(
        lambda: bench.probe.load_cells == "", lambda: f"it does not come back: {bench.probe.load_cells}"
    )


def test_a_babbling_node(bench, raw):
    """A node that sends frames of the highest priority without pause: whatever comes of it, it ends held."""
    bench.enable()
    stop, babbled = threading.Event(), [0]
    socket = raw("vcan0")

    def babble():
        # A frame of 8 bytes takes up to 135 us at 1 Mbit/s: this is a bus loaded to 100 % and more
        while not stop.is_set():
            for _ in range(80):
                try:
                    socket.send(0x001, bytes(8))
                    babbled[0] += 1
                except OSError:
                    break
            time.sleep(0.01)

    babbler = threading.Thread(target=babble)
    babbler.start()
    try:
        bench.until(lambda: bench.probe.group[0] == "fault" or babbled[0] > 20_000, "the bus takes no frames")
    finally:
        stop.set()
        babbler.join()
    # a vcan has no bandwidth that could be used up: the robot goes on, or its watchdogs have stopped it
    bench.until(lambda: bench.probe.group[0] in ("enabled", "fault"), "neither enabled nor in fault")
    if bench.probe.group[0] == "enabled":
        bench.probe.call("/can_drives/quick_stop")
    bench.held()
    bench.back_without_a_jump()


@pytest.mark.parametrize("torque", [math.nan, math.inf, 50.0])
def test_a_command_that_must_not_reach_the_drives(bench, torque):
    begin = time.time()
    bench.enable()
    bench.probe.override = torque
    try:
        bench.held("torque command")
    finally:
        bench.probe.override = None
    # nothing of it is on the wire: no torque beyond the limit of 10 N m, 2000 thousandths of the rated torque
    torques = [
        int.from_bytes(frame.data[2:4], "little", signed=True)
        for frame in bench.wire.frames(since=begin)
        if 0x201 <= frame.identifier <= 0x208
    ]
    assert max(map(abs, torques)) < 1000
    bench.back_without_a_jump()


def test_ctrl_c_closes_the_brakes_first(bench):
    bench.enable()
    bench.drivers.send(signal.SIGINT)
    assert bench.drivers.wait() == 0
    bench.until(lambda: bench.probe.brakes_open == 0, "brakes are open")
    bench.ready()
    bench.enable()
    bench.drivers.send(signal.SIGTERM)
    assert bench.drivers.wait() == 0
    bench.until(lambda: bench.probe.brakes_open == 0, "brakes are open")


def test_an_interface_that_is_removed_and_comes_back(bench, ip):
    """As when a USB adapter is unplugged and plugged in again: the sockets of both ends are of no use any more."""
    bench.enable()
    ip("link", "delete", "vcan1")
    bench.held("bus bus_1: ")
    ip("link", "add", "vcan1", "type", "vcan")
    ip("link", "set", "vcan1", "up")
    bench.robot.end()  # the devices' own interfaces have not been unplugged: give them a bus again
    bench.ready()
    bench.back_without_a_jump()
