"""A device on a desk: one emulated device, a plant that only takes notes, and a master's end of the bus."""

from __future__ import annotations

import dataclasses
import struct
from pathlib import Path

import can
import canopen
import numpy as np
import pytest

from cspr_drivers.canopen.frame_table import FunctionCode, cob_id
from cspr_drivers.canopen.units import DriveUnits, LoadCellUnits
from cspr_drivers.clock import Clock
from cspr_drivers.config.can_config import CanConfig, DriveConfig, LoadCellConfig
from cspr_drivers.config.can_file import BrakeOutput
from cspr_drivers.simulation.devices.drive import DriveEmulator
from cspr_drivers.simulation.devices.load_cell import LoadCellEmulator
from cspr_drivers.simulation.devices.node import EmulatedNode
from cspr_drivers.simulation.plant.shared import SharedPlant
from cspr_drivers.simulation.simulation_config import (
    BrakeProperties,
    DriveProperties,
    LoadCellProperties,
    PayloadChange,
    Sling,
)
from cspr_kinematics import Payload

EDS = Path(__file__).parents[3] / "config" / "eds"
NODE_ID = 5
MASTER_ID = 127

OPEN_DELAY = 0.03
CLOSE_DELAY = 0.02
QUICK_STOP_TIME = 0.25
DAMPING = 0.2


class NotedPlant:
    """A plant without dynamics: it holds what it is told, and moves as the test says."""

    def __init__(self, count: int = 1) -> None:
        self.time = 0.0
        self.payload = Payload.none()
        self.growth = 0.0
        self.angles = np.zeros(count)
        self.speeds = np.zeros(count)
        self.torque = np.zeros(count)
        self.damping = np.zeros(count)
        self.brake_closed = np.ones(count, dtype=bool)
        self.brake_share = np.ones(count)
        self.slipped = np.zeros(count)
        self.caught = False
        self.cable_tensions = np.full(count, 600.0)
        self.torque_log: list[tuple[float, float]] = []  # time, torque of motor 0

    def advance(self, time: float) -> None:
        self.time = max(self.time, time)

    def set_payload(self, payload: Payload, duration: float = 0.0, sling: Sling | None = None) -> None:
        self.payload = payload
        self.growth = duration

    def set_torque(self, index: int, torque: float) -> None:
        self.torque[index] = torque
        if index == 0:
            self.torque_log.append((self.time, torque))

    def set_damping(self, index: int, gain: float) -> None:
        self.damping[index] = gain

    def set_brake(self, index: int, closed: bool) -> None:
        self.brake_closed[index] = closed

    def weaken_brake(self, index: int, share: float) -> None:
        self.brake_share[index] = share

    def slip_cable(self, index: int, length: float) -> None:
        self.slipped[index] += length

    def catch_platform(self, caught: bool) -> None:
        self.caught = caught

    def platform_position(self) -> np.ndarray:
        return np.array([self.time, 0.0, 0.0])  # tells when it was asked

    def platform_quaternion(self) -> np.ndarray:
        return np.array([0.0, 0.0, 0.0, 1.0])

    def motor_angles(self) -> np.ndarray:
        return self.angles.copy()

    def motor_speeds(self) -> np.ndarray:
        return self.speeds.copy()

    def motor_torques(self) -> np.ndarray:
        return self.torque.copy()

    def tensions(self) -> np.ndarray:
        return self.cable_tensions.copy()


class StillClock(Clock):
    """A clock that stands still until told."""

    def __init__(self) -> None:
        self.time = 100.0
        self.day = 1.7e9  # s since 1970, less the monotonic time

    def monotonic(self) -> float:
        return self.time

    def system_ns(self) -> int:
        return round(1e9 * self.time_of_day())

    def time_of_day(self) -> float:
        return self.time + self.day


class Wire:
    """The device's end of the bus: takes notes of what the device sends."""

    def __init__(self) -> None:
        self.frames: list[tuple[int, bytes]] = []

    def send(self, message: can.Message) -> None:
        self.frames.append((message.arbitration_id, bytes(message.data)))


class Desk:
    """One device, and the frames of a master to it."""

    def __init__(self, changes: tuple[PayloadChange, ...] = ()) -> None:
        self.clock = StillClock()
        self.plant = NotedPlant()
        self.machine = SharedPlant(self.plant, changes, self.clock)
        self.wire = Wire()
        self.network = canopen.Network(self.wire)
        self.node: EmulatedNode

    def connect(self, node: EmulatedNode) -> None:
        self.node = node
        self.network.add_node(node)
        node.power_on()

    def send(self, can_id: int, data: bytes) -> None:
        self.network.notify(can_id, bytearray(data), self.clock.time_of_day())

    def nmt(self, command: int, node_id: int = NODE_ID) -> None:
        self.send(0x000, bytes([command, node_id]))

    def frames(self, can_id: int) -> list[bytes]:
        """Return what the device has sent under a COB-ID since the last call for it."""
        found = [data for sender, data in self.wire.frames if sender == can_id]
        self.wire.frames = [frame for frame in self.wire.frames if frame[0] != can_id]
        return found

    def emergencies(self) -> list[int]:
        return [int.from_bytes(data[:2], "little") for data in self.frames(0x080 + NODE_ID)]

    def write(self, index: int, subindex: int, value: int, size: int, signed: bool = False) -> int:
        """Write an object by SDO; return the abort code, 0 when the device accepts."""
        data = value.to_bytes(size, "little", signed=signed)
        head = struct.pack("<BHB", 0x23 | (4 - size) << 2, index, subindex)
        self.send(cob_id(FunctionCode.SDO_REQUEST, NODE_ID), head + data.ljust(4, b"\0"))
        (answer,) = self.frames(cob_id(FunctionCode.SDO_RESPONSE, NODE_ID))
        return int.from_bytes(answer[4:], "little") if answer[0] == 0x80 else 0

    def read(self, index: int, subindex: int, signed: bool = False) -> int:
        """Read an object by SDO; return its value, or the abort code."""
        self.send(cob_id(FunctionCode.SDO_REQUEST, NODE_ID), struct.pack("<BHBI", 0x40, index, subindex, 0))
        (answer,) = self.frames(cob_id(FunctionCode.SDO_RESPONSE, NODE_ID))
        if answer[0] == 0x80:
            return int.from_bytes(answer[4:], "little")
        size = 4 - (answer[0] >> 2 & 0x3)
        return int.from_bytes(answer[4 : 4 + size], "little", signed=signed)

    def map(
        self, communication: int, can_id: int, kind: int, objects: tuple[int, ...], timer: int = 0
    ) -> None:
        """Configure a PDO in the order of CiA 301."""
        mapping = communication + 0x200
        assert self.write(communication, 1, 0x8000_0000 | can_id, 4) == 0
        assert self.write(communication, 2, kind, 1) == 0
        assert self.write(communication, 5, timer, 2) == 0
        assert self.write(mapping, 0, 0, 1) == 0
        for subindex, entry in enumerate(objects, 1):
            assert self.write(mapping, subindex, entry, 4) == 0
        assert self.write(mapping, 0, len(objects), 1) == 0
        assert self.write(communication, 1, can_id, 4) == 0

    def sync(self) -> None:
        time = self.machine.time_at(self.clock.time_of_day())
        self.machine.advance(time)
        self.node.sync()

    def wait(self, duration: float) -> None:
        """Let time pass, with a tick every millisecond."""
        for _ in range(round(duration / 1e-3)):
            self.clock.time += 1e-3
            self.node.tick(self.machine.now())


class DriveDesk(Desk):
    """A drive, configured as the driver does, in NMT operational."""

    RPDO = 0x200 + NODE_ID
    TPDO = 0x180 + NODE_ID

    def __init__(self, polarity: int = 1, brake_output: BrakeOutput | None = None) -> None:
        super().__init__()
        units = DriveUnits(polarity, 65536, 1000, rated_torque=5.0, torque_limit=10.0)
        drives = (DriveConfig("motor_1", "main", NODE_ID, units),)
        self.drive = DriveEmulator(
            dataclasses.replace(
                CanConfig.from_yaml(EDS.parent / "can.yaml"), drives=drives, brake_output=brake_output
            ),
            0,
            EDS / "cia402_drive.eds",
            self.machine,
            BrakeProperties(OPEN_DELAY, CLOSE_DELAY, 12.0),
            DriveProperties(DAMPING, QUICK_STOP_TIME),
        )
        self.connect(self.drive)
        self.wait(0.002)

    def configure(self, rpdo_timeout: int = 0, abort_option: int = 1) -> None:
        assert self.write(0x6060, 0, 10, 1) == 0
        assert self.write(0x6072, 0, 2000, 2) == 0
        assert self.write(0x6007, 0, abort_option, 2) == 0
        self.map(0x1400, self.RPDO, 255, (0x60400010, 0x60710010), rpdo_timeout)
        self.map(0x1800, self.TPDO, 1, (0x60410010, 0x60640020, 0x60770010))
        self.nmt(1)
        self.wire.frames.clear()

    def command(self, word: int, torque: int = 0) -> None:
        """Send an RPDO: control word and target torque in thousandths."""
        self.send(self.RPDO, struct.pack("<Hh", word, torque))

    def status(self) -> int:
        return self.read(0x6041, 0)

    def enable(self, torque: int = 0) -> None:
        """Lead the drive to operation enabled and wait for the brake."""
        for word in (0x06, 0x07, 0x0F):
            self.command(word, torque)
        self.wait(OPEN_DELAY + 0.002)
        assert self.drive.automaton.brake_open


class LoadCellDesk(Desk):
    """A load-cell amplifier, pre-operational."""

    TPDO = 0x180 + NODE_ID

    def __init__(self, noise_std: float = 0.0, gain_error: float = 0.0, offset: float = 0.0) -> None:
        super().__init__()
        self.cell = LoadCellEmulator(
            LoadCellConfig(
                "cable_1", "main", NODE_ID, LoadCellUnits(decimal_digits=1, scale=1.0, offset=0.0)
            ),
            EDS / "cia404_load_cell.eds",
            self.machine,
            0,
            LoadCellProperties(noise_std, [gain_error], [offset], conversion_time=0.0),
            seed=1,
        )
        self.connect(self.cell)

    def measure(self) -> tuple[int, int]:
        """Send a SYNC; return process value and status of the answer."""
        self.clock.time += 0.004
        self.sync()
        (frame,) = self.frames(self.TPDO)
        value, status = struct.unpack("<iB", frame)
        return value, status


@pytest.fixture
def drive_desk() -> type[DriveDesk]:
    """Return the class, for tests that configure the drive themselves."""
    return DriveDesk


@pytest.fixture
def load_cell_desk() -> type[LoadCellDesk]:
    return LoadCellDesk


@pytest.fixture
def noted_plant() -> type[NotedPlant]:
    return NotedPlant


@pytest.fixture
def clock() -> StillClock:
    return StillClock()


@pytest.fixture
def desk() -> DriveDesk:
    """Return a drive that is configured and in NMT operational."""
    desk = DriveDesk()
    desk.configure()
    return desk


@pytest.fixture(scope="session")
def repository() -> Path:
    """Return the directory of the repository."""
    return Path(__file__).parents[3]
