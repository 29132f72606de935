"""A scripted CAN bus for the drivers: devices as a few lines of state, reached by raw frames."""

import copy
import itertools
import struct
import threading
from pathlib import Path

import can
import pytest
import yaml

from cspr_drivers.bus.opening import open_ports
from cspr_drivers.config.can_config import CanConfig

REPOSITORY = Path(__file__).parents[2]
CHANNELS = itertools.count()

# Status words typed from IEC 61800-7-201, table of state coding, with bit 14 for the open brake; bit 4: the power
# stage has its supply; bit 12: the target torque is followed.
SWITCH_ON_DISABLED, READY, SWITCHED_ON, ENABLED, QUICK_STOP, FAULT = 0x50, 0x31, 0x33, 0x5037, 0x4017, 0x18


def numbers(**sizes):
    """Return objects from their numbers: ``numbers(u16={(0x6072, 0): 1000})``."""
    bytes_of = {"u8": 1, "u16": 2, "u32": 4}
    return {
        key: value.to_bytes(bytes_of[size], "little")
        for size, values in sizes.items()
        for key, value in values.items()
    }


def pdos(communication, node_id, cob_ids):
    """Return default PDOs as devices have them: valid COB-IDs, nothing mapped (CiA 301, section 7.5.2)."""
    objects = {}
    for place, base in enumerate(cob_ids):
        objects |= numbers(
            u32={(communication + place, 1): base + node_id}
            | {(communication + place + 0x200, entry): 0 for entry in range(1, 9)},
            u16={(communication + place, 5): 0},
            u8={(communication + place, 2): 255, (communication + place + 0x200, 0): 0},
        )
    return objects


class ScriptedNode:
    """A CANopen device that remembers its objects and does what a test tells it."""

    def __init__(self, node_id, product_code, objects):
        self.node_id = node_id
        identity = {(0x1018, 1): 0, (0x1018, 2): product_code, (0x1018, 3): 0x1_0000, (0x1018, 4): node_id}
        self.objects = numbers(u32=identity, u16={(0x1017, 0): 0}) | objects
        self._after_power_on = dict(self.objects)
        self.unanswered = {}
        self.operational = False
        self.answers_sdo = True
        self.answers_sync = True
        self.aborts = {}
        self.reads = []
        self.writes = []

    def sdo(self, data):
        """Return the answer to an expedited SDO request (CiA 301, section 7.2.4.3)."""
        command, index, subindex = struct.unpack_from("<BHB", data)
        address = struct.pack("<HB", index, subindex)
        key = (index, subindex)
        if key in self.aborts and command & 0xE0 != 0x40:
            return b"\x80" + address + struct.pack("<I", self.aborts[key])
        if self.unanswered.get(key):
            self.unanswered[key] -= 1
            if command & 0xE0 != 0x40:
                self.writes.append((index, subindex, bytes(data[4 : 8 - (command >> 2 & 3)])))
            return None
        if command & 0xE0 == 0x40:
            self.reads.append(key)
            if key not in self.objects and key not in self.live():
                return b"\x80" + address + struct.pack("<I", 0x0602_0000)
            value = self.live().get(key) or self.objects[key]
            return bytes([0x43 | (4 - len(value)) << 2]) + address + value.ljust(4, b"\0")
        size = 4 - (command >> 2 & 3)
        self.objects[key] = bytes(data[4 : 4 + size])
        self.writes.append((index, subindex, self.objects[key]))
        return b"\x60" + address + bytes(4)

    def restart(self):
        """Forget what was written, as after power-on; the boot-up message is for the test to send."""
        self.objects = dict(self._after_power_on)
        self.operational = False
        self.writes.clear()

    def live(self):
        """Return the objects that change by themselves."""
        return {}

    def read(self, index, subindex=0):
        return int.from_bytes(self.objects[index, subindex], "little")


TRANSITIONS = {
    (SWITCH_ON_DISABLED, 0x06): READY,
    (READY, 0x07): SWITCHED_ON,
    (READY, 0x00): SWITCH_ON_DISABLED,
    (READY, 0x02): SWITCH_ON_DISABLED,
    (SWITCHED_ON, 0x0F): ENABLED,
    (SWITCHED_ON, 0x06): READY,
    (SWITCHED_ON, 0x00): SWITCH_ON_DISABLED,
    (SWITCHED_ON, 0x02): SWITCH_ON_DISABLED,
    (ENABLED, 0x07): SWITCHED_ON,
    (ENABLED, 0x00): SWITCH_ON_DISABLED,
    (ENABLED, 0x02): QUICK_STOP,
}


class ScriptedDrive(ScriptedNode):
    """A drive that goes through the states of CiA 402 at once; its motor does not move by itself."""

    def __init__(self, node_id):
        super().__init__(
            node_id,
            0x402,
            numbers(
                u32={(0x1000, 0): 0x0002_0192, (0x6502, 0): 0x200, (0x1016, 1): 0}
                | {(0x6075, 0): 4200, (0x6076, 0): 5000, (0x608F, 1): 131072, (0x608F, 2): 1, (0x60FD, 0): 0},
                u16={(0x6007, 0): 1, (0x605A, 0): 2, (0x605B, 0): 1, (0x605C, 0): 1, (0x605D, 0): 1}
                | {(0x605E, 0): 2, (0x6072, 0): 1000},
                u8={(0x1029, 1): 0, (0x6060, 0): 0, (0x6061, 0): 10},
            )
            | pdos(0x1400, node_id, (0x200, 0x300, 0x400, 0x500))
            | pdos(0x1800, node_id, (0x180, 0x280, 0x380, 0x480)),
        )
        self.status = SWITCH_ON_DISABLED
        self.counts = 0
        self.velocity = 0
        self.torque = 0
        self.control = 0
        self.rpdos = []
        self.obeys = True

    def live(self):
        return {(0x6041, 0): self.status.to_bytes(2, "little")}

    def rpdo(self, data):
        control, torque = struct.unpack("<Hh", data)
        self.rpdos.append((control, torque))
        if self.obeys:
            if self.status == FAULT and control & 0x80 and not self.control & 0x80:
                self.status = SWITCH_ON_DISABLED
            self.status = TRANSITIONS.get((self.status, control), self.status)
        self.control = control
        self.torque = torque

    def tpdo(self):
        frame = struct.pack("<Hih", self.status, self.counts, self.torque)
        if self.status == QUICK_STOP and self.obeys:
            self.status = SWITCH_ON_DISABLED
        return frame


class ScriptedCell(ScriptedNode):
    """An amplifier with a constant value."""

    def __init__(self, node_id):
        super().__init__(
            node_id,
            0x404,
            numbers(u32={(0x1000, 0): 0x0002_0194, (0x6131, 1): 0, (0x9149, 1): 50_000}, u8={(0x6132, 1): 0})
            | pdos(0x1800, node_id, (0x180,)),
        )
        self.value = 100 * node_id
        self.status = 0

    def tpdo(self):
        return struct.pack("<iB", self.value, self.status)


class ScriptedBus:
    """The far end of one virtual bus: answers for all devices in one thread."""

    def __init__(self, channel, drives, cells):
        self.bus = can.Bus(interface="virtual", channel=channel)
        self.drives = drives
        self.cells = cells
        self.nodes = {node.node_id: node for node in (*drives, *cells)}
        self.heartbeats = 0
        self.master_heartbeats = 0
        self.beating = True
        self.frames = []
        self._running = True
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def send(self, identifier, data):
        self.bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))

    def close(self):
        self._running = False
        self._thread.join()
        self.bus.shutdown()

    def _serve(self):
        while self._running:
            message = self.bus.recv(0.02)
            if message is not None:
                self._receive(message.arbitration_id, bytes(message.data))

    def _receive(self, identifier, data):
        if identifier == 0x000:
            self.nodes[data[1]].operational = data[0] == 1
        elif identifier == 0x080:
            self._sync()
        elif identifier == 0x700 + 127:
            self.master_heartbeats += 1
            if self.beating:
                for node in self.nodes.values():
                    if node.answers_sdo:
                        self.send(0x700 + node.node_id, [5 if node.operational else 127])
        elif identifier & 0x780 == 0x600:
            node = self.nodes.get(identifier & 0x7F)
            if node is not None and node.answers_sdo and data[0] != 0x80:
                answer = node.sdo(data)
                if answer is not None:
                    self.send(0x580 + node.node_id, answer)
        elif identifier & 0x780 == 0x200:
            self.nodes[identifier & 0x7F].rpdo(data)

    def _sync(self):
        for node in self.nodes.values():
            if node.operational and node.answers_sync:
                self.send(0x180 + node.node_id, node.tpdo())
                if (
                    int.from_bytes(node.objects.get((0x1801, 1), b"\x80"), "little")
                    == 0x4000_0280 + node.node_id
                ):
                    self.send(0x280 + node.node_id, struct.pack("<i", node.velocity))


@pytest.fixture(scope="session")
def shipped():
    """The shipped configuration as a mapping."""
    return yaml.safe_load((REPOSITORY / "config" / "can.yaml").read_text())


@pytest.fixture
def mapping(shipped):
    """The shipped configuration, on a virtual bus of its own, for a test to change."""
    content = copy.deepcopy(shipped)
    content["buses"]["main"].update(interface="virtual", channel=f"drivers-{next(CHANNELS)}")
    return content


@pytest.fixture
def config(mapping):
    """The shipped configuration on a virtual bus; slower, so that a busy test machine keeps up."""
    mapping["rate"] = 100.0
    mapping["timeouts"].update(
        command=0.3,
        feedback=0.3,
        supervisor=0.6,
        heartbeat_producer=0.03,
        heartbeat_consumer=0.6,
        sdo=0.1,
        transition=0.3,
        stop=0.3,
        enable=0.5,
    )
    return CanConfig.from_mapping(mapping, "can.yaml")


@pytest.fixture
def far_end(config):
    """All devices of `config`, scripted."""
    bus = ScriptedBus(
        config.buses[0].channel,
        [ScriptedDrive(drive.node_id) for drive in config.drives],
        [ScriptedCell(cell.node_id) for cell in config.load_cells],
    )
    yield bus
    bus.close()


@pytest.fixture
def ports(config, far_end):
    """The near end of the bus of `config`, opened after the far one."""
    ports = open_ports(config)
    yield ports
    ports.close()


@pytest.fixture
def wait_until():
    """Wait for a condition that another thread brings about."""

    def wait(condition, timeout=120.0):
        pause = threading.Event()
        for _ in range(int(timeout / 0.005)):
            if condition():
                return
            pause.wait(0.005)
        pytest.fail("the condition did not come true in time")

    return wait
