"""Two buses with four drives and four load cells each, at 500 Hz: the shipped configuration on virtual buses."""

import copy
import itertools
from pathlib import Path

import pytest
import yaml

from cspr_drivers.bus.bus_load import require_fitting_cycle
from cspr_drivers.bus.opening import open_ports
from cspr_drivers.config.can_config import CanConfig
from cspr_drivers.drives.master import DriveMaster
from cspr_drivers.errors import ConfigurationError
from cspr_drivers.load_cells.master import LoadCellMaster
from cspr_msgs_py.vocabulary import DriverState

from ..conftest import ScriptedBus, ScriptedCell, ScriptedDrive

SHIPPED = Path(__file__).parents[3] / "config" / "can_two_buses.yaml"
CHANNELS = itertools.count()


@pytest.fixture
def content():
    content = yaml.safe_load(SHIPPED.read_text())
    number = next(CHANNELS)
    for name, bus in content["buses"].items():
        bus.update(interface="virtual", channel=f"two-buses-{number}-{name}")
    # A busy test machine is late now and then.
    content["allowed_drop"] = 0.2
    content["timeouts"].update(command=1.0, feedback=1.0, heartbeat_consumer=2.0, heartbeat_producer=0.03)
    return content


@pytest.fixture
def config(content):
    return CanConfig.from_mapping(content, "can_two_buses.yaml")


@pytest.fixture
def far_ends(config):
    ends = {
        bus.name: ScriptedBus(
            bus.channel,
            [ScriptedDrive(drive.node_id) for drive in config.drives if drive.bus == bus.name],
            [ScriptedCell(cell.node_id) for cell in config.load_cells if cell.bus == bus.name],
        )
        for bus in config.buses
    }
    yield ends
    for end in ends.values():
        end.close()


def fitting(mapping):
    """Return the loads of a configuration whose rate is that of the controllers."""
    config = CanConfig.from_mapping(mapping, "can.yaml")
    return require_fitting_cycle(config, config.rate)


def test_four_of_each_on_a_bus_fit_500_hz(config):
    loads = require_fitting_cycle(config, config.rate)
    # 55 + 4 (95 + 135 + 105) bits, DESIGN's worst case, at 1 Mbit/s.
    assert [(load.bus, load.bits) for load in loads] == [("first", 1395), ("second", 1395)]
    assert config.rate == 500.0


def test_eight_of_each_do_not_fit_one_bus_at_500_hz(content):
    content = copy.deepcopy(content)
    for device in (*content["drives"], *content["load_cells"]):
        device["bus"] = "first"
    with pytest.raises(ConfigurationError, match="lower the rate or use another bus"):
        fitting(content)


def test_with_velocities_both_rates_still_fit(content, mapping):
    for each, share in ((content, 0.89), (mapping, 0.875)):
        each["velocity_source"] = "velocity_actual"
        each["pdo"]["drive_tpdo_2"] = ["velocity_actual"]
        loads = fitting(each)
        assert loads[0].share == pytest.approx(share, abs=0.01)


def test_drives_and_load_cells_of_both_buses_act_as_one_robot(config, far_ends, wait_until):
    ports = open_ports(config)
    states, tensions = [], []

    def answer(motor_states):
        states.append(motor_states)
        drives.supervised(motor_states.stamp_ns)
        for index in range(8):
            drives.command(index, motor_states.stamp_ns, 1.0)

    drives = DriveMaster(config, ports, answer, lambda line: None)
    cells = LoadCellMaster(
        config, ports, lambda stamp, values: tensions.append((stamp, values)), lambda line: None
    )
    try:
        drives.start()
        cells.start()
        wait_until(lambda: drives.snapshot().state is DriverState.DISABLED, 20.0)
        wait_until(lambda: drives.enable() is None)
        wait_until(lambda: drives.snapshot().state is DriverState.ENABLED)
        for end in far_ends.values():
            for drive in end.drives:
                drive.counts = 13107 if drive.node_id % 2 else -13107
        wait_until(lambda: min(states[-1].angles) > 0.628)  # a tenth of a revolution each, of all cables out
        wait_until(lambda: tensions)
        assert tensions[-1][1] == pytest.approx([110.0 + 10.0 * k for k in range(8)])
        stamps = {state.stamp_ns for state in states}
        wait_until(lambda: any(stamp in stamps for stamp, _ in tensions))
        # A bus that falls silent stops the drives on the other one.
        for drive in far_ends["second"].drives:
            drive.answers_sync = False
        wait_until(lambda: drives.snapshot().state is DriverState.FAULT, 20.0)
        wait_until(lambda: all(drive.status == 0x50 for drive in far_ends["first"].drives))
    finally:
        cells.stop()
        drives.stop()
        ports.close()
