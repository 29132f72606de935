import errno
import threading
import time

import can
import pytest

from cspr_drivers.bus import opening
from cspr_drivers.bus.can_bus import CanPort
from cspr_drivers.bus.opening import open_bus, open_ports
from cspr_drivers.bus.socketcan_bus import error_frame_text
from cspr_drivers.config.can_config import BusConfig, CanConfig
from cspr_drivers.errors import BusError

CAN0 = BusConfig("main", "socketcan", "can0", 1_000_000)


def test_a_missing_interface_is_one_clear_line():
    with pytest.raises(BusError) as error:
        open_bus(BusConfig("main", "socketcan", "can_not_there", 1_000_000))
    text = str(error.value)
    assert text.startswith("CAN bus main (socketcan, channel can_not_there): ")
    assert "there is no such interface" in text or "this kernel has no CAN support" in text
    assert "\n" not in text


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (OSError(errno.ENODEV, "No such device"), "there is no such interface; `ip link` lists them"),
        (OSError(errno.EBUSY, "Device or resource busy"), "the interface is in use by another program"),
        (OSError(errno.EPERM, "Operation not permitted"), "this user may not use the interface"),
        (PermissionError(errno.EACCES, "Permission denied"), "this user may not use the interface"),
        (OSError(errno.EAFNOSUPPORT, "Address family"), "this kernel has no CAN support; `modprobe can_raw`"),
        (
            can.CanInitializationError("adapter busy", errno.EBUSY),
            "the interface is in use by another program",
        ),
        (can.CanInitializationError("no adapter\nfound"), "no adapter found"),
        (can.CanInterfaceNotImplementedError("x"), "python-can has no interface of this type"),
        (ValueError("bad bit rate"), "bad bit rate"),
    ],
)
def test_why_an_interface_cannot_be_opened(monkeypatch, error, words):
    def refuse(*arguments):
        raise error

    monkeypatch.setattr(opening, "QuickSocketCan", refuse)
    with pytest.raises(BusError) as raised:
        open_bus(CAN0)
    assert str(raised.value).startswith(f"CAN bus main (socketcan, channel can0): {words}")


def test_an_interface_that_is_down_is_named(monkeypatch):
    class Down:
        closed = False

        def recv(self, timeout):
            raise can.CanOperationError("Failed to receive: Network is down", errno.ENETDOWN)

        def shutdown(self):
            self.closed = True

    down = Down()
    monkeypatch.setattr(opening, "QuickSocketCan", lambda *arguments: down)
    with pytest.raises(
        BusError, match="the interface is down; `ip link set can0 up type can bitrate 1000000`"
    ):
        open_bus(CAN0)
    assert down.closed


def test_an_unknown_interface_type_is_named():
    with pytest.raises(BusError, match="python-can has no interface of this type"):
        open_bus(BusConfig("main", "carrier_pigeon", "can0", 1_000_000))


def test_buses_already_open_are_closed_when_a_later_one_fails(mapping, monkeypatch):
    mapping["buses"]["second"] = {"interface": "carrier_pigeon", "channel": "x", "bitrate": 1_000_000}
    closed = []
    monkeypatch.setattr(CanPort, "close", lambda port: closed.append(port.name) or port.network.disconnect())
    with pytest.raises(BusError, match="CAN bus second"):
        open_ports(CanConfig.from_mapping(mapping, "can.yaml"))
    assert closed == ["main"]


class BrokenBus(can.BusABC):
    """A bus that fails a few times, as an interface does that went down and came back."""

    def __init__(self, failures):
        super().__init__("broken")
        self.failures = failures

    def _recv_internal(self, timeout):
        if self.failures:
            self.failures -= 1
            raise can.CanOperationError("Network is down", errno.ENETDOWN)
        time.sleep(0.01)
        return can.Message(arbitration_id=0x181, data=b"\x01"), False

    def send(self, message, timeout=None):
        raise can.CanOperationError("Transmit buffer full")


def test_receiving_goes_on_after_failures_and_sending_reports(wait_until):
    port = CanPort("main", BrokenBus(failures=2))
    received = []
    port.subscribe(0x181, lambda data, now: received.append(bytes(data)))
    try:
        wait_until(lambda: received)
        assert port.bus_errors == 2
        assert not port.send(can.Message(arbitration_id=0x201))
        assert port.send_errors == 1
        assert port.last_problem == "sending COB-ID 0x201: Transmit buffer full"
        assert port.network.notifier.exception is None
    finally:
        port.close()


def test_error_and_remote_frames_are_not_data(config, ports, far_end, wait_until):
    received = []
    ports["main"].subscribe(0x181, lambda data, now: received.append(bytes(data)))
    far_end.bus.send(can.Message(arbitration_id=0x181, is_error_frame=True, is_extended_id=False))
    far_end.bus.send(can.Message(arbitration_id=0x181, is_remote_frame=True, is_extended_id=False))
    far_end.send(0x181, b"\x05")
    wait_until(lambda: received)
    assert received == [b"\x05"]
    assert ports["main"].bus_errors == 1


def test_frames_carry_the_time_at_which_they_were_on_the_bus(ports, far_end, wait_until):
    times = []
    ports["main"].subscribe(0x181, lambda data, now: times.append(now))
    before = time.monotonic()
    far_end.send(0x181, b"")
    wait_until(lambda: times)
    assert before - 1e-3 <= times[0] <= time.monotonic()
    ports["main"].receive(can.Message(arbitration_id=0x181, timestamp=0.0))
    assert times[1] == pytest.approx(time.monotonic(), abs=0.5)


def test_a_second_producer_of_sync_is_a_problem(ports, far_end, wait_until):
    beats = []
    ports.on_sync(lambda now, stamp: beats.append(stamp), threading.Lock())
    far_end.send(0x080, b"")
    wait_until(lambda: beats)
    ports.send_sync()
    far_end.send(0x080, b"")
    wait_until(lambda: ports["main"].malformed_frames == 1)
    assert "another device sends SYNC as well" in ports["main"].last_problem
    assert len(beats) == 2


class FullBus(can.BusABC):
    """A bus whose queue is full for a number of frames, as with a short txqueuelen."""

    def __init__(self, full):
        super().__init__("full")
        self.full = full
        self.sent = []

    def _recv_internal(self, timeout):
        time.sleep(0.01)
        return None, False

    def send(self, message, timeout=None):
        if self.full:
            self.full -= 1
            raise can.CanOperationError("No buffer space available", errno.ENOBUFS)
        self.sent.append(message.arbitration_id)


@pytest.fixture
def full_port():
    port = CanPort("main", FullBus(full=3))
    yield port
    port.close()


def test_a_full_queue_is_tried_again_while_the_frame_is_worth_it(full_port):
    assert full_port.send(can.Message(arbitration_id=0x201), deadline=time.monotonic() + 60.0)
    assert full_port._bus.sent == [0x201]
    assert (full_port.send_retries, full_port.send_errors) == (3, 0)


def test_a_frame_that_is_worth_nothing_any_more_is_not_sent_late(full_port):
    full_port._bus.full = 10**9
    assert not full_port.send(can.Message(arbitration_id=0x201), deadline=time.monotonic() + 0.01)
    assert full_port.send_errors == 1
    retries = full_port.send_retries
    assert not full_port.send(can.Message(arbitration_id=0x080))  # a SYNC has no deadline: now or never
    assert full_port.send_retries == retries
    assert full_port.last_problem.startswith("sending COB-ID 0x080: No buffer space available")
    assert full_port._bus.sent == []


@pytest.mark.parametrize(
    ("kind", "data", "words"),
    [
        # linux/can/error.h: class in the identifier, state of the controller in byte 1.
        (0x040, bytes(8), "bus-off: the controller has left the bus after too many errors"),
        (0x004, bytes([0, 0x20, 0, 0, 0, 0, 0, 0]), "transmitter is error passive"),
        (0x020, bytes(8), "no acknowledge: no other node is on the bus"),
        (0x088, bytes(8), "protocol violation, bus error"),
    ],
)
def test_error_frames_in_words(kind, data, words):
    frame = can.Message(arbitration_id=kind, is_error_frame=True, is_extended_id=False, dlc=8, data=data)
    assert error_frame_text(frame) == words


def test_bus_off_is_a_failure_of_the_bus(full_port):
    failures = []
    full_port.on_failure = failures.append
    full_port.receive(can.Message(arbitration_id=0x004, is_error_frame=True, data=bytes(8)))
    assert failures == []
    full_port.receive(can.Message(arbitration_id=0x040, is_error_frame=True, data=bytes(8)))
    assert failures == ["bus-off: the controller has left the bus after too many errors"]


class DeadBus(FullBus):
    """A bus whose interface takes no frames at all."""

    def send(self, message, timeout=None):
        if self.full:
            raise can.CanOperationError("Network is down", errno.ENETDOWN)
        super().send(message, timeout)


def test_an_interface_that_takes_no_frames_is_a_failure_until_it_takes_one():
    port = CanPort("main", DeadBus(full=1))
    try:
        begin = time.monotonic()
        assert not port.send(can.Message(arbitration_id=0x201), deadline=begin + 60.0)
        assert time.monotonic() - begin < 30.0  # it is not tried again
        assert port.failure.startswith("Network is down")
        port._bus.full = 0
        assert port.send(can.Message(arbitration_id=0x201))
        assert port.failure == ""
    finally:
        port.close()


def test_a_receiving_thread_that_ends_says_so(full_port):
    def defect(problem):
        raise RuntimeError("defect")

    full_port.on_failure = defect
    with pytest.raises(RuntimeError):  # it ends the thread in which this is called
        full_port.receive_failed(can.CanOperationError("Network is down", errno.ENETDOWN))
    assert full_port.ended == (
        "the driver's thread 'bus main' has ended (RuntimeError: defect): start the driver again"
    )
