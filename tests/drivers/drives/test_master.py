import dataclasses
import errno
import math
import random
import re
import struct
import time
from pathlib import Path

import can
import pytest

from cspr_drivers.bus.can_bus import CanPort
from cspr_drivers.bus.can_ports import CanPorts
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.drives.master import DriveMaster
from cspr_drivers.errors import BusError
from cspr_msgs_py.vocabulary import DriverState

REPOSITORY = Path(__file__).parents[3]

# Status words, IEC 61800-7-201.
FAULT, AT_REST, ENABLED = 0x18, 0x50, 0x5037


class Rig:
    """A driver with its published states; answers every state with a torque unless told otherwise."""

    def __init__(self, config, ports):
        self.lines = []
        self.states = []
        self.torques = [1.0] * len(config.drives)
        self.silent = set()
        self.watched = True  # by a supervisor
        self.master = DriveMaster(config, ports, self._answer, self.lines.append)

    def _answer(self, states):
        self.states.append(states)
        if self.watched:
            self.master.supervised(states.stamp_ns)
        for index, torque in enumerate(self.torques):
            if index not in self.silent:
                self.master.command(index, states.stamp_ns, torque)

    @property
    def state(self):
        return self.master.snapshot().state

    @property
    def cause(self):
        return self.master.snapshot().cause


@pytest.fixture
def rig(config, ports):
    rig = Rig(config, ports)
    rig.master.start()
    yield rig
    rig.master.stop()


@pytest.fixture
def enabled(rig, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    wait_until(lambda: rig.master.enable() is None)
    wait_until(lambda: rig.state is DriverState.ENABLED)
    return rig


def test_drives_are_configured_and_started(rig, far_end, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    drive = far_end.drives[2]
    assert drive.operational
    assert drive.read(0x6060) == 10
    assert drive.read(0x6072) == 2000  # 10 N m of 5 N m rated
    assert drive.read(0x605A) == 2
    assert drive.read(0x6007) == 3
    assert [drive.read(0x605A + n) for n in range(5)] == [2, 1, 1, 1, 2]
    assert drive.read(0x1029, 1) == 1
    assert drive.read(0x1016, 1) == 127 << 16 | 600
    assert drive.read(0x1017) == 30
    assert drive.read(0x1400, 1) == 0x203
    assert drive.read(0x1400, 2) == 255
    assert drive.read(0x1400, 5) == 200
    assert [drive.read(0x1600, n) for n in (0, 1, 2)] == [2, 0x6040_0010, 0x6071_0010]
    assert drive.read(0x1800, 1) == 0x4000_0183
    assert drive.read(0x1800, 2) == 1
    assert [drive.read(0x1A00, n) for n in (0, 1, 2, 3)] == [3, 0x6041_0010, 0x6064_0020, 0x6077_0010]
    assert [drive.read(0x1400 + n, 1) for n in (1, 2, 3)] == [0x8000_0303, 0x8000_0403, 0x8000_0503]
    assert [drive.read(0x1800 + n, 1) for n in (1, 3)] == [0x8000_0283, 0x8000_0483]
    # The input of the emergency stop: TPDO 3, on a change.
    assert [drive.read(0x1802, n) for n in (1, 2)] == [0x4000_0383, 255]
    assert [drive.read(0x1A02, n) for n in (0, 1)] == [1, 0x60FD_0020]


def test_a_pdo_is_written_in_the_order_of_the_standard_and_read_back(rig, far_end, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    drive = far_end.drives[2]
    # CiA 301, section 7.5.2.36: not valid, nothing mapped, objects, their number, transmission, valid.
    assert [write for write in drive.writes if write[0] in (0x1400, 0x1600)] == [
        (0x1400, 1, bytes.fromhex("03 02 00 80")),
        (0x1600, 0, bytes.fromhex("00")),
        (0x1600, 1, bytes.fromhex("10 00 40 60")),
        (0x1600, 2, bytes.fromhex("10 00 71 60")),
        (0x1600, 0, bytes.fromhex("02")),
        (0x1400, 2, bytes.fromhex("FF")),
        (0x1400, 5, bytes.fromhex("C8 00")),
        (0x1400, 1, bytes.fromhex("03 02 00 00")),
    ]
    assert drive.reads.count((0x1600, 2)) >= 1


def test_a_drive_that_is_set_up_already_is_only_read(rig, config, ports, far_end, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    rig.master.stop()
    for drive in far_end.drives:
        drive.writes.clear()
        drive.reads.clear()
    far_end.drives[5].objects[0x605E, 0] = b"\x01\x00"  # somebody has changed one of its options
    again = Rig(config, ports)
    again.master.start()
    try:
        wait_until(lambda: again.state is DriverState.DISABLED)
        assert all(drive.reads for drive in far_end.drives)
        assert [drive.writes for drive in far_end.drives] == [[]] * 5 + [[(0x605E, 0, b"\x02\x00")]] + [
            []
        ] * 2
    finally:
        again.master.stop()


def test_a_lost_answer_is_asked_for_again(config, ports, far_end, wait_until):
    far_end.drives[1].unanswered[0x6502, 0] = 1  # a read
    far_end.drives[1].unanswered[0x6072, 0] = 1  # a read, and then what is written
    rig = Rig(config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.state is DriverState.DISABLED)
        assert rig.lines == []
        assert far_end.drives[1].read(0x6072) == 2000
    finally:
        rig.master.stop()


def test_an_answer_that_is_cut_off_is_told_and_the_drive_is_set_up_again(
    config, ports, far_end, wait_until, monkeypatch
):
    drive, answers = far_end.drives[1], [b""]
    answer = drive.sdo
    monkeypatch.setattr(drive, "sdo", lambda data: answers.pop() if answers else answer(data))
    rig = Rig(config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.state is DriverState.DISABLED)
        assert rig.lines == [
            "motor_2 (node 2 on main): 1000h:00 (device type) read: it answers with 0 bytes, not 8",
            "motor_2 (node 2 on main): ready",
        ]
    finally:
        rig.master.stop()


@pytest.mark.parametrize("seed", range(3))
def test_a_drive_is_set_up_at_last_whatever_it_has_answered_before(config, ports, far_end, wait_until, seed):
    drawn = random.Random(seed)
    drive = far_end.drives[1]
    right, answers = drive.sdo, [drawn.randbytes(size) for size in range(9) for _ in range(4)]
    drawn.shuffle(answers)
    drive.sdo = lambda data: answers.pop() if answers else right(data)
    rig = Rig(config, ports)
    rig.master.start()
    try:
        # Without its boot-up message one that has the answers of another device is not asked again.
        wait_until(lambda: not answers or far_end.send(0x702, [0]))
        far_end.send(0x702, [0])
        wait_until(lambda: rig.state is DriverState.DISABLED)
        assert drive.read(0x6072) == 2000
    finally:
        rig.master.stop()


ENDED = "the driver's thread '{}' has ended (RuntimeError: defect): start the driver again"


def defect(*arguments):
    raise RuntimeError("defect")


def test_a_set_up_thread_that_ends_is_a_fault_and_no_reset_clears_it(rig, far_end, wait_until, monkeypatch):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    monkeypatch.setattr(rig.master._setup, "_allowed", defect)
    far_end.send(0x702, [0])
    ended = ENDED.format("device set-up")
    wait_until(lambda: rig.cause == ended)
    assert rig.master.fault_reset() == ended
    assert rig.master.enable() == f"a fault is latched: {ended}; reset it first"


def test_a_cycle_clock_that_ends_stops_the_drives(enabled, far_end, wait_until, monkeypatch):
    monkeypatch.setattr(enabled.master, "_watch_devices", defect)
    wait_until(lambda: enabled.state is DriverState.FAULT)
    assert enabled.cause == ENDED.format("cycle clock")
    assert not enabled.master.snapshot().clock_running
    wait_until(lambda: all(drive.rpdos[-1][0] == 0x02 for drive in far_end.drives))  # quick stop


def test_a_defect_in_what_takes_a_frame_is_a_fault_and_frames_are_received_after_it(
    enabled, ports, wait_until, monkeypatch, capsys
):
    monkeypatch.setattr(enabled.master, "_publish", defect)
    wait_until(lambda: enabled.state is DriverState.FAULT)
    assert re.fullmatch(r"bus main: frame of COB-ID 0x18\d: RuntimeError: defect", enabled.cause)
    monkeypatch.undo()
    known = len(enabled.states)
    wait_until(lambda: len(enabled.states) > known + 3)
    assert ports["main"].ended == ""
    assert capsys.readouterr().err.count("Traceback") < ports["main"].bus_errors + 2


def test_a_receiving_thread_that_ends_is_a_fault(rig, ports, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    ports["main"].ended = ENDED.format("bus main")
    wait_until(lambda: rig.cause == ENDED.format("bus main"))


@pytest.mark.parametrize(
    ("subindex", "found", "words"),
    [
        (1, 0x2B7, "1018h:01 (vendor id) is 695 (0x2B7), expected 0 (0x0)"),
        (2, 0x403, "1018h:02 (product code) is 1027 (0x403), expected 1026 (0x402)"),
        (3, 0x2_0000, "1018h:03 (revision number) is 131072 (0x20000), expected 65536 (0x10000)"),
        (4, 77, "1018h:04 (serial number) is 77 (0x4D), expected 5 (0x5)"),
    ],
)
def test_a_wrong_device_is_not_touched_until_another_one_is_in_its_place(
    config, ports, far_end, wait_until, subindex, found, words
):
    drive = far_end.drives[4]
    right = drive.objects[0x1018, subindex]
    drive.objects[0x1018, subindex] = found.to_bytes(4, "little")
    rig = Rig(config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.lines)
        assert rig.lines == [f"motor_5 (node 5 on main): {words}"]
        wait_until(lambda: rig.master.enable() == f"motor_5: {words}")
        drive.reads.clear()
        # Others are asked again meanwhile; this one is not.
        far_end.send(0x706, [0])
        wait_until(lambda: "motor_6 (node 6 on main)" not in rig.master.snapshot().not_configured)
        assert drive.reads == drive.writes == []
        assert not drive.operational
        drive.objects[0x1018, subindex] = right
        far_end.send(0x705, [0])
        wait_until(lambda: rig.state is DriverState.DISABLED)
    finally:
        rig.master.stop()


def test_the_minor_revision_is_of_no_consequence(config, ports, far_end, wait_until):
    far_end.drives[0].objects[0x1018, 3] = (0x1_0007).to_bytes(4, "little")
    rig = Rig(config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.state is DriverState.DISABLED)
    finally:
        rig.master.stop()


def test_a_drive_that_is_not_commissioned_is_not_enabled(mapping, far_end, ports, config, wait_until):
    drives = (dataclasses.replace(config.drives[0], identity=None), *config.drives[1:])
    rig = Rig(dataclasses.replace(config, drives=drives), ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.lines)
        assert "motor_1 (node 1 on main): is not commissioned: its identity is null" in rig.lines[0]
        wait_until(lambda: "not commissioned" in (rig.master.enable() or ""))
        assert far_end.drives[0].writes == []
    finally:
        rig.master.stop()


def test_a_drive_under_torque_is_not_set_up(config, ports, far_end, wait_until):
    far_end.drives[0].status = ENABLED
    rig = Rig(config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.lines)
        assert rig.lines[0].startswith("motor_1 (node 1 on main): is in operation_enabled and not yet set up")
        assert far_end.drives[0].writes == []
    finally:
        rig.master.stop()


def test_states_carry_angle_speed_and_torque_with_polarity(rig, far_end, wait_until):
    wait_until(lambda: len(rig.states) > 2)
    far_end.drives[0].counts = 131072
    far_end.drives[1].counts = 131072  # polarity -1
    wait_until(lambda: rig.states[-1].angles[0] != 0.0)
    moved = next(n for n, states in enumerate(rig.states) if states.angles[0] != 0.0)
    assert rig.states[-1].angles[:2] == pytest.approx((2 * math.pi, -2 * math.pi))
    elapsed = (rig.states[moved].stamp_ns - rig.states[moved - 1].stamp_ns) * 1e-9
    assert rig.states[moved].speeds[0] * elapsed == pytest.approx(2 * math.pi, rel=0.1)
    wait_until(lambda: rig.states[-1].speeds[0] == 0.0)
    assert rig.states[-1].torques[:2] == pytest.approx((1.0, 1.0))


def test_torques_go_out_at_once_with_the_control_word(rig, far_end, wait_until):
    wait_until(lambda: len(rig.states) > 3)
    assert (0x0000, 200) in far_end.drives[0].rpdos
    assert (0x0000, -200) in far_end.drives[1].rpdos


def test_enable_and_disable(enabled, far_end, wait_until):
    assert all(drive.status == ENABLED for drive in far_end.drives)
    assert next(word for word, _ in far_end.drives[0].rpdos if word) == 0x06
    enabled.master.disable()
    wait_until(lambda: enabled.state is DriverState.DISABLED)
    words = [word for word, _ in far_end.drives[0].rpdos]
    assert words[words.index(0x0F) :].count(0x07) >= 1  # disable operation first
    assert far_end.drives[0].rpdos[-1][1] == 200  # torque kept


def test_statistics_count_enabled_cycles(enabled, wait_until):
    # A busy test machine misses some; how many is measured by the demo.
    wait_until(lambda: enabled.master.snapshot().statistics.latency.count > 10)
    statistics = enabled.master.snapshot().statistics
    assert statistics.latency.count == statistics.cycles - statistics.missed_cycles
    assert 0.0 < statistics.latency.p50 <= statistics.latency.p99 <= statistics.latency.maximum


def test_a_missing_command_is_a_missed_cycle(enabled, wait_until):
    enabled.silent.add(4)
    wait_until(lambda: enabled.master.snapshot().statistics.missed_cycles > 3)
    wait_until(lambda: enabled.state is DriverState.FAULT)
    assert enabled.cause == "no torque command within 300 ms for motor_5"


@pytest.mark.parametrize(
    ("torque", "words"),
    [
        (math.nan, "motor_2: torque command of nan N m is not finite"),
        (math.inf, "motor_2: torque command of inf N m is not finite"),
        (10.1, "motor_2: torque command of 10.1 N m is beyond the torque limit"),
    ],
)
def test_a_bad_torque_stops_the_drives_and_is_not_passed_on(enabled, far_end, wait_until, torque, words):
    enabled.torques[1] = torque
    wait_until(lambda: enabled.state is DriverState.FAULT)
    assert enabled.cause == words
    wait_until(lambda: all(drive.status == AT_REST for drive in far_end.drives))
    assert all(0x02 in [word for word, _ in drive.rpdos] for drive in far_end.drives)
    assert {torque for _, torque in far_end.drives[1].rpdos} <= {0, -200}


def test_a_bad_torque_does_not_latch_while_disabled(rig, wait_until):
    rig.torques[1] = math.nan
    wait_until(lambda: rig.master.snapshot().rejected_commands > 0)
    assert rig.state is not DriverState.FAULT
    wait_until(lambda: rig.state is DriverState.DISABLED)
    wait_until(lambda: rig.master.enable() == "no fresh torque commands for motor_2")


def test_a_stale_command_stops_the_drives(enabled, wait_until):
    enabled.master.command(0, enabled.states[-1].stamp_ns - 400_000_000, 1.0)
    assert enabled.state is DriverState.FAULT
    assert "motor_1: torque command of 1 N m is older than the command timeout" in enabled.cause


def test_an_unreadable_command_stops_the_drives(enabled):
    enabled.master.reject_command(2, "JointState lacks motor_3")
    assert enabled.state is DriverState.FAULT
    assert enabled.cause == "motor_3: unreadable torque command: JointState lacks motor_3"


def test_fault_is_latched_until_reset_and_enable_is_refused(enabled, far_end, wait_until):
    enabled.master.quick_stop("quick stop commanded")
    enabled.master.quick_stop("something later")
    assert enabled.master.enable() == "a fault is latched: quick stop commanded; reset it first"
    wait_until(lambda: enabled.master.fault_reset() is None)
    wait_until(lambda: enabled.state is DriverState.DISABLED)
    assert all(drive.status == AT_REST for drive in far_end.drives)


def test_fault_of_one_drive_stops_all_and_is_reset_by_a_rising_edge(enabled, far_end, wait_until):
    far_end.send(0x083, bytes.fromhex("10 82 21 00 00 00 00 00"))
    far_end.drives[2].status = FAULT
    wait_until(lambda: enabled.state is DriverState.FAULT)
    assert enabled.cause == ("motor_3 reports PDO not processed because it is too short (error code 0x8210)")
    wait_until(lambda: enabled.master.fault_reset() is None)
    wait_until(lambda: enabled.state is DriverState.DISABLED)
    words = [word for word, _ in far_end.drives[2].rpdos]
    first = words.index(0x80)
    assert not words[first - 1] & 0x80
    assert not any(
        0x80 in [word for word, _ in drive.rpdos] for drive in far_end.drives if drive.node_id != 3
    )


def test_a_drive_that_stays_in_fault_says_so(enabled, far_end, wait_until):
    far_end.drives[5].obeys = False
    far_end.drives[5].status = FAULT
    wait_until(lambda: enabled.state is DriverState.FAULT)
    wait_until(lambda: enabled.master.fault_reset() is None)
    wait_until(lambda: enabled.cause == "not reset: motor_6 is in fault")
    assert enabled.state is DriverState.FAULT


def test_a_silent_drive_stops_the_others(enabled, far_end, wait_until):
    far_end.drives[6].answers_sync = False
    wait_until(lambda: enabled.state is DriverState.FAULT)
    assert enabled.cause.startswith(("motor_7: silent for", "no torque command within"))
    wait_until(lambda: far_end.drives[0].status == AT_REST)


def test_a_missing_heartbeat_is_a_fault_in_motion(enabled, far_end, wait_until):
    far_end.beating = False
    wait_until(lambda: enabled.state is DriverState.FAULT)
    assert "no heartbeat for" in enabled.cause


def test_a_restart_in_motion_is_a_fault_and_reconfigured_after_it(enabled, far_end, wait_until):
    drive = far_end.drives[3]
    drive.restart()
    drive.status = AT_REST
    far_end.send(0x704, [0])
    wait_until(lambda: enabled.state is DriverState.FAULT)
    assert enabled.cause == "motor_4: restarted"
    wait_until(lambda: drive.operational)
    assert drive.writes
    wait_until(lambda: enabled.master.fault_reset() is None)
    wait_until(lambda: enabled.state is DriverState.DISABLED)


def test_a_drive_that_does_not_answer_is_named_and_taken_in_later(config, ports, far_end, wait_until):
    far_end.drives[4].answers_sdo = False
    rig = Rig(config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.lines)
        assert rig.lines == ["motor_5 (node 5 on main): does not answer"]
        wait_until(
            lambda: rig.master.snapshot().not_configured == {"motor_5 (node 5 on main)": "does not answer"}
        )
        wait_until(lambda: rig.master.enable() == "motor_5: does not answer")
        far_end.drives[4].answers_sdo = True
        wait_until(lambda: rig.state is DriverState.DISABLED)
        assert rig.lines[-1] == "motor_5 (node 5 on main): ready"
    finally:
        rig.master.stop()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda drive: drive.aborts.update({(0x6072, 0): 0x0609_0030}),
            "motor_1 (node 1 on main): refuses 6072h:00 (max torque, thousandths of the rated torque) "
            "= 2000: Value range of parameter exceeded (abort code 0x06090030)",
        ),
        (
            lambda drive: drive.objects.update({(0x6076, 0): (3200).to_bytes(4, "little")}),
            "motor_1 (node 1 on main): 6076h:00 (motor rated torque, mN m) is 3200 (0xC80), expected 5000 (0x1388)",
        ),
        (
            lambda drive: drive.objects.update({(0x1000, 0): (0x0002_0191).to_bytes(4, "little")}),
            "motor_1 (node 1 on main): 1000h:00 (device type) is 131473 (0x20191), expected 402 (0x192)",
        ),
        (
            lambda drive: drive.objects.update({(0x6075, 0): bytes(4)}),
            "motor_1 (node 1 on main): 6075h:00 (motor rated current, mA) is 0: its motor data are not set; "
            "set them with the manufacturer's software",
        ),
        (
            lambda drive: drive.objects.update({(0x6502, 0): (0x008).to_bytes(4, "little")}),
            "motor_1 (node 1 on main): 6502h:00 (supported drive modes) is 8 (0x8), expected 512 (0x200)",
        ),
        (
            lambda drive: drive.objects.update({(0x6061, 0): b"\x08"}),
            "motor_1 (node 1 on main): 6061h:00 (modes of operation display) is 8 (0x8), expected 10 (0xA)",
        ),
    ],
)
def test_a_drive_that_does_not_fit_is_named_with_the_object(
    config, ports, far_end, wait_until, change, words
):
    change(far_end.drives[0])
    rig = Rig(config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.lines)
        assert rig.lines == [words]
    finally:
        rig.master.stop()


def test_stop_closes_the_brakes_first(enabled, far_end):
    enabled.master.stop()
    assert all(drive.status == AT_REST for drive in far_end.drives)
    time.sleep(0.05)
    assert not any(drive.operational for drive in far_end.drives)


def test_a_second_driver_does_not_start_and_disturbs_nothing(rig, config, far_end, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    other = CanPorts([CanPort("main", can.Bus(interface="virtual", channel=config.buses[0].channel))])
    try:
        second = DriveMaster(config, other, lambda states: None, lambda line: None)
        with pytest.raises(BusError, match="a driver is active on the CAN bus"):
            second.start()
        second.stop()
        assert all(drive.operational for drive in far_end.drives)
    finally:
        other.close()


def test_bad_frames_are_counted_named_and_not_used(rig, ports, far_end, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    far_end.send(0x181, bytes(7))
    wait_until(lambda: ports["main"].malformed_frames == 1)
    assert ports["main"].last_problem == "frame of COB-ID 0x181: frame of 7 bytes where 8 were expected"
    far_end.send(0x181, bytes.fromhex("6F 00 00 00 00 00 00 00"))  # no state of CiA 402
    wait_until(lambda: ports["main"].malformed_frames == 2)
    far_end.send(0x1F1, bytes(8))
    wait_until(lambda: ports["main"].unknown_frames == 1)
    assert ports["main"].last_problem == "frame of unknown COB-ID 0x1F1"
    far_end.send(0x081, b"\x00")  # an emergency frame cut short
    wait_until(lambda: ports["main"].malformed_frames == 3)
    assert rig.state is DriverState.DISABLED


def test_a_drive_that_leaves_nmt_operational_is_a_fault_in_motion(enabled, far_end, wait_until):
    far_end.drives[4].operational = False  # as after 1029h:01 = 0, or an NMT command of somebody else
    wait_until(lambda: enabled.state is DriverState.FAULT)
    wait_until(lambda: "motor_5 (node 5 on main)" in enabled.master.snapshot().not_configured or True)
    assert enabled.cause.startswith(
        (
            "motor_5: left NMT operational, it is pre-operational",
            "motor_5: silent for",
            "no torque command within",
        )
    )


def test_an_interface_that_takes_no_frames_is_named_as_the_cause(enabled, ports, wait_until, monkeypatch):
    def refuse(message, timeout=None):
        raise can.CanOperationError("Network is down", errno.ENETDOWN)

    monkeypatch.setattr(ports["main"]._bus, "send", refuse)
    wait_until(lambda: enabled.state is DriverState.FAULT)
    assert enabled.cause.startswith("bus main: Network is down")


def test_a_drive_that_applies_another_torque_stops_all(enabled, far_end, wait_until):
    drive = far_end.drives[2]
    drive.tpdo = lambda: struct.pack("<Hih", drive.status, drive.counts, 2000)  # thousandths of 5 N m
    wait_until(lambda: enabled.state is DriverState.FAULT)
    assert enabled.cause == "motor_3 applies 10.00 N m instead of 1.00 N m"


def test_the_torque_is_there_before_the_brake_opens(rig, far_end, wait_until):
    rig.torques = [0.5 * (k + 1) for k in range(8)]
    wait_until(lambda: rig.state is DriverState.DISABLED)
    wait_until(lambda: rig.master.enable() is None)
    wait_until(lambda: rig.state is DriverState.ENABLED)
    for index, drive in enumerate(far_end.drives):
        first = next(torque for word, torque in drive.rpdos if word == 0x0F)
        assert first == (1 if index % 2 == 0 else -1) * 100 * (
            index + 1
        )  # thousandths of 5 N m, with polarity


def test_one_drive_alone(rig, far_end, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    wait_until(lambda: rig.master.enable(2) is None)
    wait_until(lambda: rig.state is DriverState.ENABLED)
    assert rig.master.snapshot().members == ("motor_3",)
    assert [drive.status for drive in far_end.drives] == [AT_REST] * 2 + [ENABLED] + [AT_REST] * 5
    rig.master.disable(2)
    wait_until(lambda: rig.state is DriverState.DISABLED)


def test_the_errors_of_a_drive_are_kept_with_text_and_remedy(rig, far_end, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    far_end.send(0x081, bytes.fromhex("10 43 09 00 00 00 00 00"))
    wait_until(lambda: rig.master.snapshot().drives[0].errors)
    (error,) = rig.master.snapshot().drives[0].errors
    assert error.text == "drive or motor temperature too high (error code 0x4310)"
    assert "cool down" in error.remedy
    far_end.send(0x081, bytes.fromhex("00 00 00 00 00 00 00 00"))
    wait_until(lambda: not rig.master.snapshot().drives[0].errors)
    assert rig.state is DriverState.DISABLED


def test_the_emergency_stop_input_stops_the_drives(enabled, far_end, wait_until):
    far_end.send(0x384, bytes.fromhex("08 00 00 00"))
    wait_until(lambda: enabled.state is DriverState.FAULT)
    assert enabled.cause == "emergency stop: input of motor_4"
    wait_until(lambda: enabled.master.fault_reset() is None)
    wait_until(lambda: enabled.state is DriverState.NOT_READY)
    assert enabled.master.enable() == "motor_4: its emergency stop input is active"
    far_end.send(0x384, bytes.fromhex("00 00 00 00"))
    wait_until(lambda: enabled.state is DriverState.DISABLED)


def test_an_emergency_stop_that_is_active_from_the_start_is_seen(config, ports, far_end, wait_until):
    far_end.drives[3].objects[0x60FD, 0] = bytes.fromhex("08 00 00 00")
    rig = Rig(config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.master.enable() == "motor_4: its emergency stop input is active")
    finally:
        rig.master.stop()


def test_a_bus_that_fails_is_the_cause(enabled, ports):
    ports["main"].receive_failed(can.CanOperationError("Network is down", errno.ENETDOWN))
    assert enabled.state is DriverState.FAULT
    assert enabled.cause.startswith("bus main: Network is down")


def test_answered_late_and_missing_are_counted_for_each_drive(enabled, far_end, wait_until):
    far_end.drives[5].answers_sync = False
    wait_until(lambda: enabled.master.snapshot().statistics.answers[5].missing > 3)
    answers = enabled.master.snapshot().statistics.answers
    assert answers[0].answered > answers[5].answered
    far_end.send(0x186, far_end.drives[5].tpdo())  # an answer to a SYNC of long ago
    wait_until(lambda: enabled.master.snapshot().statistics.answers[5].late == 1)
    assert enabled.master.snapshot().feedback_ages[5] >= 0.0


@pytest.fixture
def velocity_config(mapping, far_end):
    """Drives that send their velocity in a second TPDO, in revolutions a minute."""
    mapping["velocity_source"] = "velocity_actual"
    mapping["pdo"]["drive_tpdo_2"] = ["velocity_actual"]
    for drive in far_end.drives:
        drive.objects[0x60A9, 0] = bytes.fromhex("00 47 B4 00")  # CiA 303-2: revolutions a minute
    return CanConfig.from_mapping(mapping, "can.yaml")


def test_the_speed_is_the_one_that_the_drives_measure(config, velocity_config, ports, far_end, wait_until):
    del config
    rig = Rig(velocity_config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.states)
        far_end.drives[0].velocity = 60
        far_end.drives[1].velocity = 60  # polarity -1
        wait_until(lambda: rig.states[-1].speeds[0] != 0.0)
        wait_until(lambda: rig.states[-1].speeds[:2] == pytest.approx((2 * math.pi, -2 * math.pi)))
        assert rig.states[-1].angles[0] == 0.0  # whatever the positions are
        assert [far_end.drives[0].read(0x1801, n) for n in (1, 2)] == [0x4000_0281, 1]
        assert far_end.drives[0].read(0x1A01, 1) == 0x606C_0020
    finally:
        rig.master.stop()


def test_a_velocity_of_unknown_unit_is_refused(velocity_config, ports, far_end, wait_until):
    far_end.drives[2].objects[0x60A9, 0] = bytes.fromhex("00 47 01 00")
    rig = Rig(velocity_config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.lines)
        assert rig.lines[0].startswith(
            "motor_3 (node 3 on main): 60A9h:00 (SI unit velocity) is 83712 (0x14700): "
        )
        assert far_end.drives[2].writes == []
    finally:
        rig.master.stop()


def test_positions_of_unknown_unit_are_refused(config, ports, far_end, wait_until):
    far_end.drives[2].objects[0x60A8, 0] = bytes.fromhex("00 00 41 00")  # degrees
    rig = Rig(config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.lines)
        assert (
            "60A8h:00 (SI unit position) is 4259840 (0x410000), expected 11862016 (0xB50000)" in rig.lines[0]
        )
    finally:
        rig.master.stop()


@pytest.mark.parametrize(
    ("objects", "words"),
    [
        ({(0x607E, 0): "80"}, "607Eh:00 (polarity) is 128 (0x80), expected 0 (0x0): it reverses directions"),
        ({(0x607E, 0): "40"}, "607Eh:00 (polarity) is 64 (0x40)"),
        (
            {(0x6091, 1): "05 00 00 00", (0x6091, 2): "01 00 00 00"},
            "6091h (gear ratio) is 5 : 1, so its positions",
        ),
        ({(0x6092, 1): "68 01 00 00", (0x6092, 2): "01 00 00 00"}, "set it to 1 : 1 or 131072 : 1"),
    ],
)
def test_positions_that_are_turned_or_scaled_are_refused(config, ports, far_end, wait_until, objects, words):
    far_end.drives[2].objects |= {key: bytes.fromhex(value) for key, value in objects.items()}
    rig = Rig(config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.lines)
        assert rig.lines[0].startswith("motor_3 (node 3 on main): ")
        assert words in rig.lines[0]
        assert far_end.drives[2].writes == []
    finally:
        rig.master.stop()


@pytest.mark.parametrize("feed", [1, 131072])
def test_factors_that_leave_increments_are_accepted(config, ports, far_end, wait_until, feed):
    ratio = {(0x6091, 1): 3, (0x6091, 2): 3, (0x6092, 1): feed, (0x6092, 2): 1}
    far_end.drives[2].objects |= {key: value.to_bytes(4, "little") for key, value in ratio.items()}
    far_end.drives[2].objects[0x607E, 0] = bytes(1)
    rig = Rig(config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.state is DriverState.DISABLED)
    finally:
        rig.master.stop()


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ((0x605A, 0), "00 00", "605Ah:00 (quick stop option) is 0 (0x0), expected 2 (0x2)"),
        ((0x6007, 0), "00 00", "6007h:00 (abort connection option) is 0 (0x0), expected 3 (0x3)"),
        (
            (0x6072, 0),
            "E8 03",
            "6072h:00 (max torque, thousandths of the rated torque) is 1000 (0x3E8), expected 2000",
        ),
        (
            (0x1016, 1),
            "00 00 00 00",
            "1016h:01 (consumer heartbeat time) is 0 (0x0), expected 8323672 (0x7F0258)",
        ),
        (
            (0x1600, 2),
            "20 00 FF 60",
            "1600h:02 (mapped object 2) is 1627324448 (0x60FF0020), expected 1618018320",
        ),
    ],
)
def test_a_setting_changed_at_rest_is_named_instead_of_enabling_and_set_right(
    rig, far_end, wait_until, place, value, words
):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    drive = far_end.drives[2]
    right, drive.objects[place] = drive.objects[place], bytes.fromhex(value)
    wait_until(lambda: rig.master.enable() is None)
    wait_until(lambda: rig.state is DriverState.FAULT)
    assert rig.cause.startswith(f"motor_3: settings read again before enabling: {words}")
    assert all(word != 0x06 for node in far_end.drives for word, _ in node.rpdos)  # none was switched on
    wait_until(lambda: drive.objects[place] == right)
    wait_until(lambda: rig.master.fault_reset() is None)
    wait_until(lambda: rig.state is DriverState.DISABLED)
    wait_until(lambda: rig.master.enable() is None)
    wait_until(lambda: rig.state is DriverState.ENABLED)


def test_an_encoder_scale_changed_at_rest_is_named_and_not_set_up(rig, far_end, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    far_end.drives[2].objects[0x608F, 1] = (65536).to_bytes(4, "little")
    wait_until(lambda: rig.master.enable(2) is None)
    wait_until(lambda: rig.state is DriverState.FAULT)
    changed = "608Fh:01 (encoder increments) is 65536 (0x10000), expected 131072 (0x20000)"
    assert rig.cause == f"motor_3: settings read again before enabling: {changed}"
    wait_until(lambda: rig.lines)
    assert rig.lines[0] == f"motor_3 (node 3 on main): {changed}"


def test_a_drive_that_does_not_answer_when_its_settings_are_read_is_not_enabled(rig, far_end, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    far_end.drives[2].unanswered[0x605A, 0] = 2  # the request and its repetition
    wait_until(lambda: rig.master.enable() is None)
    assert rig.master.enable() is not None  # not twice
    wait_until(lambda: rig.state is DriverState.FAULT)
    assert rig.cause == "motor_3: settings read again before enabling: does not answer"


def test_one_drive_joins_another_without_disturbing_it(rig, far_end, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    wait_until(lambda: rig.master.enable(2) is None)
    wait_until(lambda: rig.state is DriverState.ENABLED)
    far_end.drives[2].reads.clear()
    wait_until(lambda: rig.master.enable(3) is None)
    wait_until(
        lambda: rig.state is DriverState.ENABLED and rig.master.snapshot().members == ("motor_3", "motor_4")
    )
    assert far_end.drives[2].reads == []
    assert far_end.drives[2].status == ENABLED


def test_the_present_pose_becomes_the_home_pose(config, ports, far_end, tmp_path, wait_until):
    path = tmp_path / "can.yaml"
    path.write_text((REPOSITORY / "config" / "can.yaml").read_text())
    rig = Rig(dataclasses.replace(config, source=str(path)), ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.state is DriverState.DISABLED)
        for index, drive in enumerate(far_end.drives):
            drive.counts = 4000 * (index + 1)
        wait_until(lambda: rig.states and rig.states[-1].angles[7] != 0.0)
        wait_until(lambda: rig.states[-1].speeds == (0.0,) * 8)
        refusal = rig.master.set_home()
        assert "motor_8 " in refusal
        assert " rad away from it" in refusal
        assert not any(drive.units.home_counts for drive in CanConfig.from_yaml(path).drives)
        assert rig.master.set_home() is None
        wait_until(lambda: rig.states[-1].angles == (0.0,) * 8)
        assert all(states.speeds[0] < 1000.0 for states in rig.states[-20:])  # no speed from the jump
        stored = CanConfig.from_yaml(path)
        assert [drive.units.home_counts for drive in stored.drives] == [4000 * (k + 1) for k in range(8)]
        wait_until(lambda: rig.master.enable() is None)
        assert rig.master.set_home() == "the drives are enabling: disable them first"
        wait_until(lambda: rig.state is DriverState.ENABLED)
    finally:
        rig.master.stop()


def test_home_is_not_set_without_the_positions(rig, far_end, wait_until):
    wait_until(lambda: rig.state is DriverState.DISABLED)
    far_end.drives[6].answers_sync = False
    wait_until(lambda: rig.master.set_home() == "motor_7 does not report its position")


def test_the_error_of_a_drive_that_was_in_fault_before_is_known(config, ports, far_end, wait_until):
    drive = far_end.drives[2]
    drive.status = FAULT
    drive.objects[0x603F, 0] = bytes.fromhex("05 73")
    drive.objects[0x1001, 0] = bytes.fromhex("81")
    rig = Rig(config, ports)
    rig.master.start()
    try:
        wait_until(lambda: rig.state is DriverState.FAULT)
        wait_until(lambda: rig.master.snapshot().drives[2].errors)
        assert (
            rig.master.snapshot().drives[2].errors[0].text == "incremental sensor 1 fault (error code 0x7305)"
        )
    finally:
        rig.master.stop()
