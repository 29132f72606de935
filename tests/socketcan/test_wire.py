"""What is on the wire, as candump sees it: start-up, one cycle, enabling and disabling."""

import time

import pytest
from numpy import array

SYNC, NMT = 0x080, 0x000


def between(frames, begin, end):
    return [frame for frame in frames if begin <= frame.time < end]


def sdo_writes(frames, node):
    """Return index, subindex and data of each expedited download to a node (CiA 301, section 7.2.4.3.3)."""
    writes = []
    for frame in frames:
        if frame.identifier == 0x600 + node and frame.data[0] & 0xE3 == 0x23:
            size = 4 - (frame.data[0] >> 2 & 3)
            index = int.from_bytes(frame.data[1:3], "little")
            writes.append((index, frame.data[3], frame.data[4 : 4 + size].hex(" ")))
    return writes


def test_a_drive_is_set_up_in_the_order_of_the_standard(bench):
    frames = bench.wire.frames()
    assert {frame.channel for frame in frames if frame.identifier == 0x601} == {"vcan0"}
    assert {frame.channel for frame in frames if frame.identifier == 0x605} == {"vcan1"}
    writes = sdo_writes(frames, 1)
    # CiA 301, section 7.5.2.36: PDO off, no objects, the objects, their number, PDO on
    mapping = [
        (0x1A00, 0, "00"),
        (0x1A00, 1, "10 00 41 60"),
        (0x1A00, 2, "20 00 64 60"),
        (0x1A00, 3, "10 00 77 60"),
        (0x1A00, 0, "03"),
        (0x1800, 1, "81 01 00 40"),  # 181h, no remote requests
    ]
    places = [writes.index(write) for write in mapping]
    assert places == sorted(places)
    off = writes.index((0x1800, 1, "81 01 00 c0"))
    assert off < places[0]
    assert (0x6060, 0, "0a") in writes  # cyclic synchronous torque
    assert (0x1016, 1, "84 03 7f 00") in writes  # heartbeat of node 127 within 900 ms
    # then, and only then, the node is started
    started = [f.time for f in frames if f.identifier == NMT and f.data == bytes([0x01, 0x01])]
    assert started
    assert max(f.time for f in frames if f.identifier == 0x601 and f.time < started[-1]) < started[-1]


def test_a_cycle_on_both_buses(bench):
    bench.enable()
    begin = time.time()
    time.sleep(3.0)
    end = time.time()
    bench.disable()
    frames = between(bench.wire.frames(), begin, end)
    for channel, drives, cells in (
        ("vcan0", range(1, 5), range(11, 15)),
        ("vcan1", range(5, 9), range(15, 19)),
    ):
        here = [frame for frame in frames if frame.channel == channel]
        syncs = [frame.time for frame in here if frame.identifier == SYNC]
        assert syncs
        assert all(frame.data == b"" for frame in here if frame.identifier == SYNC)
        expected = {SYNC, 0x77F}
        for node in drives:
            expected |= {0x180 + node, 0x200 + node, 0x700 + node}
            states = [frame.data for frame in here if frame.identifier == 0x180 + node]
            assert {len(data) for data in states} == {8}
            # operation enabled (x01x 0111) with voltage, remote and the brake's bit 14
            assert {int.from_bytes(data[:2], "little") & 0x426F for data in states} == {0x4227}
            commands = [frame.data for frame in here if frame.identifier == 0x200 + node]
            assert {data[:2] for data in commands} == {bytes.fromhex("0F 00")}
            # The torque holds a cable of the empty platform: some hundred newtons, 1/600 of a metre at the shaft
            polarity = 1 if node % 2 else -1
            torques = array([int.from_bytes(data[2:], "little", signed=True) for data in commands])
            assert -500 < polarity * torques.mean() < -20, f"node {node}: per mille of 5 N m"
        for node in cells:
            expected |= {0x180 + node, 0x700 + node}
            assert {len(f.data) for f in here if f.identifier == 0x180 + node} == {5}
        assert {frame.identifier for frame in here} == expected
        assert {frame.data for frame in here if frame.identifier == 0x77F} == {b"\x05"}


def test_round_trip_and_lost_frames_are_told(bench, wire_report, capsys):
    bench.enable()
    begin = time.time()
    time.sleep(5.0)
    end = time.time()
    bench.disable()
    report = wire_report(between(bench.wire.frames(), begin, end))
    with capsys.disabled():
        print(f"\n{report}")
    assert report.cycles > 20
    assert report.commands > 0


def test_enabling_goes_through_the_states_of_cia_402(bench):
    begin = time.time()
    bench.enable()
    bench.disable()
    frames = bench.wire.frames(since=begin)
    for node in (1, 8):
        words = [int.from_bytes(f.data[:2], "little") for f in frames if f.identifier == 0x180 + node]
        patterns = [word & 0x6F for word in words]
        steps = [p for p, before in zip(patterns, [None, *patterns], strict=False) if p != before]
        # ready to switch on, switched on, operation enabled, and the same way back
        assert steps == [0x40, 0x21, 0x23, 0x27, 0x23, 0x21, 0x40] or steps == [
            0x60, 0x21, 0x23, 0x27, 0x23, 0x21, 0x60
        ], [hex(step) for step in steps]  # fmt: skip


@pytest.mark.parametrize("word", ["0F 00"])
def test_the_first_torque_of_an_enabled_drive_is_that_of_the_controller(bench, word):
    """A brake never opens on zero torque: the RPDO that enables carries the controller's torque."""
    begin = time.time()
    bench.enable()
    bench.disable()
    for node in range(1, 9):
        enabling = [
            frame.data
            for frame in bench.wire.frames(since=begin)
            if frame.identifier == 0x200 + node and frame.data[:2] == bytes.fromhex(word)
        ]
        assert int.from_bytes(enabling[0][2:], "little", signed=True) != 0
