"""The driver's socket on the kernel's CAN: filters, overflow, time stamps, and an interface that goes and comes."""

import contextlib
import errno
import time
from pathlib import Path

import can
import pytest

from cspr_drivers.bus import socketcan_bus
from cspr_drivers.bus.can_bus import CanPort
from cspr_drivers.bus.opening import open_bus
from cspr_drivers.bus.socketcan_bus import QuickSocketCan
from cspr_drivers.config.can_config import BusConfig
from cspr_drivers.errors import BusError

CHANNEL = "vcan1"
PATIENCE = 60.0  # s
QUIET = 0.5  # s without a frame after which none is on its way any more: the kernel may deliver after `send` returned


@pytest.fixture
def interface(plug_in):
    """Have the interface up, before and afterwards."""
    plug_in(CHANNEL)
    yield CHANNEL
    plug_in(CHANNEL)


@pytest.fixture
def socket(interface):
    socket = QuickSocketCan(interface, {0x181, 0x701})
    yield socket
    socket.shutdown()


def drained(socket):
    """Return the frames that wait in the socket or are on their way to it."""
    frames = []
    while (frame := socket.recv(QUIET)) is not None:
        frames.append(frame)
    return frames


def test_the_kernel_passes_exactly_the_frames_that_are_wanted(socket, raw):
    other = raw(CHANNEL)
    for identifier in (0x180, 0x181, 0x182, 0x700, 0x701, 0x080, 0x7FF):
        other.send(identifier, b"\x01")
    other.send(0x181 | 1 << 31, b"\x02")  # extended identifier
    other.send(0x181 | 1 << 30)  # remote request
    assert [(f.arbitration_id, bytes(f.data)) for f in drained(socket)] == [
        (0x181, b"\x01"),
        (0x701, b"\x01"),
    ]


def test_frames_that_the_kernel_had_no_room_for_are_counted(interface, raw, monkeypatch):
    monkeypatch.setattr(socketcan_bus, "RECEIVE_BUFFER", 4096)
    socket = QuickSocketCan(interface, {0x181})
    try:
        other = raw(CHANNEL)
        for _ in range(500):
            other.send(0x181, bytes(8))
        received = len(drained(socket))
        assert 0 < received < 500
        other.send(0x181, bytes(8))  # the kernel tells with a frame how many it has dropped before that one
        assert len(drained(socket)) == 1
        assert socket.dropped_frames == 500 - received
    finally:
        socket.shutdown()


def test_the_buffer_has_the_size_that_was_asked_for(socket):
    # socket(7): the kernel doubles the value for its own bookkeeping
    assert socket.receive_buffer == 2 * socketcan_bus.RECEIVE_BUFFER


def test_a_frame_has_the_time_at_which_it_came_and_not_at_which_it_was_read(socket, raw):
    other = raw(CHANNEL)
    other.send(0x181, b"\x01")
    came = time.time()
    while time.time() < came + 0.5:
        time.sleep(0.05)
    (frame,) = drained(socket)
    assert abs(frame.timestamp - came) < 0.25


def heard(socket, raw):
    """Send frames until the socket gets one; what it raises meanwhile is what happened to its interface before."""
    end = time.monotonic() + PATIENCE
    other = raw(CHANNEL)
    while time.monotonic() < end:
        other.send(0x181, b"\x05")
        try:
            frame = socket.recv(0.02)
        except can.CanError:
            continue
        if frame is not None:
            return True
    return False


def sync():
    return can.Message(arbitration_id=0x080, is_extended_id=False)


def test_an_interface_that_goes_down_is_told_and_goes_on_when_it_is_up_again(socket, raw, ip):
    ip("link", "set", CHANNEL, "down")
    with pytest.raises(can.CanOperationError) as caught:
        socket.send(sync())
    assert caught.value.error_code == errno.ENETDOWN
    ip("link", "set", CHANNEL, "up")
    socket.send(sync())
    assert heard(socket, raw)


@pytest.mark.parametrize("first", ["sender", "receiver"])
def test_an_interface_that_is_removed_and_made_again_is_taken_up_whoever_hears_of_it_first(
    socket, raw, ip, first
):
    ip("link", "delete", CHANNEL)
    if first == "sender":
        with pytest.raises(can.CanOperationError) as caught:
            socket.send(sync())
        assert caught.value.error_code in socketcan_bus.GONE
    else:
        with pytest.raises(can.CanOperationError):
            socket.recv(PATIENCE)
    # it stays away for longer than one attempt
    for _ in range(3):
        with contextlib.suppress(can.CanOperationError):
            assert socket.recv(0.05) is None
    ip("link", "add", CHANNEL, "type", "vcan")
    ip("link", "set", CHANNEL, "up")
    assert heard(socket, raw)
    socket.send(sync())
    assert socket.receive_buffer == 2 * socketcan_bus.RECEIVE_BUFFER  # and filters as before
    raw(CHANNEL).send(0x182)
    assert {frame.arbitration_id for frame in drained(socket)} <= {0x181}


def test_a_port_names_the_interface_that_is_down_and_an_error_frame(interface, raw, ip):
    port = CanPort("main", QuickSocketCan(interface, {0x181}))
    failures = []
    port.on_failure = failures.append
    try:
        raw(CHANNEL).send(0x20000000 | 0x40, bytes(8))  # CAN_ERR_FLAG, CAN_ERR_BUSOFF of linux/can/error.h
        end = time.monotonic() + PATIENCE
        while not failures and time.monotonic() < end:
            time.sleep(0.01)
        assert failures == ["bus-off: the controller has left the bus after too many errors"]
        ip("link", "set", CHANNEL, "down")
        assert not port.send(sync())
        assert "Network is down" in port.failure
        ip("link", "set", CHANNEL, "up")
        assert port.send(sync())
        assert port.failure == ""
    finally:
        port.close()


def test_why_an_interface_cannot_be_opened(interface, ip):
    ip("link", "set", CHANNEL, "down")
    with pytest.raises(
        BusError, match=f"the interface is down; `ip link set {CHANNEL} up type can bitrate 1000000`"
    ):
        open_bus(BusConfig("main", "socketcan", CHANNEL, 1_000_000))
    assert not Path("/sys/class/net/vcan7").exists()
    with pytest.raises(BusError, match="there is no such interface; `ip link` lists them"):
        open_bus(BusConfig("main", "socketcan", "vcan7", 1_000_000))
