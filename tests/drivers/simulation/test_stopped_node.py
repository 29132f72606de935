"""A drive that somebody else has stopped by NMT: it serves no SDO then, and is set up again all the same."""

import dataclasses
import uuid
from pathlib import Path

import can

from cspr_drivers.bus.opening import open_ports
from cspr_drivers.config.can_config import BusConfig, CanConfig
from cspr_drivers.drives.master import DriveMaster
from cspr_drivers.simulation.robot_emulator import RobotEmulator
from cspr_drivers.simulation.simulation_config import SimulationConfig
from cspr_msgs_py.vocabulary import DriverState

CONFIG = Path(__file__).parents[3] / "config"


def test_a_stopped_drive_is_taken_in_again(noted_plant, wait_until):
    config = CanConfig.from_yaml(CONFIG / "can.yaml")
    channel = f"stopped {uuid.uuid4()}"
    config = dataclasses.replace(
        config,
        rate=20.0,
        buses=(BusConfig("main", "virtual", channel, 1_000_000),),
        timeouts=dataclasses.replace(
            config.timeouts, sdo=0.5, feedback=2.0, heartbeat_consumer=2.0, transition=2.0
        ),
    )
    simulation = SimulationConfig.from_yaml(CONFIG / "simulation.yaml")
    lines = []
    with RobotEmulator(config, simulation, noted_plant(8), CONFIG / "eds") as emulator:
        ports = open_ports(config)
        somebody = can.Bus(interface="virtual", channel=channel)
        master = DriveMaster(config, ports, lambda states: None, lines.append)
        master.start()
        try:
            wait_until(lambda: master.states()[0] is DriverState.DISABLED, timeout=30.0)
            before = emulator.drives[2].nmt_state
            somebody.send(can.Message(arbitration_id=0x000, data=[0x02, 3], is_extended_id=False))
            assert any(
                (frame.arbitration_id, bytes(frame.data)) == (0x000, bytes([0x80, 3]))
                for frame in iter(lambda: somebody.recv(30.0), None)
            ), "the driver has not noticed"
            wait_until(lambda: emulator.drives[2].nmt_state is before, timeout=30.0)
            wait_until(lambda: master.states()[0] is DriverState.DISABLED, timeout=30.0)
        finally:
            master.stop()
            ports.close()
            somebody.shutdown()
