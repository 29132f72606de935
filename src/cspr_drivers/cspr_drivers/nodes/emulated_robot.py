"""Executable ``emulated_robot``: the emulated devices and their plant on the buses of `can.yaml`, without drivers.

For drivers in another process, on SocketCAN: ``drivers`` cannot tell it from a real robot.
"""

from __future__ import annotations

import sys

from cspr_drivers.nodes.driver_node import SWITCH_INTERVAL
from cspr_drivers.nodes.simulated_robot import SimulatedRobot
from cspr_msgs_py.runtime.process import run_nodes


def main() -> int:
    """Run the devices in a process of their own."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run_nodes(lambda: [SimulatedRobot(virtual=False)])


if __name__ == "__main__":
    sys.exit(main())
