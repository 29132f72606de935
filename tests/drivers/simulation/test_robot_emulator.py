"""The emulated robot on virtual buses, in real time, as a driver meets it."""

import dataclasses
import struct
import threading
import time
import uuid
from contextlib import contextmanager
from pathlib import Path

import can
import canopen
import pytest

from cspr_drivers.canopen.cia402 import State, decode_state
from cspr_drivers.config.can_config import BusConfig, CanConfig
from cspr_drivers.errors import BusError, ConfigurationError
from cspr_drivers.simulation.robot_emulator import RobotEmulator
from cspr_drivers.simulation.simulation_config import SimulationConfig

CONFIG = Path(__file__).parents[3] / "config"
EDS = CONFIG / "eds"
MASTER_ID = 127
CYCLE = 0.004
PATIENCE = 120.0


def two_buses() -> CanConfig:
    """Return the shipped configuration with the second half of the devices on a bus of its own."""
    config = CanConfig.from_yaml(CONFIG / "can.yaml")
    buses = tuple(
        BusConfig(name, "virtual", f"{name} {uuid.uuid4()}", 1_000_000) for name in ("left", "right")
    )

    def spread(devices):
        half = len(devices) // 2
        return tuple(dataclasses.replace(d, bus=buses[i >= half].name) for i, d in enumerate(devices))

    return dataclasses.replace(
        config, buses=buses, drives=spread(config.drives), load_cells=spread(config.load_cells)
    )


def write(sdo, index, subindex, value, size) -> None:
    sdo.RESPONSE_TIMEOUT = 2.0
    sdo.download(index, subindex, value.to_bytes(size, "little"))


def write_pdo(sdo, communication, can_id, kind, mapping) -> None:
    write(sdo, communication, 1, 0x8000_0000 | can_id, 4)
    write(sdo, communication, 2, kind, 1)
    write(sdo, communication + 0x200, 0, 0, 1)
    for subindex, entry in enumerate(mapping, 1):
        write(sdo, communication + 0x200, subindex, entry, 4)
    write(sdo, communication + 0x200, 0, len(mapping), 1)
    write(sdo, communication, 1, can_id, 4)


def until(condition, meanwhile=lambda: time.sleep(0.01)) -> None:
    """Wait for a condition, however slow the machine is; fail if nothing comes of it."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end, "nothing came of it"
        meanwhile()


class Master:
    """A driver reduced to its frames."""

    def __init__(self, config: CanConfig) -> None:
        self.config = config
        self.buses = {bus.name: can.Bus(interface="virtual", channel=bus.channel) for bus in config.buses}
        self.status: dict[int, int] = {}
        self.position: dict[int, int] = {}
        self.cells: dict[int, int] = {}
        self.word = 0
        self.torque = dict.fromkeys((drive.node_id for drive in config.drives), 0)

    def configure(self) -> None:
        """Configure all devices by SDO and start them."""
        pdo = self.config.pdo
        for bus in self.config.buses:
            network = canopen.Network()
            network.NOTIFIER_CYCLE = 0.05
            network.connect(interface="virtual", channel=bus.channel)
            try:
                for drive in [drive for drive in self.config.drives if drive.bus == bus.name]:
                    sdo = network.add_node(drive.node_id, canopen.ObjectDictionary()).sdo
                    write(sdo, 0x6060, 0, 10, 1)
                    write(sdo, 0x6072, 0, drive.units.max_torque, 2)
                    write(sdo, 0x1016, 1, MASTER_ID << 16 | 500, 4)
                    write_pdo(sdo, 0x1400, 0x200 + drive.node_id, 255, pdo.drive_rpdo.mapping)
                    write_pdo(sdo, 0x1800, 0x180 + drive.node_id, 1, pdo.drive_tpdo.mapping)
                for cell in [cell for cell in self.config.load_cells if cell.bus == bus.name]:
                    sdo = network.add_node(cell.node_id, canopen.ObjectDictionary()).sdo
                    write_pdo(sdo, 0x1800, 0x180 + cell.node_id, 1, pdo.load_cell_tpdo.mapping)
                network.send_message(0x000, [1, 0])
            finally:
                network.disconnect()

    def send(self, bus: str, can_id: int, data: bytes = b"") -> None:
        self.buses[bus].send(can.Message(arbitration_id=can_id, is_extended_id=False, data=data))

    def cycle(self, heartbeat: bool = True) -> None:
        """Run one cycle: SYNC, the answers, the RPDOs."""
        end = time.monotonic() + CYCLE
        for bus in self.buses:
            if heartbeat:
                self.send(bus, 0x700 + MASTER_ID, b"\x05")
            self.send(bus, 0x080)
        for drive in self.config.drives:
            data = struct.pack("<Hh", self.word, self.torque[drive.node_id])
            self.send(drive.bus, 0x200 + drive.node_id, data)
        for bus in self.buses.values():
            while (message := bus.recv(max(0.0, end - time.monotonic()))) is not None:
                self._take(message)
        time.sleep(max(0.0, end - time.monotonic()))

    def _take(self, message: can.Message) -> None:
        node_id = message.arbitration_id - 0x180
        if node_id in self.torque:
            self.status[node_id], self.position[node_id], _ = struct.unpack("<Hih", message.data)
        elif 0 < node_id < 0x80:
            self.cells[node_id] = struct.unpack("<iB", message.data)[0]

    def states(self) -> set[State]:
        return {decode_state(word) for word in self.status.values()}

    def lead(self, word: int, state: State) -> None:
        """Send a control word until all drives report a state."""
        self.word = word
        self.cycle()
        until(lambda: self.states() == {state}, self.cycle)

    def close(self) -> None:
        for bus in self.buses.values():
            bus.shutdown()


@pytest.fixture(scope="module")
def simulation() -> SimulationConfig:
    return SimulationConfig.from_yaml(CONFIG / "simulation.yaml")


@pytest.fixture
def plant(noted_plant):
    return noted_plant(8)


@contextmanager
def operated(simulation, plant):
    """Return devices around a plant, and a master that has configured them."""
    config = two_buses()
    with RobotEmulator(config, simulation, plant, EDS) as emulator:
        master = Master(config)
        try:
            master.configure()
            yield emulator, master
        finally:
            master.close()


@pytest.fixture
def rig(simulation, plant):
    with operated(simulation, plant) as (emulator, master):
        yield emulator, master, plant


def test_enable_and_disable_over_two_buses(rig):
    _, master, plant = rig
    master.torque = dict.fromkeys(master.torque, -100)
    master.lead(0x06, State.READY_TO_SWITCH_ON)
    master.lead(0x07, State.SWITCHED_ON)
    assert plant.brake_closed.all()
    master.lead(0x0F, State.OPERATION_ENABLED)
    until(lambda: not plant.brake_closed.any(), master.cycle)
    signs = [drive.units.polarity for drive in master.config.drives]
    assert plant.torque == pytest.approx([-0.5 * sign for sign in signs])
    until(lambda: len(master.cells) == 8, master.cycle)
    master.lead(0x07, State.SWITCHED_ON)
    assert plant.brake_closed.all()
    assert not plant.torque.any()


def test_silent_master_ends_with_closed_brakes(rig):
    emulator, master, plant = rig
    for word, state in (
        (0x06, State.READY_TO_SWITCH_ON),
        (0x07, State.SWITCHED_ON),
        (0x0F, State.OPERATION_ENABLED),
    ):
        master.lead(word, state)
    until(lambda: not plant.brake_closed.any(), master.cycle)
    until(plant.brake_closed.all)
    assert {drive.automaton.state for drive in emulator.drives} == {State.FAULT}


def test_load_does_not_drop_when_the_master_falls_silent(simulation):
    """Brakes, enabling, holding and quick stop on the machine itself: the platform stays where it is."""
    pytest.importorskip("mujoco")
    from cspr_drivers.simulation.plant.plant import Plant

    plant = Plant(simulation)
    winch = simulation.robot.winch
    with operated(simulation, plant) as (emulator, master):
        start = plant.platform_position()
        holding = winch.motor_torque(plant.tensions())
        for drive, torque in zip(master.config.drives, holding, strict=True):
            master.torque[drive.node_id] = drive.units.per_mille(torque)
        for word, state in (
            (0x06, State.READY_TO_SWITCH_ON),
            (0x07, State.SWITCHED_ON),
            (0x0F, State.OPERATION_ENABLED),
        ):
            master.lead(word, state)
        until(lambda: all(drive.automaton.brake_open for drive in emulator.drives), master.cycle)
        until(lambda: not any(drive.automaton.powered for drive in emulator.drives))
        time.sleep(0.1)
        with emulator.machine.lock:
            assert not any(drive.automaton.powered for drive in emulator.drives)
            assert plant.platform_position() == pytest.approx(start, abs=1e-3)
            assert plant.tensions().min() > 0.0


def test_a_sync_seen_too_late_is_not_answered(rig):
    emulator, master, _ = rig
    held, sending, let_go = threading.Event(), threading.Event(), threading.Event()

    def hold() -> None:
        with emulator.machine.lock:
            held.set()
            let_go.wait(5.0)

    def send() -> None:
        sending.set()
        master.send(next(iter(master.buses)), 0x080)

    holder, sender = threading.Thread(target=hold), threading.Thread(target=send)
    holder.start()
    assert held.wait(5.0)
    sender.start()
    assert sending.wait(5.0)
    time.sleep(0.3)  # the SYNC grows old in front of the lock
    let_go.set()
    sender.join(5.0)
    holder.join(5.0)
    assert emulator.missed_syncs == 1
    until(lambda: len(master.cells) == 8, master.cycle)


def test_plant_follows_the_clock_without_sync(rig):
    _, _, plant = rig
    before, begin = plant.time, time.monotonic()
    until(lambda: plant.time - before >= 0.2)
    # it may lag behind on a busy machine, and is never ahead by more than what it computes at once
    assert plant.time - before < time.monotonic() - begin + 0.1


def test_payload(rig):
    emulator, _, plant = rig
    emulator.change_payload(50.0, (0.0, 0.0, 0.0))
    until(lambda: emulator.payload.mass == 50.0)
    due = time.time() + 0.3
    emulator.change_payload(80.0, (0.0, 0.0, 0.0), at=due)
    until(lambda: plant.payload.mass == 80.0)
    assert time.time() >= due


def test_the_true_pose_comes_once_for_the_syncs_of_all_buses(simulation, plant):
    """A driver in this process announces the stamp of each cycle; without one the SYNC's own time is the stamp."""
    config, poses, announced = two_buses(), [], []
    with RobotEmulator(config, simulation, plant, EDS, publish_pose=poses.append) as emulator:
        ends = [can.Bus(interface="virtual", channel=bus.channel) for bus in config.buses]
        sync = can.Message(arbitration_id=0x080, is_extended_id=False)
        for cycle in range(6):
            before, sent = time.time_ns(), ends[:1]
            if cycle >= 3:
                announced.append(before)
                emulator.announce_sync(time.monotonic(), before)
                sent = ends
            for end in sent:
                end.send(sync)
            until = time.monotonic() + PATIENCE
            while len(poses) <= cycle and time.monotonic() < until:
                time.sleep(CYCLE)
            if cycle < 3:
                assert before - 1_000_000 < poses[cycle].stamp_ns < time.time_ns()
                sensed = 1e-9 * poses[cycle].stamp_ns - emulator.machine.ros_time(0.0)
                # the plant tells its time as the first coordinate
                assert poses[cycle].position[0] == pytest.approx(sensed, abs=1e-3)
        for end in ends:
            end.shutdown()
    assert [pose.stamp_ns for pose in poses[3:]] == announced


def test_slack_cables_are_named(rig):
    emulator, _, plant = rig
    plant.cable_tensions[[2, 5]] = 0.0
    until(lambda: emulator.slack_cables() == (2, 5))


def test_number_of_devices_must_fit(simulation, plant):
    config = two_buses()
    config = dataclasses.replace(config, drives=config.drives[:-1])
    with pytest.raises(ConfigurationError, match="drives: lists 7 devices"):
        RobotEmulator(config, simulation, plant, EDS)


def test_missing_eds_file(simulation, plant, tmp_path):
    with pytest.raises(ConfigurationError, match=r"cia402_drive\.eds"):
        RobotEmulator(two_buses(), simulation, plant, tmp_path)


def test_missing_interface(simulation, plant):
    config = two_buses()
    right = dataclasses.replace(config.buses[1], interface="socketcan", channel="nocan7")
    with pytest.raises(BusError, match="nocan7"):
        RobotEmulator(dataclasses.replace(config, buses=(config.buses[0], right)), simulation, plant, EDS)
