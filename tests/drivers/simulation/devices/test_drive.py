import math
import struct

import pytest
from tests.drivers.simulation.conftest import DriveDesk

from cspr_drivers.canopen.cia402 import State, decode_state
from cspr_drivers.canopen.nmt import NmtCommand, NmtState
from cspr_drivers.config.can_file import BrakeOutput
from cspr_drivers.simulation.devices.canopen_codes import EmergencyCode, SdoAbort

NODE_ID = 5
MASTER_ID = 127
OPEN_DELAY = 0.03  # s, as on the desk
CLOSE_DELAY = 0.02
DAMPING = 0.2

BRAKE_OPEN = 1 << 14
INTERNAL_LIMIT = 1 << 11


# Start


def test_boot_up_and_identity(drive_desk):
    desk = drive_desk()
    assert desk.frames(0x700 + NODE_ID) == [b"\x00"]
    assert desk.drive.nmt_state is NmtState.PRE_OPERATIONAL
    assert desk.read(0x1000, 0) == 0x00020192
    assert desk.read(0x6502, 0) & 1 << 9
    assert desk.read(0x6076, 0) == 5000
    assert desk.read(0x608F, 1) == 65536
    assert decode_state(desk.status()) is State.SWITCH_ON_DISABLED


def test_process_data_only_in_operational(drive_desk):
    desk = drive_desk()
    desk.map(0x1400, desk.RPDO, 255, (0x60400010, 0x60710010))
    desk.map(0x1800, desk.TPDO, 1, (0x60410010,))
    desk.command(0x06)
    desk.sync()
    assert desk.frames(desk.TPDO) == []
    assert decode_state(desk.status()) is State.SWITCH_ON_DISABLED
    desk.nmt(NmtCommand.START)
    desk.command(0x06)
    desk.sync()
    (frame,) = desk.frames(desk.TPDO)
    assert decode_state(int.from_bytes(frame, "little")) is State.READY_TO_SWITCH_ON


# Process data


def test_tpdo_carries_the_values_at_the_sync(desk):
    desk.enable(torque=-220)
    desk.plant.angles[0] = -2.0 * math.pi
    desk.clock.time += 0.004
    desk.sync()
    (frame,) = desk.frames(desk.TPDO)
    status, position, torque = struct.unpack("<Hih", frame)
    assert decode_state(status) is State.OPERATION_ENABLED
    assert status & BRAKE_OPEN
    assert position == 1000 - 65536
    assert torque == -220
    assert desk.plant.time == pytest.approx(desk.machine.now(), abs=1e-6)


def test_polarity_turns_both_ways_round(drive_desk):
    desk = drive_desk(polarity=-1)
    desk.configure()
    desk.enable(torque=220)
    assert desk.plant.torque[0] == pytest.approx(-1.1)
    desk.plant.angles[0] = 2.0 * math.pi
    desk.clock.time += 0.004
    desk.sync()
    assert struct.unpack("<Hih", desk.frames(desk.TPDO)[-1])[1:] == (1000 - 65536, 220)


def test_position_wraps_like_a_32_bit_counter(desk):
    desk.plant.angles[0] = 2.0 * math.pi * (2**31 - 500) / 65536
    desk.clock.time += 0.004
    desk.sync()
    position = struct.unpack("<Hih", desk.frames(desk.TPDO)[-1])[1]
    assert position == -(2**31) + 500


def test_speed_in_counts_a_second(desk):
    desk.plant.speeds[0] = -math.pi
    desk.clock.time += 0.004
    assert desk.read(0x606C, 0, signed=True) == -32768


def test_torque_of_the_enabling_frame_is_on_with_it(desk):
    desk.command(0x06)
    desk.command(0x07)
    desk.clock.time += 0.5
    desk.command(0x0F, 300)
    now = desk.machine.now()
    assert desk.plant.torque_log == [(pytest.approx(now), pytest.approx(1.5))]
    assert desk.plant.brake_closed[0]
    desk.wait(OPEN_DELAY + 0.001)
    assert not desk.plant.brake_closed[0]


def test_torque_is_not_applied_before_operation_is_enabled(desk):
    for word in (0x06, 0x07):
        desk.command(word, 300)
        assert desk.plant.torque[0] == 0.0


def test_max_torque_limits_and_says_so(desk):
    desk.enable(torque=2500)
    assert desk.plant.torque[0] == pytest.approx(10.0)
    assert desk.status() & INTERNAL_LIMIT
    desk.command(0x0F, -1900)
    assert desk.plant.torque[0] == pytest.approx(-9.5)
    assert not desk.status() & INTERNAL_LIMIT


def test_event_driven_tpdo_on_change_and_by_timer(drive_desk):
    desk = drive_desk()
    desk.map(0x1800, desk.TPDO, 255, (0x60410010,), timer=50)
    desk.map(0x1400, desk.RPDO, 255, (0x60400010,))
    desk.nmt(NmtCommand.START)
    desk.wait(0.002)
    assert len(desk.frames(desk.TPDO)) == 1
    desk.send(desk.RPDO, b"\x06\x00")
    desk.wait(0.002)
    assert len(desk.frames(desk.TPDO)) == 1
    desk.wait(0.12)
    assert len(desk.frames(desk.TPDO)) == 2


@pytest.mark.parametrize("data", [b"", b"\x06\x00\x00", b"\x06\x00\x00\x00\x00"])
def test_rpdo_of_wrong_length_is_not_used(desk, data):
    desk.send(desk.RPDO, data)
    assert desk.drive.automaton.state is State.SWITCH_ON_DISABLED
    assert desk.emergencies() == [EmergencyCode.PDO_LENGTH]
    assert desk.read(0x1001, 0) == 0x11


# Stopping


def test_quick_stop_keeps_the_torque_it_had_and_damps(desk):
    desk.enable(torque=-220)
    desk.plant.speeds[0] = 30.0
    desk.command(0x02, 0)
    assert decode_state(desk.status()) is State.QUICK_STOP_ACTIVE
    assert desk.plant.torque[0] == pytest.approx(-1.1)
    assert desk.plant.damping[0] == DAMPING
    desk.wait(0.1)
    assert not desk.plant.brake_closed[0]
    desk.plant.speeds[0] = 0.2
    desk.wait(CLOSE_DELAY - 0.002)
    assert desk.plant.torque[0] == pytest.approx(-1.1)
    desk.wait(0.006)
    assert desk.plant.brake_closed[0]
    assert desk.plant.torque[0] == 0.0
    assert desk.plant.damping[0] == 0.0
    assert decode_state(desk.status()) is State.SWITCH_ON_DISABLED
    assert not desk.status() & BRAKE_OPEN


def test_quick_stop_believes_a_frozen_encoder(desk):
    """The drive sees a motor at rest: it brakes nothing, and closes the brake onto a motor that turns."""
    desk.enable(torque=-220)
    desk.plant.speeds[0] = 30.0
    desk.drive.encoder.frozen = True
    desk.drive.apply_faults()
    desk.command(0x02, 0)
    assert desk.plant.damping[0] == 0.0
    desk.wait(CLOSE_DELAY + 0.004)
    assert desk.plant.brake_closed[0]


def test_quick_stop_brakes_the_speed_that_a_drifting_encoder_shows(desk):
    desk.enable(torque=-220)
    desk.plant.speeds[0] = -2.0
    desk.drive.encoder.drift = 32.0
    desk.drive.apply_faults()
    assert desk.plant.torque[0] == pytest.approx(-1.1)
    desk.command(0x02, 0)
    assert desk.plant.damping[0] == DAMPING
    assert desk.plant.torque[0] == pytest.approx(-1.1 - DAMPING * 32.0)
    desk.wait(0.1)
    assert not desk.plant.brake_closed[0]


def test_answers_show_what_the_encoder_does(desk):
    desk.enable()
    desk.plant.angles[0], desk.plant.speeds[0] = 3.0, 10.0
    desk.clock.time += 0.004
    desk.sync()
    desk.drive.encoder.frozen = True
    desk.plant.angles[0] = 4.0
    desk.clock.time += 0.004
    desk.sync()
    counts = 65536 / (2.0 * math.pi)
    assert desk.read(0x6064, 0, signed=True) == pytest.approx(1000 + 3.0 * counts, abs=1)
    assert desk.read(0x606C, 0, signed=True) == 0
    desk.drive.encoder.frozen = False
    desk.drive.latch()
    assert desk.read(0x6064, 0, signed=True) == pytest.approx(1000 + 4.0 * counts, abs=1)
    assert desk.read(0x606C, 0, signed=True) == pytest.approx(10.0 * counts, abs=1)


def test_disable_follows_the_target_until_the_brake_holds(desk):
    desk.enable(torque=-220)
    desk.command(0x07, -230)
    desk.wait(0.01)
    desk.command(0x07, -240)
    assert decode_state(desk.status()) is State.OPERATION_ENABLED
    assert desk.plant.torque[0] == pytest.approx(-1.2)
    desk.wait(CLOSE_DELAY + 0.001)
    assert decode_state(desk.status()) is State.SWITCHED_ON
    assert desk.plant.brake_closed[0]
    assert desk.plant.torque[0] == 0.0


def lose_rpdos(desk):
    desk.wait(0.15)


def lose_heartbeat(desk):
    desk.command(0x0F, -220)
    for _ in range(50):
        desk.wait(0.01)
        desk.command(0x0F, -220)


def leave_operational(desk):
    desk.nmt(NmtCommand.ENTER_PRE_OPERATIONAL)


def stop_node(desk):
    desk.nmt(NmtCommand.STOP)


def reset_node(desk):
    desk.nmt(NmtCommand.RESET_NODE)


LOSSES = [
    (lose_rpdos, EmergencyCode.RPDO_TIMEOUT),
    (lose_heartbeat, EmergencyCode.HEARTBEAT),
    (leave_operational, EmergencyCode.COMMUNICATION),
    (stop_node, EmergencyCode.COMMUNICATION),
    (reset_node, EmergencyCode.COMMUNICATION),
]


@pytest.mark.parametrize(("lose", "code"), LOSSES)
@pytest.mark.parametrize(("option", "after"), [(1, State.FAULT), (3, State.SWITCH_ON_DISABLED)])
def test_lost_connection_stops_the_motor_and_closes_the_brake(drive_desk, lose, code, option, after):
    desk = drive_desk()
    desk.configure(rpdo_timeout=100, abort_option=option)
    assert desk.write(0x1016, 1, MASTER_ID << 16 | 300, 4) == 0
    desk.send(0x700 + MASTER_ID, b"\x05")
    desk.enable(torque=-220)
    lose(desk)
    assert code in desk.emergencies()
    torques = [torque for _, torque in desk.plant.torque_log]
    assert torques[0] == pytest.approx(-1.1)
    desk.wait(0.1)
    assert desk.plant.brake_closed[0]
    assert desk.plant.torque[0] == 0.0
    assert desk.drive.automaton.state is after
    # never without torque while the brake was open
    assert {round(torque, 6) for _, torque in desk.plant.torque_log} == {-1.1, 0.0}


def test_an_rpdo_that_does_not_come_is_told_at_rest_too(drive_desk):
    desk = drive_desk()
    desk.configure(rpdo_timeout=100)
    desk.command(0x00)
    for _ in range(10):
        desk.wait(0.05)
        desk.command(0x00)
    assert desk.emergencies() == []
    desk.wait(0.15)
    assert desk.emergencies() == [EmergencyCode.RPDO_TIMEOUT]
    assert desk.drive.automaton.state is State.SWITCH_ON_DISABLED


def test_operation_is_not_kept_without_heartbeat(desk):
    assert desk.write(0x1016, 1, MASTER_ID << 16 | 100, 4) == 0
    desk.send(0x700 + MASTER_ID, b"\x05")
    desk.wait(0.2)
    assert desk.emergencies() == []
    for word in (0x06, 0x07, 0x0F):
        desk.command(word)
    desk.wait(0.1)
    assert desk.drive.automaton.state is State.FAULT
    assert desk.emergencies() == [EmergencyCode.HEARTBEAT]


def test_silence_does_not_count_for_a_late_tick(desk):
    assert desk.write(0x1016, 1, MASTER_ID << 16 | 100, 4) == 0
    desk.send(0x700 + MASTER_ID, b"\x05")
    desk.enable()
    desk.clock.time += 0.5
    desk.drive.tick(desk.machine.now(), supervise=False)
    assert desk.drive.automaton.state is State.OPERATION_ENABLED
    desk.drive.tick(desk.machine.now())
    assert desk.drive.automaton.state is State.FAULT_REACTION_ACTIVE


@pytest.mark.parametrize(("behaviour", "state"), [(0, NmtState.PRE_OPERATIONAL), (2, NmtState.STOPPED)])
def test_error_behaviour(desk, behaviour, state):
    assert desk.write(0x1029, 1, behaviour, 1) == 0
    assert desk.write(0x1016, 1, MASTER_ID << 16 | 100, 4) == 0
    desk.send(0x700 + MASTER_ID, b"\x05")
    desk.wait(0.2)
    assert desk.drive.nmt_state is state


def test_own_fault_is_reset_by_a_rising_edge_only(desk):
    desk.enable(torque=-220)
    desk.drive.fail(EmergencyCode.OVERTEMPERATURE)
    assert decode_state(desk.status()) is State.FAULT_REACTION_ACTIVE
    desk.wait(0.1)
    assert decode_state(desk.status()) is State.FAULT
    assert desk.plant.brake_closed[0]
    assert desk.read(0x603F, 0) == 0x4310
    assert desk.read(0x1003, 0) == 1
    assert desk.read(0x1003, 1) == 0x4310
    assert desk.emergencies() == [0x4310]
    for word in (0x06, 0x07, 0x0F):
        desk.command(word)
    assert decode_state(desk.status()) is State.FAULT
    desk.command(0x80)
    assert decode_state(desk.status()) is State.SWITCH_ON_DISABLED
    assert desk.emergencies() == [0]
    assert desk.read(0x603F, 0) == 0
    assert desk.read(0x1001, 0) == 0


def test_reset_node_takes_every_value_back(desk):
    assert desk.write(0x1017, 0, 100, 2) == 0
    desk.nmt(NmtCommand.RESET_NODE, node_id=0)
    assert desk.frames(0x700 + NODE_ID) == [b"\x00"]
    assert desk.read(0x1017, 0) == 0
    assert desk.read(0x6060, 0) == 0
    assert desk.read(0x6072, 0) == 1000
    assert desk.read(0x1600, 0) == 1
    assert desk.read(0x6076, 0) == 5000


def test_reset_communication_keeps_the_application(desk):
    desk.nmt(NmtCommand.RESET_COMMUNICATION)
    assert desk.read(0x1600, 0) == 1
    assert desk.read(0x6072, 0) == 2000


def test_other_nodes_commands_and_short_frames_are_ignored(desk):
    desk.nmt(NmtCommand.STOP, node_id=NODE_ID + 1)
    desk.send(0x000, b"\x02")
    desk.send(0x000, bytes([77, NODE_ID]))
    assert desk.drive.nmt_state is NmtState.OPERATIONAL


def test_heartbeat_carries_the_nmt_state(desk):
    assert desk.write(0x1017, 0, 100, 2) == 0
    desk.wait(0.35)
    assert desk.frames(0x700 + NODE_ID) == [b"\x05"] * 4
    desk.nmt(NmtCommand.STOP)
    desk.wait(0.1)
    assert desk.frames(0x700 + NODE_ID) == [b"\x04"]


def test_stopped_node_does_not_answer_sdo(desk):
    desk.nmt(NmtCommand.STOP)
    desk.send(0x600 + NODE_ID, struct.pack("<BHBI", 0x40, 0x1000, 0, 0))
    assert desk.frames(0x580 + NODE_ID) == []


# Option codes and modes


def reach_closed_brake(desk, limit=1.0):
    """Let time pass until the brake holds; return how long that took, s, and the torques meanwhile."""
    begin, logged = desk.clock.time, len(desk.plant.torque_log)
    while not desk.plant.brake_closed[0]:
        desk.wait(1e-3)
        assert desk.clock.time - begin < limit
    return desk.clock.time - begin, [torque for _, torque in desk.plant.torque_log[logged:]]


STOPPING = [
    # object, value, control word, state in the end, damping on the way, whether torque goes before the brake holds
    (0x605A, 1, 0x02, State.SWITCH_ON_DISABLED, 0.5 * DAMPING, False),
    (0x605A, 2, 0x02, State.SWITCH_ON_DISABLED, DAMPING, False),
    (0x605B, 1, 0x06, State.READY_TO_SWITCH_ON, 0.5 * DAMPING, False),
    (0x605C, 1, 0x07, State.SWITCHED_ON, 0.5 * DAMPING, False),
    (0x605A, 2, 0x00, State.SWITCH_ON_DISABLED, 0.0, True),  # disable voltage asks no option code
]


@pytest.mark.parametrize(("option", "value", "word", "state", "damping", "coasts"), STOPPING)
def test_the_option_codes_say_how_operation_ends(desk, option, value, word, state, damping, coasts):
    assert desk.write(option, 0, value, 2) == 0
    desk.enable(torque=-220)
    desk.plant.speeds[0] = 30.0
    desk.command(word, -220)
    assert desk.plant.damping[0] == pytest.approx(damping)
    assert desk.plant.torque[0] == pytest.approx(0.0 if coasts else -1.1)
    assert not desk.plant.brake_closed[0]
    assert bool(desk.status() & BRAKE_OPEN)
    desk.plant.speeds[0] = 0.0
    duration, _ = reach_closed_brake(desk)
    assert duration == pytest.approx(CLOSE_DELAY, abs=3e-3)
    assert desk.plant.torque[0] == 0.0
    assert decode_state(desk.status()) is state


@pytest.mark.parametrize(("value", "damping"), [(1, 0.5), (2, 1.0)])
def test_fault_reaction_option(desk, value, damping):
    assert desk.write(0x605E, 0, value, 2) == 0
    desk.enable(torque=-220)
    desk.plant.speeds[0] = 30.0
    desk.drive.fail(EmergencyCode.OVERTEMPERATURE)
    assert decode_state(desk.status()) is State.FAULT_REACTION_ACTIVE
    assert desk.plant.damping[0] == pytest.approx(damping * DAMPING)
    assert desk.plant.torque[0] == pytest.approx(-1.1)
    desk.plant.speeds[0] = 0.0
    reach_closed_brake(desk)
    assert decode_state(desk.status()) is State.FAULT


@pytest.mark.parametrize(
    ("option", "state"), [(1, State.FAULT_REACTION_ACTIVE), (3, State.QUICK_STOP_ACTIVE)]
)
def test_abort_connection_option(drive_desk, option, state):
    desk = drive_desk()
    desk.configure(rpdo_timeout=50, abort_option=option)
    desk.enable(torque=-220)
    desk.plant.speeds[0] = 30.0
    desk.wait(0.053)
    assert decode_state(desk.status()) is state
    assert desk.plant.torque[0] == pytest.approx(-1.1)
    assert desk.emergencies() == [EmergencyCode.RPDO_TIMEOUT]


def test_mappings_are_locked_in_operational(desk):
    assert desk.write(0x1401, 1, 0x8000_0301, 4) == 0
    assert desk.write(0x1601, 0, 0, 1) == SdoAbort.DEVICE_STATE
    desk.nmt(NmtCommand.ENTER_PRE_OPERATIONAL)
    assert desk.write(0x1601, 0, 0, 1) == 0


# Faults


def test_emergency_stop_input(desk):
    desk.enable(torque=-220)
    desk.drive.set_emergency_stop(True)
    assert decode_state(desk.status()) is State.QUICK_STOP_ACTIVE
    assert desk.read(0x60FD, 0) == 1 << 3
    reach_closed_brake(desk)
    for word in (0x06, 0x07, 0x0F):
        desk.command(word)
    assert decode_state(desk.status()) is State.SWITCH_ON_DISABLED
    assert not desk.status() & 1 << 4
    desk.drive.set_emergency_stop(False)
    assert decode_state(desk.status()) is State.SWITCH_ON_DISABLED
    desk.enable(torque=-220)


def test_power_cycle_closes_the_brake_and_boots(desk):
    desk.enable(torque=-220)
    desk.frames(0x700 + NODE_ID)
    desk.drive.power_cycle()
    assert desk.plant.torque[0] == 0.0
    assert not desk.plant.brake_closed[0]
    assert desk.frames(0x700 + NODE_ID) == [b"\x00"]
    assert desk.drive.nmt_state is NmtState.PRE_OPERATIONAL
    assert desk.read(0x6060, 0) == 0
    duration, torques = reach_closed_brake(desk)
    assert duration == pytest.approx(CLOSE_DELAY, abs=3e-3)
    assert not any(torques)


def test_disconnected_drive_hears_and_says_nothing_and_stops_by_itself(drive_desk):
    desk = drive_desk()
    desk.configure(rpdo_timeout=50, abort_option=3)
    assert desk.write(0x1017, 0, 10, 2) == 0
    desk.enable(torque=-220)
    desk.wire.frames.clear()
    desk.drive.disconnected = True
    for _ in range(10):
        desk.command(0x0F, -300)
        desk.sync()
        desk.wait(0.01)
    assert desk.wire.frames == []
    assert desk.plant.torque_log[-2][1] == pytest.approx(-1.1)
    assert desk.plant.brake_closed[0]


def test_lost_mode_of_operation(desk):
    desk.enable(torque=-220)
    desk.drive.mode_is_lost = True
    desk.command(0x0F, -300)
    assert desk.plant.torque[0] == pytest.approx(-1.1)
    assert desk.read(0x6061, 0) == 0
    assert not desk.status() & 1 << 12
    assert decode_state(desk.status()) is State.OPERATION_ENABLED


@pytest.mark.parametrize("polarity", [1, -1])
def test_runaway_pays_out_whatever_it_is_told(drive_desk, polarity):
    desk = drive_desk(polarity)
    desk.configure()
    desk.enable(torque=-220)
    desk.drive.runs_away = 1
    desk.drive.apply_faults()
    assert desk.plant.torque[0] == pytest.approx(10.0)
    desk.command(0x02)
    reach_closed_brake(desk)
    assert desk.plant.torque[0] == 0.0


# Object dictionary

REFUSED = [
    ((0x2000, 0, 1, 1), SdoAbort.NO_OBJECT),
    ((0x1018, 9, 1, 4), SdoAbort.NO_SUBINDEX),
    ((0x1016, 2, 1, 4), SdoAbort.NO_SUBINDEX),
    ((0x6040, 1, 6, 2), SdoAbort.NO_SUBINDEX),
    ((0x6041, 0, 1, 2), SdoAbort.READ_ONLY),
    ((0x6040, 0, 6, 4), SdoAbort.DATA_TOO_LONG),
    ((0x6072, 0, 6, 1), SdoAbort.DATA_TOO_SHORT),
    ((0x6060, 0, 8, 1), SdoAbort.INVALID_VALUE),
    ((0x605A, 0, 0, 2), SdoAbort.INVALID_VALUE),
    ((0x605A, 0, 6, 2), SdoAbort.INVALID_VALUE),
    ((0x605A, 0, 3, 2), SdoAbort.INVALID_VALUE),
    ((0x605B, 0, 2, 2), SdoAbort.INVALID_VALUE),
    ((0x605C, 0, 2, 2), SdoAbort.INVALID_VALUE),
    ((0x605D, 0, 0, 2), SdoAbort.INVALID_VALUE),
    ((0x605E, 0, 5, 2), SdoAbort.INVALID_VALUE),
    ((0x6007, 0, 2, 2), SdoAbort.INVALID_VALUE),
    ((0x6072, 0, 3001, 2), SdoAbort.VALUE_TOO_HIGH),
    ((0x60FD, 0, 1, 4), SdoAbort.READ_ONLY),
    ((0x1029, 1, 3, 1), SdoAbort.VALUE_TOO_HIGH),
    ((0x1003, 0, 1, 1), SdoAbort.INVALID_VALUE),
    ((0x1016, 1, 200 << 16 | 100, 4), SdoAbort.INVALID_VALUE),
]


@pytest.mark.parametrize(("request_", "code"), REFUSED)
def test_refused_writes(desk, request_, code):
    assert desk.write(*request_) == code


def test_refused_reads(desk):
    assert desk.read(0x2000, 0) == SdoAbort.NO_OBJECT
    assert desk.read(0x1003, 1) == SdoAbort.NO_DATA


def test_device_name_needs_segments(desk):
    desk.send(0x600 + NODE_ID, struct.pack("<BHBI", 0x40, 0x1008, 0, 0))
    (answer,) = desk.frames(0x580 + NODE_ID)
    assert answer[0] == 0x41
    assert int.from_bytes(answer[4:], "little") == len("Winch drive")


def test_mode_cannot_change_under_power(desk):
    desk.enable()
    assert desk.write(0x6060, 0, 0, 1) == SdoAbort.DEVICE_STATE
    assert desk.write(0x6060, 0, 10, 1) == 0


def test_without_a_mode_operation_stays_disabled(drive_desk):
    desk = drive_desk()
    desk.configure()
    assert desk.write(0x6060, 0, 0, 1) == 0
    for word in (0x06, 0x07, 0x0F):
        desk.command(word, 300)
    desk.wait(0.1)
    assert decode_state(desk.status()) is State.SWITCHED_ON
    assert desk.plant.brake_closed[0]


def test_control_word_by_sdo(desk):
    assert desk.write(0x6040, 0, 0x06, 2) == 0
    assert decode_state(desk.status()) is State.READY_TO_SWITCH_ON


@pytest.mark.parametrize(("mask", "heeded"), [(0, False), (1, True)])
def test_the_host_closes_the_brake_of_a_drive_in_operation_where_the_mask_lets_it(mask, heeded):
    desk = DriveDesk(brake_output=BrakeOutput(0, 1))
    desk.configure()
    assert desk.write(0x60FE, 2, mask, 4) == 0
    desk.enable(torque=-220)
    assert desk.write(0x60FE, 1, 1, 4) == 0
    desk.command(0x0F, -220)
    assert desk.status() & BRAKE_OPEN
    desk.wait(CLOSE_DELAY + 0.002)
    assert desk.plant.brake_closed[0] == heeded
    assert bool(desk.status() & BRAKE_OPEN) is not heeded
    assert decode_state(desk.status()) is State.OPERATION_ENABLED
    assert desk.plant.torque[0] == pytest.approx(-1.1)  # torque against a closed brake
    assert desk.write(0x60FE, 1, 0, 4) == 0
    desk.command(0x0F, -220)
    desk.wait(OPEN_DELAY + 0.002)
    assert not desk.plant.brake_closed[0]


def test_the_drive_closes_its_brake_whatever_the_host_says():
    desk = DriveDesk(brake_output=BrakeOutput(0, 1))
    desk.configure()
    assert desk.write(0x60FE, 2, 1, 4) == 0
    desk.enable()
    desk.command(0x02)
    desk.wait(CLOSE_DELAY + 0.01)
    assert desk.plant.brake_closed[0]
