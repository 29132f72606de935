from dataclasses import replace
from pathlib import Path

import pytest

from cspr_drivers.canopen.emergency import Emergency
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.config.timeouts import Timeouts
from cspr_drivers.drives.group import DriveGroup
from cspr_drivers.errors import FrameError
from cspr_msgs_py.vocabulary import DriverState

# Status words typed from IEC 61800-7-201, with bit 14 for the open brake; bit 12: the target torque is followed.
NOT_READY, AT_REST, READY, SWITCHED_ON = 0x00, 0x40, 0x21, 0x23
ENABLED_HELD, ENABLED, QUICK_STOP, FAULT, FAULT_REACTION = 0x1027, 0x5027, 0x4007, 0x08, 0x400F
WRONG_MODE = 0x4027  # operation enabled, but bit 12 says that the target torque is ignored

TIMEOUTS = Timeouts(
    command=0.05,
    feedback=0.02,
    rpdo=0.1,
    heartbeat_producer=0.1,
    heartbeat_consumer=0.3,
    sdo=0.2,
    transition=0.3,
    enable=1.0,
    stop=0.5,
)

SHIPPED = CanConfig.from_yaml(Path(__file__).parents[3] / "config" / "can.yaml")
CONFIG = replace(SHIPPED, drives=SHIPPED.drives[:2], timeouts=TIMEOUTS)


def error(code, register):
    return Emergency(code, register, bytes(5), 100.0)


class Bench:
    """A group of two drives and the time."""

    def __init__(self):
        self.group = DriveGroup(CONFIG)
        self.time = 100.0
        self.status = [AT_REST, AT_REST]
        self.commanding = self.watched = True

    def cycle(self, *status, silent=()):
        """Run one cycle of 4 ms in which the drives report `status`."""
        self.time += 0.004
        self.status = list(status) or self.status
        for index, word in enumerate(self.status):
            if index not in silent:
                self.group.feedback(index, word, self.time)
            if self.commanding:
                self.group.commanded(index, self.time)
        if self.watched:
            self.group.supervised(self.time)
        self.group.step(self.time)
        return self.group.state

    @property
    def words(self):
        return list(self.group.control_words)


@pytest.fixture
def disabled():
    bench = Bench()
    bench.group.configured(0)
    bench.group.configured(1)
    assert bench.cycle() is DriverState.DISABLED
    return bench


@pytest.fixture
def enabling(disabled):
    assert disabled.group.enable(disabled.time) is None
    return disabled


@pytest.fixture
def enabled(enabling):
    enabling.cycle(SWITCHED_ON, SWITCHED_ON)
    assert enabling.cycle(ENABLED, ENABLED) is DriverState.ENABLED
    return enabling


@pytest.fixture
def stopping(enabled):
    enabled.group.disable(enabled.time)
    assert enabled.group.state is DriverState.STOPPING
    return enabled


@pytest.fixture
def fault(enabled):
    enabled.group.quick_stop("a test", enabled.time)
    assert enabled.group.state is DriverState.FAULT
    return enabled


# not ready


def test_not_ready_until_all_drives_are_configured_and_heard():
    bench = Bench()
    bench.group.step(bench.time)
    assert bench.group.cause == "motor_1, motor_2: not configured yet"
    assert bench.group.enable(bench.time) == "motor_1, motor_2: not configured yet"
    bench.group.configured(0)
    assert bench.cycle() is DriverState.NOT_READY
    assert bench.group.cause == "motor_2: not configured yet"
    bench.group.configured(1)
    assert bench.cycle() is DriverState.DISABLED
    assert bench.group.cause == ""


def test_a_drive_found_in_operation_is_led_to_rest(disabled):
    bench = disabled
    assert bench.cycle(ENABLED, AT_REST) is DriverState.NOT_READY
    assert bench.group.cause == "motor_1: is in operation_enabled"
    assert bench.words == [0x07, 0x00]  # disable operation: the brake closes under torque
    bench.cycle(SWITCHED_ON, AT_REST)
    assert bench.words == [0x06, 0x00]
    bench.cycle(READY, AT_REST)
    assert bench.words == [0x00, 0x00]
    assert bench.cycle(AT_REST, AT_REST) is DriverState.DISABLED


def test_an_open_brake_is_not_ready(disabled):
    assert disabled.cycle(0x4040, AT_REST) is DriverState.NOT_READY
    assert disabled.group.cause == "motor_1: its brake is open"


def test_a_silent_drive_at_rest_is_not_ready_and_no_fault(disabled):
    for _ in range(6):
        disabled.cycle(silent={1})
    assert disabled.group.state is DriverState.NOT_READY
    assert disabled.group.cause == "motor_2: sends no feedback"
    assert disabled.cycle() is DriverState.DISABLED


def test_a_drive_lost_at_rest_is_not_ready_and_no_fault(disabled):
    disabled.group.lost(1, "restarted", disabled.time)
    assert disabled.cycle() is DriverState.NOT_READY
    assert disabled.group.cause == "motor_2: restarted"


def test_a_drive_in_fault_at_rest_is_latched(disabled):
    disabled.group.emergency(1, error(0x3210, 0b101))
    assert disabled.cycle(AT_REST, FAULT) is DriverState.FAULT
    assert disabled.group.cause == "motor_2 is in fault: DC link overvoltage (error code 0x3210)"
    assert disabled.words == [0x00, 0x00]  # no reset by itself


# enabling


def test_enable_is_refused_without_fresh_commands(disabled):
    disabled.commanding = False
    for _ in range(14):
        disabled.cycle()
    assert disabled.group.enable(disabled.time) == "no fresh torque commands for motor_1, motor_2"


def test_drives_wait_at_rest_until_the_settings_of_all_are_confirmed(disabled):
    assert disabled.group.enable(disabled.time, unread=(0, 1)) is None
    assert disabled.words == [0x00, 0x00]
    disabled.group.confirmed(0, disabled.time)
    assert disabled.cycle() is DriverState.ENABLING
    assert disabled.words == [0x00, 0x00]
    disabled.group.confirmed(1, disabled.time)
    assert disabled.words == [0x06, 0x06]


def test_a_drive_whose_settings_cannot_be_read_in_time_is_named(disabled):
    assert disabled.group.enable(disabled.time, unread=(0, 1)) is None
    disabled.group.confirmed(0, disabled.time)
    while disabled.cycle() is DriverState.ENABLING:
        pass
    assert disabled.group.cause == "not enabled within 1 s: motor_2: its settings are still being read"


def test_brakes_open_together_once_all_drives_have_power(enabling):
    assert enabling.words == [0x06, 0x06]
    enabling.cycle(READY, AT_REST)
    assert enabling.words == [0x07, 0x06]
    enabling.cycle(SWITCHED_ON, READY)
    assert enabling.words == [0x07, 0x07]
    enabling.cycle(SWITCHED_ON, SWITCHED_ON)
    assert enabling.words == [0x0F, 0x0F]
    assert enabling.cycle(ENABLED_HELD, ENABLED) is DriverState.ENABLING
    assert enabling.cycle(ENABLED, ENABLED) is DriverState.ENABLED
    assert enabling.words == [0x0F, 0x0F]


def test_enable_is_refused_while_not_disabled(enabling):
    assert enabling.group.enable(enabling.time) == "the drives are enabling"


def test_enabling_takes_no_longer_than_its_limit(enabling):
    enabling.cycle(SWITCHED_ON, SWITCHED_ON)
    for _ in range(260):
        enabling.cycle(ENABLED, ENABLED_HELD)
    assert enabling.group.state is DriverState.FAULT
    assert enabling.group.cause == "not enabled within 1 s: motor_2 is in operation_enabled"


def test_enabling_can_be_called_off(enabling):
    enabling.cycle(SWITCHED_ON, SWITCHED_ON)
    enabling.group.disable(enabling.time)
    assert enabling.words == [0x06, 0x06]
    assert enabling.cycle(AT_REST, AT_REST) is DriverState.DISABLED


@pytest.mark.parametrize("status", [FAULT, FAULT_REACTION, QUICK_STOP])
def test_a_drive_that_stops_by_itself_ends_enabling(enabling, status):
    assert enabling.cycle(SWITCHED_ON, status) is DriverState.FAULT
    assert enabling.words[0] == 0x02


def test_missing_commands_end_enabling(enabling):
    enabling.commanding = False
    for _ in range(14):
        enabling.cycle()
    assert enabling.group.cause == "no torque command within 50 ms for motor_1, motor_2"


# enabled


def test_drives_are_not_enabled_together_without_a_supervisor(disabled):
    disabled.watched = False
    for _ in range(40):
        disabled.cycle()
    assert "no sign of life of the supervisor" in disabled.group.enable(disabled.time)
    assert disabled.group.enable(disabled.time, 1) is None  # for maintenance
    disabled.cycle(AT_REST, SWITCHED_ON)
    assert disabled.cycle(AT_REST, ENABLED) is DriverState.ENABLED
    for _ in range(40):
        disabled.cycle()
    assert disabled.group.state is DriverState.ENABLED
    assert "no sign of life of the supervisor" in disabled.group.enable(disabled.time, 0)


def test_a_supervisor_that_ends_stops_the_drives(enabled):
    enabled.watched = False
    began = enabled.time
    while enabled.cycle() is not DriverState.FAULT:
        assert enabled.time - began < 0.2
    assert enabled.group.cause == "no sign of life of the supervisor for 152 ms"


def test_missing_commands_stop_the_drives(enabled):
    enabled.commanding = False
    for _ in range(12):
        assert enabled.cycle() is DriverState.ENABLED
    enabled.cycle()
    assert enabled.group.state is DriverState.FAULT
    assert enabled.words == [0x02, 0x02]


def test_a_silent_drive_stops_the_others(enabled):
    for _ in range(7):
        enabled.cycle(silent={1})
    assert enabled.group.state is DriverState.FAULT
    assert enabled.group.cause.startswith("motor_2: silent for 2")
    assert enabled.words == [0x02, 0x02]


@pytest.mark.parametrize(
    ("status", "cause"),
    [
        (FAULT, "motor_2 is in fault"),
        (FAULT_REACTION, "motor_2 is in fault_reaction_active"),
        (QUICK_STOP, "motor_2 is in quick_stop_active; its power stage has no supply"),
        (AT_REST, "motor_2 is in switch_on_disabled; its power stage has no supply"),
        (SWITCHED_ON, "motor_2 is in switched_on; its power stage has no supply"),
        (READY, "motor_2 is in ready_to_switch_on; its power stage has no supply"),
        (NOT_READY, "motor_2 is in not_ready_to_switch_on; its power stage has no supply"),
        (ENABLED_HELD, "motor_2: its brake closed by itself"),
        (WRONG_MODE, "motor_2 does not follow its target torque: it has left its mode of operation"),
    ],
)
def test_a_drive_that_leaves_operation_stops_the_others(enabled, status, cause):
    assert enabled.cycle(ENABLED, status) is DriverState.FAULT
    assert enabled.group.cause == cause
    assert enabled.words[0] == 0x02


def test_a_lost_drive_stops_the_others_at_once(enabled):
    enabled.group.lost(1, "no heartbeat for 310 ms", enabled.time)
    assert enabled.group.state is DriverState.FAULT
    assert enabled.group.cause == "motor_2: no heartbeat for 310 ms"
    assert enabled.words[0] == 0x02
    assert enabled.group.drives[1].state_name == "unknown"


def test_a_status_word_of_no_state_is_not_used(enabled):
    with pytest.raises(FrameError, match="0x006F reports no state"):
        enabled.group.feedback(0, 0x6F, enabled.time)
    assert enabled.cycle(ENABLED, ENABLED) is DriverState.ENABLED


# stopping


def test_disable_closes_brakes_before_power_goes(stopping):
    assert stopping.words == [0x07, 0x07]
    assert stopping.cycle(ENABLED, SWITCHED_ON) is DriverState.STOPPING
    assert stopping.words == [0x07, 0x06]
    stopping.cycle(SWITCHED_ON, READY)
    assert stopping.words == [0x06, 0x00]
    assert stopping.cycle(AT_REST, AT_REST) is DriverState.DISABLED


def test_stopping_needs_no_commands(stopping):
    stopping.commanding = False
    for _ in range(20):
        assert stopping.cycle(ENABLED, ENABLED) is DriverState.STOPPING


def test_a_brake_that_does_not_close_is_a_fault(stopping):
    for _ in range(130):
        stopping.cycle(AT_REST, ENABLED)
    assert stopping.group.state is DriverState.FAULT
    assert stopping.group.cause == "brakes not closed within 0.5 s: motor_2 is in operation_enabled"
    assert stopping.words == [0x00, 0x02]


def test_a_fault_while_stopping_is_latched(stopping):
    assert stopping.cycle(ENABLED, FAULT) is DriverState.FAULT


def test_disable_at_rest_does_nothing(disabled):
    disabled.group.disable(disabled.time)
    assert disabled.group.state is DriverState.DISABLED


# fault


def test_quick_stop_is_never_cut_short(fault):
    assert fault.words == [0x02, 0x02]
    fault.cycle(QUICK_STOP, ENABLED)
    assert fault.words == [0x02, 0x02]
    fault.group.disable(fault.time)
    fault.cycle(QUICK_STOP, QUICK_STOP)
    assert fault.words == [0x02, 0x02]
    fault.cycle(AT_REST, AT_REST)
    assert fault.words == [0x00, 0x00]
    assert fault.group.state is DriverState.FAULT


def test_the_first_cause_stays(fault):
    fault.group.quick_stop("a later one", fault.time)
    fault.cycle(FAULT, QUICK_STOP)
    assert fault.group.cause == "a test"
    assert fault.group.enable(fault.time) == "a fault is latched: a test; reset it first"


def test_nothing_resets_by_itself(fault):
    for _ in range(500):
        assert fault.cycle(FAULT, AT_REST) is DriverState.FAULT
        assert not any(word & 0x80 for word in fault.words)


def test_reset_waits_for_the_brakes(fault):
    fault.cycle(QUICK_STOP, AT_REST)
    assert fault.group.fault_reset(fault.time) == "not stopped yet: motor_1 is in quick_stop_active"


def test_reset_raises_bit_7_only_where_there_is_a_fault(fault):
    fault.cycle(FAULT, AT_REST)
    assert fault.words == [0x00, 0x00]
    assert fault.group.fault_reset(fault.time) is None
    assert fault.words == [0x80, 0x00]
    assert fault.cycle(FAULT, AT_REST) is DriverState.FAULT
    assert fault.cycle(AT_REST, AT_REST) is DriverState.DISABLED
    assert fault.words == [0x00, 0x00]


def test_a_fault_that_stays_can_be_reset_again_with_a_new_edge(fault):
    fault.cycle(FAULT, AT_REST)
    fault.group.fault_reset(fault.time)
    for _ in range(130):
        fault.cycle()
    assert fault.group.cause == "not reset: motor_1 is in fault"
    fault.cycle()
    assert fault.words == [0x00, 0x00]
    fault.group.fault_reset(fault.time)
    assert fault.words == [0x80, 0x00]


def test_quick_stop_during_a_reset_latches_again(fault):
    fault.cycle(FAULT, AT_REST)
    fault.group.fault_reset(fault.time)
    fault.group.quick_stop("meanwhile", fault.time)
    assert fault.group.cause == "meanwhile"
    assert fault.cycle(AT_REST, AT_REST) is DriverState.FAULT


def test_reset_with_a_lost_drive_leads_to_not_ready(fault):
    fault.group.lost(1, "restarted", fault.time)
    fault.cycle(AT_REST, NOT_READY, silent={1})
    fault.group.fault_reset(fault.time)
    assert fault.cycle(silent={1}) is DriverState.NOT_READY
    assert fault.group.cause == "motor_2: restarted"


def test_reset_without_a_fault_does_nothing(disabled):
    assert disabled.group.fault_reset(disabled.time) is None
    assert disabled.group.state is DriverState.DISABLED


def test_quick_stop_at_rest_is_latched_too(disabled):
    disabled.group.quick_stop("supervisor", disabled.time)
    assert disabled.cycle() is DriverState.FAULT


def test_brakes_known_to_hold(enabled):
    assert not enabled.group.held
    enabled.cycle(AT_REST, AT_REST)
    assert enabled.group.held


# transitions, each with its limit


@pytest.mark.parametrize(
    ("way", "stuck", "limit", "words"),
    [
        ([], (AT_REST, READY), 0.3, "motor_1: still in switch_on_disabled after 0.3 s: no transition 2"),
        ([], (READY, SWITCHED_ON), 0.3, "motor_1: still in ready_to_switch_on after 0.3 s: no transition 3"),
        (
            [(SWITCHED_ON, SWITCHED_ON)],
            (ENABLED, SWITCHED_ON),
            1.0,
            "not enabled within 1 s: motor_2 is in switched_on",
        ),
    ],
)
def test_each_transition_of_enabling_has_its_limit(enabling, way, stuck, limit, words):
    for status in way:
        enabling.cycle(*status)
    start = enabling.time
    while enabling.cycle(*stuck) is DriverState.ENABLING:
        assert enabling.time - start < limit + 0.1
    assert enabling.time - start > limit - 0.02
    assert enabling.group.cause.startswith(words)


def test_a_drive_that_does_not_come_to_rest_after_a_quick_stop_is_named(fault):
    for _ in range(120):
        fault.cycle(QUICK_STOP, AT_REST)
    assert fault.group.cause == "a test"
    for _ in range(10):
        fault.cycle(QUICK_STOP, AT_REST)
    assert fault.group.cause == (
        "a test; motor_1: still in quick_stop_active after 0.5 s: no transition 12 to switch_on_disabled: "
        "assume the load is not held"
    )


def test_a_drive_that_ignores_quick_stop_is_named(fault):
    for _ in range(80):
        fault.cycle(ENABLED, AT_REST)
    assert "motor_1: still in operation_enabled after 0.3 s: no transition 11" in fault.group.cause


# one drive


def test_one_drive_is_enabled_and_disabled_alone(disabled):
    assert disabled.group.enable(disabled.time, 1) is None
    assert disabled.words == [0x00, 0x06]
    disabled.cycle(AT_REST, READY)
    disabled.cycle(AT_REST, SWITCHED_ON)
    assert disabled.cycle(AT_REST, ENABLED) is DriverState.ENABLED
    assert disabled.group.members == ("motor_2",)
    assert disabled.words == [0x00, 0x0F]
    assert disabled.group.enable(disabled.time) == "the drives are enabled"
    disabled.group.disable(disabled.time, 0)
    assert disabled.group.state is DriverState.ENABLED
    disabled.group.disable(disabled.time, 1)
    assert disabled.words == [0x00, 0x07]
    disabled.cycle(AT_REST, SWITCHED_ON)
    disabled.cycle(AT_REST, READY)
    assert disabled.cycle(AT_REST, AT_REST) is DriverState.DISABLED


def test_a_second_drive_joins_without_disturbing_the_first(disabled):
    disabled.group.enable(disabled.time, 0)
    disabled.cycle(SWITCHED_ON, AT_REST)
    assert disabled.cycle(ENABLED, AT_REST) is DriverState.ENABLED
    assert disabled.group.enable(disabled.time, 1) is None
    for status in (AT_REST, READY, SWITCHED_ON, ENABLED_HELD):
        disabled.cycle(ENABLED, status)
        assert disabled.words[0] == 0x0F
    assert disabled.cycle(ENABLED, ENABLED) is DriverState.ENABLED


def test_one_of_all_drives_is_not_disabled_alone(enabled):
    assert enabled.group.disable_refusal(0) == (
        "motor_1 carries the platform with all others: disable them together"
    )
    assert enabled.group.disable_refusal(None) is None


def test_one_drive_that_was_enabled_alone_can_be_disabled_alone(disabled):
    disabled.group.enable(disabled.time, 1)
    for status in (READY, SWITCHED_ON, ENABLED):
        disabled.cycle(AT_REST, status)
    assert disabled.group.disable_refusal(1) is None


def test_of_drives_that_were_enabled_one_by_one_the_others_go_on(enabled):
    enabled.group.disable(enabled.time, 0)
    assert enabled.words == [0x07, 0x0F]
    enabled.commanding = True
    for status in (SWITCHED_ON, READY, AT_REST):
        assert enabled.cycle(status, ENABLED) is DriverState.ENABLED
    assert enabled.words == [0x00, 0x0F]


def test_a_single_drive_that_does_not_come_to_rest_stops_all(enabled):
    enabled.group.disable(enabled.time, 0)
    for _ in range(130):
        enabled.cycle(ENABLED, ENABLED)
    assert enabled.group.state is DriverState.FAULT
    assert enabled.group.cause.startswith("motor_1: still in operation_enabled after 0.5 s: no transition 5")


def test_the_fault_of_one_drive_is_reset_alone_and_the_cause_stays(fault):
    fault.cycle(FAULT, FAULT)
    assert fault.group.fault_reset(fault.time, 1) is None
    assert fault.words == [0x00, 0x80]
    assert fault.cycle(FAULT, AT_REST) is DriverState.FAULT
    assert fault.words == [0x00, 0x00]
    assert fault.group.cause == "a test"
    assert fault.group.fault_reset(fault.time) is None
    assert fault.cycle(AT_REST, AT_REST) is DriverState.DISABLED


def test_one_reset_is_one_edge_even_for_a_drive_that_fails_again(fault):
    fault.cycle(FAULT, READY)
    fault.group.fault_reset(fault.time)
    assert fault.words[0] == 0x80
    fault.cycle(AT_REST, READY)
    for _ in range(100):
        fault.cycle(FAULT, READY)
        assert not fault.words[0] & 0x80


# emergencies and the emergency stop


def test_an_emergency_message_in_motion_is_a_fault(enabled):
    enabled.group.emergency(1, error(0x4310, 0b1001))
    assert enabled.group.state is DriverState.FAULT
    assert enabled.group.cause == "motor_2 reports drive or motor temperature too high (error code 0x4310)"
    assert enabled.words == [0x02, 0x02]


def test_the_end_of_an_error_is_no_fault(enabled):
    enabled.group.emergency(1, error(0x0000, 0))
    assert enabled.group.state is DriverState.ENABLED


def test_errors_are_kept_until_they_are_taken_back(disabled):
    disabled.group.emergency(0, error(0x4310, 0b1001))
    disabled.group.emergency(0, error(0x8120, 0b1_1001))
    assert [e.code for e in disabled.group.drives[0].errors] == [0x4310, 0x8120]
    disabled.group.emergency(0, error(0x0000, 0))
    assert disabled.group.drives[0].errors == ()


def test_the_emergency_stop_stops_all_and_keeps_the_drives_from_being_enabled(enabled):
    enabled.group.emergency_stop(0, True, enabled.time)
    assert enabled.group.state is DriverState.FAULT
    assert enabled.group.cause == "emergency stop: input of motor_1"
    enabled.cycle(AT_REST, AT_REST)
    enabled.group.fault_reset(enabled.time)
    assert enabled.cycle(AT_REST, AT_REST) is DriverState.NOT_READY
    assert enabled.group.enable(enabled.time) == "motor_1: its emergency stop input is active"
    enabled.group.emergency_stop(0, False, enabled.time)
    assert enabled.cycle(AT_REST, AT_REST) is DriverState.DISABLED


def test_the_emergency_stop_is_the_cause_of_what_came_just_before_it(enabled):
    enabled.cycle(ENABLED, 0x0007 | 0x4000)
    enabled.group.emergency_stop(1, True, enabled.time)
    assert enabled.group.cause == (
        "emergency stop: input of motor_2; motor_2 is in quick_stop_active; its power stage has no supply"
    )
