"""Answers to SDO requests, as frames that a test puts on the bus in a device's name."""

import contextlib
import random
import struct
from types import SimpleNamespace

import canopen
import pytest

from cspr_drivers.canopen.object_entry import Parameter
from cspr_drivers.clock import COMPUTER
from cspr_drivers.devices.device import CanopenDevice
from cspr_drivers.errors import DeviceError

CURRENT = Parameter(0x6075, 0, 32, 0, "motor rated current, mA")


class Network(canopen.Network):
    """A bus on which each request to node 1 is answered at once."""

    def __init__(self, *answers):
        super().__init__()
        self.answers = answers

    def send_message(self, can_id, data, remote=False):
        if can_id == 0x601 and data[0] != 0x80:
            for answer in self.answers:
                self.notify(0x581, bytearray(answer(data) if callable(answer) else answer), 0.0)


def device(*answers):
    return CanopenDevice("motor_1", SimpleNamespace(clock=COMPUTER, network=Network(*answers)), 1, 0.01)


def upload(number, size=4, index=0x6075):
    """Return the frame of an expedited upload (CiA 301, section 7.2.4.3.5)."""
    return struct.pack("<BHBI", 0x43 | (4 - size) << 2, index, 0, number)


def test_of_two_answers_the_first_counts():
    assert device(upload(4200), upload(5000)).read(CURRENT) == 4200


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (b"", "it answers with 0 bytes, not 8"),
        (b"\x80", "it answers with 1 byte (80), not 8"),
        (upload(4200)[:6], "it answers with 6 bytes (43 75 60 00 68 10), not 8"),
        (upload(7, size=1), "its content is 1 byte (07), not 4"),
        (upload(7, index=0x6076), "Node returned a value for 0x6076:00 instead"),
        (b"\x60" + bytes(7), "Unexpected response 0x60"),
    ],
)
def test_an_answer_that_cannot_be_used_is_named_with_device_and_object(answer, words):
    with pytest.raises(DeviceError) as refusal:
        device(answer).read(CURRENT)
    assert str(refusal.value).startswith(f"motor_1: 6075h:00 (motor rated current, mA) read: {words}")


def test_a_silent_device_is_named():
    with pytest.raises(DeviceError, match=r"^motor_1: does not answer$"):
        device().read(CURRENT)


def test_a_refusal_comes_with_its_code():
    with pytest.raises(DeviceError, match=r"refuses 6075h:00 .* read: Object does not exist.*0x06020000"):
        device(struct.pack("<BHBI", 0x80, 0x6075, 0, 0x0602_0000)).read(CURRENT)


def test_an_object_without_end_is_not_read_for_ever():
    toggle = iter(range(10**9))

    def segments(request):
        if request[0] == 0x40:
            return struct.pack("<BHBI", 0x40, 0x6075, 0, 0)  # the content follows in segments
        return bytes([next(toggle) % 2 << 4]) + b"endless"

    with pytest.raises(DeviceError, match="its content has more than 112 bytes"):
        device(segments).read(CURRENT)


@pytest.mark.parametrize("size", range(9))
@pytest.mark.parametrize("transfer", ["read", "write"])
def test_whatever_a_device_answers_is_a_number_or_an_error_of_the_device(size, transfer):
    drawn = random.Random(size)

    def answer(request):
        content = drawn.randbytes(size)
        if drawn.random() < 0.5:  # now and then one that begins as the right one does
            head = bytes([drawn.choice((0x43, 0x4F, 0x41, 0x40, 0x60, 0x80, 0x00))]) + bytes(request[1:4])
            content = (head + content[4:])[:size]
        return content

    own = device(answer)
    for _ in range(500):
        with contextlib.suppress(DeviceError):
            if transfer == "write":
                own.write(CURRENT)
            else:
                assert 0 <= own.read(CURRENT) < 2**32
