"""The emulated devices on the kernel's CAN: they outlive their interface, whichever of their threads hears of it."""

import struct
import time

import can
import pytest

from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.simulation.robot_emulator import RobotEmulator
from cspr_drivers.simulation.simulation_config import SimulationConfig

PATIENCE = 60.0  # s
UPLOAD_DEVICE_TYPE = bytes.fromhex("40 00 10 00 00 00 00 00")  # CiA 301, section 7.2.4.3.5


@pytest.fixture
def devices(root, plug_in, two_buses_file):
    from cspr_drivers.simulation.plant.plant import Plant

    for channel in ("vcan0", "vcan1"):
        plug_in(channel)
    simulation = SimulationConfig.from_yaml(root / "config" / "simulation.yaml")
    config = CanConfig.from_yaml(two_buses_file)
    with RobotEmulator(config, simulation, Plant(simulation), root / "config" / "eds") as emulator:
        yield emulator
    for channel in ("vcan0", "vcan1"):
        plug_in(channel)


def answers(channel):
    """Return whether a drive on the bus answers, asked again and again."""
    with can.Bus(interface="socketcan", channel=channel) as bus:
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            bus.send(can.Message(arbitration_id=0x605, data=UPLOAD_DEVICE_TYPE, is_extended_id=False))
            moment = time.monotonic() + 0.5
            while time.monotonic() < moment:
                frame = bus.recv(0.1)
                if frame is not None and frame.arbitration_id == 0x585:
                    return struct.unpack_from("<I", frame.data, 4)[0] & 0xFFFF == 402
    return False


@pytest.mark.parametrize("gone", [("set", "vcan1", "down"), ("delete", "vcan1")], ids=["down", "removed"])
def test_they_answer_when_their_interface_is_back(devices, ip, plug_in, gone):
    assert answers("vcan1")
    ip("link", *gone)
    time.sleep(0.5)  # nobody sends: the receiving thread is the one that hears of it
    plug_in("vcan1")
    assert answers("vcan1")
