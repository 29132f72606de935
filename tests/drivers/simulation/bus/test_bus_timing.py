import errno

import can
import pytest

from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.simulation.bus.bus_timing import BABBLING_COB_ID, BusDisturbance, BusTiming

US = 1e-6


def frame(identifier, length=0):
    return can.Message(arbitration_id=identifier, data=bytes(length), is_extended_id=False)


@pytest.fixture
def bus():
    return BusTiming(1_000_000)


def through(bus, time):
    return [(round(passed.time / US), passed.frame.arbitration_id) for passed in bus.passed(time)]


def test_a_frame_takes_its_worst_case_bits(bus):
    """55 + 10 n bits: 47 + 8 n of the frame with interframe space, and a stuff bit after each four."""
    bus.offer(frame(0x080), "driver", 0.0)
    assert bus.next_end() == pytest.approx(55 * US)
    assert through(bus, 54 * US) == []
    assert through(bus, 56 * US) == [(55, 0x080)]
    bus.offer(frame(0x181, 8), "drive", 1000 * US)
    assert through(bus, 1.0) == [(1135, 0x181)]


def test_an_idle_bus_is_not_early_however_often_it_is_looked_at(bus):
    bus.offer(frame(0x080), "driver", 0.0)
    bus.passed(1e-3)
    bus.offer(frame(0x181, 8), "drive", 5e-3)
    for look in range(5000, 5131, 5):
        assert through(bus, look * US) == []
    assert through(bus, 5136 * US) == [(5135, 0x181)]


def test_lower_identifiers_go_first_but_interrupt_nobody(bus):
    bus.offer(frame(0x300, 8), "c", 0.0)
    bus.offer(frame(0x200, 8), "b", 1 * US)
    bus.offer(frame(0x100, 8), "a", 2 * US)
    assert through(bus, 1.0) == [(135, 0x300), (270, 0x100), (405, 0x200)]


def test_a_frame_that_comes_later_does_not_change_the_past(bus):
    bus.offer(frame(0x200, 8), "b", 0.0)
    assert through(bus, 100 * US) == []
    bus.offer(frame(0x100, 8), "a", 100 * US)
    assert through(bus, 200 * US) == [(135, 0x200)]
    assert through(bus, 300 * US) == [(270, 0x100)]


def test_frames_of_one_identifier_keep_their_order(bus):
    first, second = frame(0x200, 1), frame(0x200, 2)
    bus.offer(first, "a", 0.0)
    bus.offer(second, "a", 0.0)
    assert [passed.frame for passed in bus.passed(1.0)] == [first, second]


def test_a_cycle_of_the_shipped_configuration(repository):
    """SYNC, 8 TPDOs of 8 bytes, 8 of 5, 8 RPDOs of 4: 2735 us, whatever order they come in."""
    config = CanConfig.from_yaml(repository / "config" / "can.yaml")
    bus = BusTiming(config.buses[0].bitrate)
    for drive in config.drives:
        bus.offer(frame(0x200 + drive.node_id, 4), "driver", 0.0)
        bus.offer(frame(0x180 + drive.node_id, 8), drive.name, 0.0)
    for cell in config.load_cells:
        bus.offer(frame(0x180 + cell.node_id, 5), cell.name, 0.0)
    bus.offer(frame(0x080), "driver", 0.0)
    assert bus.last_end() == pytest.approx(2735 * US)
    times = through(bus, 1.0)
    assert times[-1][0] == 2735
    assert [identifier for _, identifier in times] == sorted(identifier for _, identifier in times)


def test_overfull_cycles_fall_behind_more_and_more(bus):
    """A cycle of 1 ms with 8 frames of 135 us: after ten cycles the last frame is 0.8 ms late."""
    for cycle in range(10):
        for node in range(8):
            bus.offer(frame(0x181 + node, 8), node, cycle * 1e-3)
    assert bus.last_end() == pytest.approx(10.8e-3)
    assert through(bus, 1.0)[-1][0] == 10800


def test_transmit_queue_is_finite(bus):
    for _ in range(64):
        bus.offer(frame(0x200), "driver", 0.0)
    with pytest.raises(can.CanOperationError) as caught:
        bus.offer(frame(0x200), "driver", 0.0)
    assert caught.value.error_code == errno.ENOBUFS
    bus.offer(frame(0x181), "drive", 0.0)
    bus.passed(56 * US)
    bus.passed(112 * US)
    bus.offer(frame(0x200), "driver", 200 * US)


def test_cut_bus_keeps_frames_waiting(bus):
    bus.disturb(BusDisturbance.CUT)
    bus.offer(frame(0x080), "driver", 0.0)
    assert bus.next_end() is None
    assert through(bus, 1.0) == []
    bus.disturb(BusDisturbance.NONE)
    assert through(bus, 1.1) == [(1000055, 0x080)]


def test_a_controller_that_goes_off_the_bus_says_so_once_and_loses_what_it_is_given(bus):
    bus.offer(frame(0x201, 4), "driver", 0.0)
    bus.disturb(BusDisturbance.OFF)
    assert bus.next_end() is not None
    (told,) = bus.passed(1e-3)
    assert told.frame.is_error_frame
    assert told.frame.arbitration_id == 0x040  # CAN_ERR_BUSOFF of linux/can/error.h
    bus.offer(frame(0x080), "driver", 2e-3)
    assert bus.passed(3e-3) == []
    assert bus.next_end() is None
    bus.disturb(BusDisturbance.NONE)
    bus.offer(frame(0x080), "driver", 4e-3)
    assert through(bus, 5e-3) == [(4055, 0x080)]


@pytest.mark.parametrize(
    ("disturbance", "code"),
    [(BusDisturbance.DOWN, errno.ENETDOWN), (BusDisturbance.REMOVED, errno.ENXIO)],
)
def test_an_interface_that_is_not_there_refuses_frames_of_the_driver(bus, disturbance, code):
    bus.disturb(disturbance)
    with pytest.raises(can.CanOperationError) as caught:
        bus.offer(frame(0x080), "driver", 0.0)
    assert caught.value.error_code == code
    bus.offer(frame(0x181, 8), "drive", 0.0)  # heard by nobody
    assert bus.passed(1e-3) == []
    bus.disturb(BusDisturbance.NONE)
    bus.offer(frame(0x080), "driver", 2e-3)
    assert through(bus, 3e-3) == [(2055, 0x080)]


def test_babbling_node_lets_only_nmt_pass(bus):
    bus.disturb(BusDisturbance.BABBLING)
    bus.offer(frame(0x080), "driver", 0.0)
    bus.offer(frame(0x000, 2), "driver", 0.0)
    seen = through(bus, 1.35e-3)
    assert seen[0] == (75, 0x000)
    assert {identifier for _, identifier in seen[1:]} == {BABBLING_COB_ID}
    assert len(seen) == 1 + 9  # 1350 us less 75 us hold nine frames of 135 us
    bus.disturb(BusDisturbance.NONE)
    assert [identifier for _, identifier in through(bus, 1.5e-3)] == [0x080]


def test_a_node_babbles_from_now_on_and_not_since_the_bus_fell_idle(bus):
    assert through(bus, 100.0) == []
    bus.disturb(BusDisturbance.BABBLING)
    assert len(through(bus, 100.0 + 1.36e-3)) == 10


def test_error_frames_destroy_what_is_sent(bus):
    bus.disturb(BusDisturbance.ERROR_FRAMES)
    bus.offer(frame(0x080), "driver", 0.0)
    (passed,) = bus.passed(1.0)
    assert passed.frame.is_error_frame
    assert passed.time == pytest.approx(78 * US)
    assert bus.passed(2.0) == []
