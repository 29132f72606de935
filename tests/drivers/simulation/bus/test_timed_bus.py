import itertools
import time
import uuid

import can
import pytest

from cspr_drivers.bus.virtual_bus import QuickVirtualBus
from cspr_drivers.simulation.bus.bus_timing import BABBLING_COB_ID, BusDisturbance
from cspr_drivers.simulation.bus.timed_bus import TimedBus

PATIENCE = 120.0
US = 1e-6


def frame(identifier, length=0):
    return can.Message(arbitration_id=identifier, data=bytes(length), is_extended_id=False)


class Ends:
    """Both ends of a bus of 1 Mbit/s; the devices answer each SYNC with eight frames of eight bytes."""

    def __init__(self, timed):
        channel = str(uuid.uuid4())
        self.heard = []
        self.devices = TimedBus(QuickVirtualBus(channel), 1_000_000, self._hear, timed)
        self.driver = QuickVirtualBus(channel)

    def _hear(self, message):
        self.heard.append(message)
        if message.arbitration_id == 0x080:
            for node in range(8):
                self.devices.send(frame(0x181 + node, 8))

    def receive(self, count):
        frames = []
        end = time.monotonic() + PATIENCE
        while len(frames) < count and time.monotonic() < end:
            message = self.driver.recv(0.05)
            if message is not None:
                frames.append(message)
        return frames

    def close(self):
        self.devices.shutdown()
        self.driver.shutdown()


@pytest.fixture(params=[True, False], ids=["timed", "untimed"])
def ends(request):
    ends = Ends(request.param)
    yield ends
    ends.close()


@pytest.fixture
def timed_ends():
    ends = Ends(timed=True)
    yield ends
    ends.close()


def test_frames_pass_both_ways(ends):
    ends.driver.send(frame(0x080))
    received = ends.receive(8)
    assert [message.arbitration_id for message in received] == list(range(0x181, 0x189))
    assert [message.arbitration_id for message in ends.heard] == [0x080]


def test_stamps_are_those_of_copper(timed_ends):
    """SYNC is through 55 us after it was sent at the earliest, and each answer 135 us after the one before."""
    before = time.time()
    timed_ends.driver.send(frame(0x080))
    stamps = [message.timestamp for message in timed_ends.receive(8)]
    (sync,) = timed_ends.heard
    assert sync.timestamp >= before + 54 * US
    assert stamps[0] - sync.timestamp == pytest.approx(135 * US, abs=2 * US)
    for first, second in itertools.pairwise(stamps):
        assert second - first == pytest.approx(135 * US, abs=2 * US)


def test_nothing_is_delivered_before_it_is_through(timed_ends):
    for _ in range(60):
        timed_ends.devices.send(frame(0x181, 8))
    for message in timed_ends.receive(60):
        assert message.timestamp <= time.time() + 2 * US


def test_a_cut_bus_and_its_repair(ends):
    ends.devices.disturb(BusDisturbance.CUT)
    ends.driver.send(frame(0x080))
    assert ends.driver.recv(0.1) is None
    assert ends.heard == []
    ends.devices.disturb(BusDisturbance.NONE)
    assert len(ends.receive(8)) == 8


def test_a_babbling_node_leaves_no_room(ends):
    ends.devices.disturb(BusDisturbance.BABBLING)
    ends.driver.send(frame(0x080))
    received = ends.receive(200)
    assert {message.arbitration_id for message in received} == {BABBLING_COB_ID}
    assert ends.heard == []
    span = received[-1].timestamp - received[0].timestamp
    assert span == pytest.approx(199 * 135 * US, rel=0.01)  # 100 % of the bus


def test_error_frames_come_in_place_of_what_was_sent(ends):
    ends.devices.disturb(BusDisturbance.ERROR_FRAMES)
    ends.driver.send(frame(0x080))
    (received,) = ends.receive(1)
    assert received.is_error_frame
    assert ends.heard == []


def test_a_full_transmit_queue_is_an_error_of_the_sender(ends):
    ends.devices.disturb(BusDisturbance.CUT)
    for _ in range(64):
        ends.driver.send(frame(0x201, 4))
    with pytest.raises(can.CanOperationError, match="buffer full"):
        ends.driver.send(frame(0x201, 4))


def test_the_driver_hears_that_its_controller_is_off_the_bus(ends):
    ends.devices.disturb(BusDisturbance.OFF)
    (told,) = ends.receive(1)
    assert told.is_error_frame
    assert told.arbitration_id & 0x040
    ends.devices.disturb(BusDisturbance.NONE)
    ends.driver.send(frame(0x080))
    assert len(ends.receive(8)) == 8


def test_the_driver_cannot_send_through_an_interface_that_is_down(ends):
    ends.devices.disturb(BusDisturbance.DOWN)
    with pytest.raises(can.CanOperationError, match="Network is down"):
        ends.driver.send(frame(0x080))
    ends.devices.disturb(BusDisturbance.NONE)
    ends.driver.send(frame(0x080))
    assert len(ends.receive(8)) == 8
