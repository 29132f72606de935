"""The control cycle by its bytes: no bus, no thread, no clock."""

import itertools
import math
import struct
from dataclasses import replace

import pytest

from cspr_drivers.canopen.units import wrapped
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.config.can_file import BrakeOutput
from cspr_drivers.devices.setup import DriveFacts
from cspr_drivers.drives.cycle import DriveCycle
from cspr_drivers.drives.home_position import with_home
from cspr_drivers.errors import FrameError
from cspr_msgs_py.vocabulary import DriverState

# Status words, IEC 61800-7-201; bit 14 of the shipped drives: brake open.
AT_REST, READY, SWITCHED_ON, ENABLED, QUICK_STOP = 0x50, 0x31, 0x33, 0x5037, 0x4017
PERIOD = 0.01
BEGIN = 1000.0


class Robot:
    """Drives that answer each SYNC, and what the cycle sends them."""

    def __init__(self, config):
        self.cycle = DriveCycle(config)
        self.now = BEGIN
        self.stamp = 0
        self.count = len(config.drives)
        self.status = [AT_REST] * self.count
        self.position = 0  # of all drives
        self.stepped = {}  # by how much those of some are off
        for index in range(self.count):
            self.cycle.configured(self.now, index, DriveFacts(4.2, None, False, 0, 0, 0))

    def answer(self, index, torque=0):
        position = self.position + self.stepped.get(index, 0)
        data = struct.pack("<Hih", self.status[index], position, torque)
        return self.cycle.feedback(self.now + 1e-3, index, data)

    def turn(self, torque=None):
        """Run one cycle; return the states and the data of each RPDO, by COB-ID, in order."""
        self.now += PERIOD
        self.stamp += round(1e9 * PERIOD)
        self.cycle.sync(self.now, self.stamp)
        self.cycle.supervised(self.now, self.stamp - round(1e9 * PERIOD))
        frames = self.cycle.step(self.now)
        states = [self.answer(index) for index in range(self.count)]
        assert states[:-1] == [None] * (self.count - 1)
        if torque is not None:
            for index in range(self.count):
                frames += self.cycle.command(self.now + 2e-3, index, self.stamp, torque)
        return states[-1], [(frame.cob_id, frame.data.hex(" ")) for frame in frames]

    def enable(self):
        self.turn(1.0)
        self.turn(1.0)
        assert self.cycle.enable(self.now) is None
        for status in (READY, SWITCHED_ON, ENABLED, ENABLED):
            self.turn(1.0)
            self.status = [status] * self.count
        self.turn(1.0)
        self.turn(1.0)
        assert self.cycle.group.state is DriverState.ENABLED


@pytest.fixture
def robot(config):
    return Robot(config)


@pytest.fixture
def enabled(robot):
    robot.enable()
    return robot


def test_enabling_goes_through_the_control_words_in_turn(robot):
    robot.turn(1.0)
    robot.turn(1.0)
    assert robot.cycle.enable(robot.now) is None
    sent = []
    for status in (READY, SWITCHED_ON, ENABLED, ENABLED):
        sent += [data for cob_id, data in robot.turn()[1] if cob_id == 0x201]
        robot.status = [status] * robot.count
    assert list(dict.fromkeys(sent)) == ["06 00 c8 00", "07 00 c8 00", "0f 00 c8 00"]


def test_a_torque_goes_out_in_the_call_that_brings_it_with_the_control_word(enabled):
    enabled.turn()
    enabled.cycle.sync(enabled.now + PERIOD, enabled.stamp)
    (frame,) = enabled.cycle.command(enabled.now, 0, enabled.stamp, 2.0)
    assert (frame.bus, frame.cob_id, frame.data) == ("main", 0x201, bytes.fromhex("0F 00 90 01"))
    assert frame.deadline == enabled.now + 2 * PERIOD
    (frame,) = enabled.cycle.command(enabled.now, 1, enabled.stamp, 2.0)  # polarity -1
    assert (frame.cob_id, frame.data) == (0x202, bytes.fromhex("0F 00 70 FE"))


def test_the_heartbeat_comes_when_it_is_due_before_what_the_drives_are_told(robot):
    heartbeats = [robot.turn()[1][:1] == [(0x77F, "05")] for _ in range(7)]
    assert heartbeats == [True, False, False, True, False, False, True]  # of 30 ms


def test_states_are_those_of_one_sync(robot):
    assert robot.turn()[0] is None  # no speed yet
    robot.position = 131072
    states, _ = robot.turn()
    assert states.stamp_ns == robot.stamp
    assert states.angles[:2] == pytest.approx((2 * math.pi, -2 * math.pi))
    assert states.speeds[:2] == pytest.approx((2 * math.pi / PERIOD, -2 * math.pi / PERIOD))


def test_a_sign_of_life_counts_when_the_supervisor_hears_what_the_drives_answer(enabled, config):
    limit = round(1e9 * config.timeouts.supervisor)
    stamp = enabled.stamp
    enabled.cycle.supervised = lambda now, stamp_ns: None  # the supervisor of the bench is gone
    watch = DriveCycle.supervised
    for _ in range(30):
        watch(enabled.cycle, enabled.now, enabled.stamp)
        enabled.turn(1.0)
    assert enabled.cycle.group.state is DriverState.ENABLED
    stamp = enabled.stamp
    for _ in range(2 * limit // round(1e9 * PERIOD) + 2):
        watch(enabled.cycle, enabled.now, stamp)  # it hears no more of them
        watch(enabled.cycle, enabled.now, enabled.stamp + 10 * limit)  # of another time
        enabled.turn(1.0)
    assert enabled.cycle.group.state is DriverState.FAULT
    assert "no sign of life" in enabled.cycle.group.cause


def test_a_bad_torque_is_answered_with_a_stop_of_all_drives(enabled):
    frames = enabled.cycle.command(enabled.now, 1, enabled.stamp, math.nan)
    assert [frame.cob_id for frame in frames] == [0x201 + index for index in range(8)]
    assert [frame.data[:2] for frame in frames] == [b"\x02\x00"] * 8
    assert frames[1].data == bytes.fromhex("02 00 38 FF")  # the torque that was
    assert enabled.cycle.group.cause == "motor_2: torque command of nan N m is not finite"
    assert enabled.cycle.command(enabled.now, 1, enabled.stamp, 1.0) == []


def test_a_control_word_is_sent_again_until_the_drive_is_there(enabled):
    assert enabled.turn()[1] in ([], [(0x77F, "05")])
    enabled.cycle.quick_stop(enabled.now, "commanded")
    enabled.turn()
    words = [data[:5] for cob_id, data in enabled.turn()[1] if cob_id == 0x201]
    assert words == ["02 00"]


def test_sync_waits_for_answers_but_not_for_ever(enabled):
    enabled.cycle.sync(enabled.now, enabled.stamp)
    assert not enabled.cycle.wants_sync(enabled.now + PERIOD)
    assert not enabled.cycle.wants_sync(enabled.now + 2 * PERIOD)
    assert enabled.cycle.wants_sync(enabled.now + 3 * PERIOD)
    assert enabled.cycle.postponed == 2


def test_a_command_counts_as_fresh_only_when_it_was_sent_in_its_cycle(enabled):
    for late in (False, True):
        enabled.turn()
        before = enabled.cycle.watch.statistics().late_commands
        (frame,) = enabled.cycle.command(enabled.now, 0, enabled.stamp, 1.0)
        if late:
            enabled.cycle.sync(enabled.now + PERIOD, enabled.stamp + 1)
        enabled.cycle.sent(enabled.now, *frame.command)
        assert enabled.cycle.watch.statistics().late_commands - before == late


def test_an_overtaken_command_is_not_sent(enabled):
    before = enabled.stamp
    enabled.turn(1.0)
    assert enabled.cycle.command(enabled.now, 0, before, 1.0) == []


def test_two_torques_for_one_sync_come_from_two_publishers(enabled):
    enabled.turn(1.0)
    frames = enabled.cycle.command(enabled.now, 2, enabled.stamp, 1.0)
    assert {frame.data[:2] for frame in frames} == {b"\x02\x00"}  # quick stop of all drives
    assert enabled.cycle.group.cause == "motor_3: two torque commands for one SYNC: two nodes publish them"


def test_a_frame_cut_short_changes_nothing(enabled):
    with pytest.raises(FrameError, match="frame of 7 bytes where 8 were expected"):
        enabled.cycle.feedback(enabled.now, 0, bytes(7))
    assert enabled.cycle.watch.missing == ()


def test_a_step_that_no_motor_makes_is_never_published(enabled):
    enabled.stepped = {2: 5 * 131072}
    assert enabled.turn(1.0)[0] is None
    group = enabled.cycle.group
    assert group.state is DriverState.FAULT
    assert group.cause == "motor_3: its position steps by 31.42 rad within 10 ms: no motor is as fast"
    words = {data[:5] for cob_id, data in enabled.turn()[1] if 0x201 <= cob_id <= 0x208}
    assert words == {"02 00"}  # quick stop of all drives
    enabled.status = [AT_REST] * enabled.count
    enabled.stepped = {}
    assert [enabled.turn()[0] for _ in range(3)] == [None] * 3  # the encoder is as it was: it is not believed
    assert enabled.cycle.home_refusal(enabled.now) == (
        "the position of motor_3 is not believed: reset the fault first"
    )
    enabled.stepped = {2: 131072}  # the operator has seen to it
    assert group.fault_reset(enabled.now) is None
    states = [enabled.turn()[0] for _ in range(4)][-1]
    assert states.angles[2] == pytest.approx(2 * math.pi)
    assert states.speeds[2] == 0.0
    assert group.state is DriverState.DISABLED


def test_a_step_at_rest_is_a_fault_as_well(robot):
    robot.turn(1.0)
    robot.turn(1.0)
    robot.stepped = {0: -(2**30)}
    assert robot.turn(1.0)[0] is None
    assert robot.cycle.group.cause.startswith("motor_1: its position steps by -51471.85 rad within 10 ms")
    assert "a fault is latched" in robot.cycle.enable(robot.now)


def test_nobody_notices_that_a_counter_goes_round(config):
    robot = Robot(with_home(config, [2**31 - 1000] * len(config.drives)))
    robot.position = 2**31 - 1000
    robot.enable()
    angles = []
    for _ in range(8):
        robot.position = wrapped(robot.position + 500)
        states, _ = robot.turn(1.0)
        angles.append(states.angles[0])
        speed = 500 * 2 * math.pi / 131072 / PERIOD
        assert states.speeds[:2] == pytest.approx((speed, -speed))
    assert robot.position < 0
    assert angles == pytest.approx([(k + 1) * 500 * 2 * math.pi / 131072 for k in range(8)])
    assert robot.cycle.group.state is DriverState.ENABLED


def test_a_velocity_that_no_motor_has_is_never_published(mapping):
    mapping["velocity_source"] = "velocity_actual"
    mapping["pdo"]["drive_tpdo_2"] = ["velocity_actual"]
    cycle = DriveCycle(CanConfig.from_mapping(mapping, "can.yaml"))
    facts = DriveFacts(4.2, 1e-3, False, 0, 0, 0)  # counted in thousandths of rad/s
    for index in range(8):
        cycle.configured(BEGIN, index, facts)
    for turn, velocity in enumerate((400_000, 1_000_001)):
        now = BEGIN + 0.004 * turn
        cycle.sync(now, turn + 1)
        cycle.step(now)
        for index in range(8):
            cycle.feedback(now, index, struct.pack("<Hih", AT_REST, 0, 0))
        states = [cycle.velocity(now, index, struct.pack("<i", velocity)) for index in range(8)][-1]
        assert (states is None) is (turn == 1)
    assert cycle.group.cause == "motor_1: its speed is said to be 1000 rad/s: no motor is as fast"


def test_the_first_answer_counts_and_one_too_many_is_a_fault(enabled):
    for turn in range(3):
        enabled.now += PERIOD
        enabled.stamp += round(1e9 * PERIOD)
        enabled.cycle.sync(enabled.now, enabled.stamp)
        enabled.cycle.step(enabled.now)
        for index in range(enabled.count - 1):
            assert enabled.answer(index) is None
        # a second drive with the node id of motor_3, at another place and in another state
        other = struct.pack("<Hih", AT_REST, 100_000, 2000)
        assert enabled.cycle.feedback(enabled.now + 1e-3, 2, other) is None
        assert enabled.answer(7).angles == (0.0,) * enabled.count
        for index in range(enabled.count):
            enabled.cycle.command(enabled.now + 2e-3, index, enabled.stamp, 1.0)
        assert enabled.cycle.group.state is (DriverState.FAULT if turn == 2 else DriverState.ENABLED)
    assert enabled.cycle.group.cause == "motor_3 answers one SYNC twice: another device has its node id"
    assert enabled.cycle.watch.statistics().repeated_feedback == 3


@pytest.mark.parametrize("counts", [0, 20_000, 104_000, 400_000])
def test_two_drives_with_one_node_id_are_told_apart_from_one_whose_encoder_slips(enabled, counts):
    """The other one answers first."""
    for _ in range(4):
        enabled.now += PERIOD
        enabled.stamp += round(1e9 * PERIOD)
        enabled.cycle.sync(enabled.now, enabled.stamp)
        enabled.cycle.step(enabled.now)
        enabled.cycle.feedback(enabled.now, 2, struct.pack("<Hih", ENABLED, counts, 200))
        for index in range(enabled.count):
            enabled.answer(index)
            enabled.cycle.command(enabled.now + 2e-3, index, enabled.stamp, 1.0)
    assert enabled.cycle.group.state is DriverState.FAULT
    assert enabled.cycle.group.cause.startswith(
        "motor_3 answers one SYNC twice: another device has its node id"
    )


REVOLUTION = 131_072


def at_rest_away_from_home(robot, position):
    """Let all drives stand at a position value, slowly enough for what a motor can do."""
    while robot.position != position:
        robot.position += max(-2000, min(2000, position - robot.position))
        robot.turn()
    robot.turn()


def wait(robot, duration):
    """Let time pass, s."""
    end = robot.now + duration
    while robot.now < end:
        robot.turn()


def test_another_home_pose_is_set_only_when_asked_for_twice(robot):
    at_rest_away_from_home(robot, REVOLUTION)
    told = robot.cycle.home_refusal(robot.now)
    assert "motor_1 +6.3 rad, motor_2 -6.3 rad" in told
    assert "call again within 10 s" in told
    wait(robot, 9.0)
    assert robot.cycle.home_refusal(robot.now) is None
    assert robot.cycle.home_refusal(robot.now) == told  # and once more for the next time


def test_a_second_call_that_is_late_or_of_another_pose_is_a_first_one(robot):
    at_rest_away_from_home(robot, REVOLUTION)
    assert robot.cycle.home_refusal(robot.now) is not None
    wait(robot, 11.0)
    assert robot.cycle.home_refusal(robot.now) is not None
    at_rest_away_from_home(robot, 2 * REVOLUTION)
    assert "motor_1 +12.6 rad" in robot.cycle.home_refusal(robot.now)


def test_the_home_pose_that_is_known_can_be_set_at_once(robot):
    at_rest_away_from_home(robot, REVOLUTION // 8)
    assert robot.cycle.home_refusal(robot.now) is None


def test_drives_at_rest_get_their_frame_often_enough(robot):
    """A drive watches for it in any state (1400h:05)."""
    sent = {0x201 + index: [] for index in range(robot.count)}
    for _ in range(200):
        for cob_id, data in robot.turn()[1]:
            if cob_id in sent:
                sent[cob_id].append((robot.now, data))
    limit = robot.cycle.config.timeouts.rpdo
    for frames in sent.values():
        times = [time for time, _ in frames]
        assert max(later - earlier for earlier, later in itertools.pairwise(times)) < 0.5 * limit
        assert robot.now - times[-1] < 0.5 * limit
        assert {data for _, data in frames} == {"00 00 00 00"}  # disable voltage, no torque


def slip(robot, index, increments, cycles=3):
    for _ in range(cycles):
        robot.stepped[index] = robot.stepped.get(index, 0) + increments
        robot.turn(1.0)


def test_a_brake_that_slips_at_rest_is_a_fault_with_how_far_so_far(robot):
    for _ in range(30):
        robot.turn(1.0)
    assert robot.cycle.group.state is DriverState.DISABLED
    slip(robot, 2, 10_000)  # 1.4 rad
    group = robot.cycle.group
    assert group.state is DriverState.FAULT
    assert group.cause == (
        "motor_3 turns with its brake closed, by +1.4 rad so far: its brake slips, or its encoder"
    )
    slip(robot, 2, 10_000)
    assert group.drives[2].slipped == pytest.approx(2.9)
    assert not any(drive.slipped for drive in group.drives[:2] + group.drives[3:])
    refused = robot.cycle.fault_reset(robot.now)
    assert refused == "not stopped yet: motor_3 turns with its brake closed: support the load"
    for _ in range(60):
        robot.turn(1.0)
    assert robot.cycle.fault_reset(robot.now) is None
    robot.turn(1.0)
    robot.turn(1.0)
    assert group.state is DriverState.DISABLED
    assert group.drives[2].slipped == 0.0


def test_a_brake_that_slips_after_a_fault_is_told_besides_its_cause(enabled):
    enabled.cycle.quick_stop(enabled.now, "a test")
    enabled.status = [AT_REST] * enabled.count
    for _ in range(30):
        enabled.turn(1.0)
    slip(enabled, 0, 10_000)
    assert enabled.cycle.group.cause.startswith("a test; motor_1 turns with its brake closed, by ")


def test_another_home_is_no_slip(robot):
    for _ in range(30):
        robot.turn(1.0)
    robot.cycle.set_home([1_000_000] * robot.count)
    for _ in range(30):
        robot.turn(1.0)
    assert robot.cycle.group.state is DriverState.DISABLED


@pytest.fixture
def commanding(config):
    """A robot whose brakes the host commands: bit 16 is set while one is open."""
    return Robot(replace(config, brake_output=BrakeOutput(16, 0)))


def outputs(robot):
    return [data for cob_id, data in robot.turn(1.0)[1] if cob_id == 0x301]


OPEN, CLOSED = "00 00 01 00", "00 00 00 00"


def test_a_brake_that_the_host_commands_is_closed_at_rest_and_left_to_the_drive_in_operation(commanding):
    robot = commanding
    robot.turn()
    assert outputs(robot) == [CLOSED]
    assert outputs(robot) == []
    assert robot.cycle.enable(robot.now) is None
    assert outputs(robot) == [OPEN]


def test_a_stop_under_control_closes_the_brakes_under_torque_and_takes_it_only_then(commanding):
    robot = commanding
    robot.turn(1.0)
    robot.enable()
    robot.cycle.disable(robot.now)
    frames = robot.turn(1.0)[1]
    assert ("769", CLOSED) in [(str(cob_id), data) for cob_id, data in frames]
    assert [data for cob_id, data in frames if cob_id == 0x201] == ["0f 00 c8 00"]  # 1 N m of 5
    robot.status = [ENABLED & ~0x4000] * robot.count
    sent = []
    while robot.cycle.group.proof is not None:
        sent += [data for cob_id, data in robot.turn(1.0)[1] if cob_id == 0x201]
    words = [data[:5] for data in sent]
    assert words == sorted(words, reverse=True)
    assert sent[words.index("07 00") - 1] == "0f 00 00 00"
    assert robot.cycle.group.state is DriverState.STOPPING
    assert sent[-1].startswith("07 00")
